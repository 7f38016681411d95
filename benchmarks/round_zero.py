"""Which tasks robots can do before they learn, and whether these, and no others, took no round and no joule.

A run over the in-memory bus, about three minutes of one core of `quick`. R of a trained model near the target is of the
processor's last bits, so which tasks they are is told here and asked for nowhere.

python -m benchmarks.round_zero [--scenario quick] [--seed 1] [--method multitask]
"""

from __future__ import annotations

import argparse

from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.energy.literal import bill
from jouleswarm.runs.arm_facts import arm_facts
from jouleswarm.runs.facts import task_results
from jouleswarm.simulation import run_in_memory


def main() -> None:
    """Print a line a task; exit 1 if one of them is wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", default="quick")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--method", default="multitask")
    asked = parser.parse_args()
    scenario = load_scenario(asked.scenario, [f"methods=['{asked.method}']", f"seed={asked.seed}"])
    outcome = run_in_memory(scenario)
    facts = arm_facts(scenario, outcome.rows, outcome.hub.meter.rows(), asked.method)
    tried = {row.task: row.cluster_reward for row in outcome.rows if row.agent and not row.round}
    wrong = 0
    for result in task_results(scenario, outcome.rows, asked.method):
        reward = tried[result.task] or 0.0
        joules = bill(facts.of_task(result.task).counts, scenario.energy).total_j
        solved = reward >= scenario.federation.target_reward
        told = f"R {reward:.1f} in round 0, t_i {result.rounds}, E_FL {joules:.1f} J"
        right = solved == (result.rounds == 0) == (joules == 0) and result.learned >= solved
        wrong += not right
        print(f"task {result.task}: {told}{'' if right else ': WRONG'}", flush=True)
    raise SystemExit(bool(wrong))


if __name__ == "__main__":
    main()
