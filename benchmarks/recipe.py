"""The recipe against one change at a time, each with and without transfer, over the in-memory bus: no broker needed.

A run over the real bus comes to the same rounds (tests/integration/test_exactness.py). Seeds 101 to 106 are for tuning
and are in no study.

python -m benchmarks.recipe [--seeds 101 102] [--only recipe heads] [--out results/recipe/compact.csv]
"""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.harness import in_workers, workers_parser
from jouleswarm.common.process import use_one_thread
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.simulation import run_in_memory

# Changes to the data center alone, and changes to the robots' own learning, which the arm without transfer has too.
META_ONLY = {
    "heads": ["meta.heads=shared"],
    "exploration": ["meta.epsilon=0.6"],
    "starts": ["meta.starts=area"],
    "fomaml": ["methods=['fomaml']"],
    "maml": ["methods=['maml']"],
    "reptile": ["methods=['reptile']"],
    "anil": ["methods=['anil']"],
}
BOTH = {
    "recipe": [],
    "adam_eps": ["learning.adam_eps=1e-8"],
    "target": ["learning.target_polyak=0.1"],
    "frame": ["camera.draw=frame"],
    "input": ["camera.draw=input"],
    "epsilon": ["learning.epsilon=0.1"],
    "exploring": ["learning.epsilon=0.6"],
    "own": ["learning.collect=own"],
}
COLUMNS = ("variant", "seed", "arm", "rounds", "rounds_first", "not_learned", "rounds_of_tasks")


def measure(variant: str, seed: int, scenario: str) -> list[tuple[object, ...]]:
    """A row for each arm: rounds summed over the tasks by the reward window, and to the first success."""
    use_one_thread()
    methods = "['multitask']" if variant in META_ONLY else "['multitask', 'fl']"
    changes = {**META_ONLY, **BOTH}[variant]
    settings = load_scenario(scenario, [f"methods={methods}", f"seed={seed}", *changes])
    outcome = run_in_memory(settings)
    return [(variant, seed, arm, *summary(settings, outcome.rows, arm)) for arm in settings.arm_names]


def summary(scenario: Scenario, rows: Sequence[RoundRow], arm: str) -> tuple[int, int, int, str]:
    """Rounds, rounds to the first success, tasks not learned, and rounds task by task."""
    last, first, failed = [], [], 0
    for task, cluster in scenario.clusters.items():
        mine = [row for row in rows if (row.arm, row.task, row.phase) == (arm, task, "fl") and row.agent]
        by_round: dict[int, float] = {}
        for row in mine:
            by_round[row.round] = by_round.get(row.round, 0.0) + (row.reward or 0.0) / len(cluster)
        end = max(by_round)
        last.append(end)
        target = scenario.federation.target_reward
        first.append(min((each for each, reward in by_round.items() if reward >= target), default=end))
        failed += any(row.learned is False for row in mine)
    return sum(last), sum(first), failed, " ".join(map(str, last))


def main() -> None:
    known = workers_parser(__doc__)
    known.add_argument("--only", nargs="+", choices=[*BOTH, *META_ONLY], default=[*BOTH, *META_ONLY])
    options = known.parse_args()
    jobs = [(variant, seed, options.scenario) for seed in options.seeds for variant in options.only]
    in_workers(COLUMNS, measure, jobs, options)


if __name__ == "__main__":
    main()
