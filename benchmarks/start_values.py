"""What robots start from: greedy values of the meta-model on the way to t0, beside the best that there are.

Meta-trains once a seed over the in-memory bus, then asks each snapshot for max_a Q at every landmark of every task.
Three numbers for tasks seen in meta-training and for the others, each a mean over landmarks: the greedy value, the
best discounted return (value iteration on the position-reward table), and the share of landmarks whose greedy motion is
a best one. Round 0 is the network before meta-training.

python -m benchmarks.start_values [--seeds 101 102] [--rounds 0 42 66 90 132] [--out results/start_values/compact.csv]
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from safetensors.numpy import load

from benchmarks.harness import in_workers, workers_parser
from jouleswarm.codecs.frames import resize
from jouleswarm.common.process import use_one_thread
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.types import Weights
from jouleswarm.environments.landmarks.environment import LandmarksEnv
from jouleswarm.environments.landmarks.tasks import action_values, start_cells
from jouleswarm.learning.heads import start_of
from jouleswarm.learning.learner import Policy
from jouleswarm.learning.networks import build_qnetwork, to_weights
from jouleswarm.simulation import run_in_memory

_TIE = 1e-6


class Row(NamedTuple):
    """Of one seed and round of meta-training; tasks seen or not."""

    seed: int
    t0: int
    tasks: str
    greedy_value: float
    best_value: float
    best_motions: float


def measure(seed: int, rounds: Sequence[int], scenario: str) -> list[Row]:
    """Rows of one meta-training."""
    use_one_thread()
    *on_the_way, last = sorted(each for each in rounds if each)
    changes = [f"seed={seed}", "methods=['multitask']", f"meta.t0={last}", f"meta.snapshots={on_the_way}"]
    settings = load_scenario(scenario, [*changes, "federation.max_rounds=1"])
    outcome = run_in_memory(settings)
    models: dict[int, Weights] = {0: to_weights(build_qnetwork(settings, seed))}
    models |= {int(t0): load(payload) for (_, t0), payload in sorted(outcome.snapshots.items())}
    return [row for t0 in sorted(models) for row in _rows(settings, t0, models[t0])]


def _rows(settings: Scenario, t0: int, model: Weights) -> list[Row]:
    seen = settings.meta.training_tasks
    found: dict[str, list[tuple[float, float, float]]] = {"seen": [], "unseen": []}
    for task in (each.id for each in settings.tasks):
        found["seen" if task in seen else "unseen"] += _landmarks(
            settings, task, Policy(build_qnetwork(settings), start_of(model, task))
        )
    return [
        Row(settings.seed, t0, tasks, *(float(mean) for mean in np.mean(held, axis=0))) for tasks, held in found.items()
    ]


def _landmarks(settings: Scenario, task: int, policy: Policy) -> list[tuple[float, float, float]]:
    """(greedy value, best value, whether the greedy motion is a best one) at each landmark a robot may stand at."""
    env = LandmarksEnv(task, settings)
    best = action_values(env.rewards, env.task_map, settings.learning.discount)
    env.reset(seed=0)
    found = []
    for cell in start_cells(env.task_map):
        frame, _ = env.reset(options={"start": cell})
        values = policy.q_values(resize(frame, settings.network.width, settings.network.height)).numpy()
        here = best[:, cell[0], cell[1]]
        found.append((float(values.max()), float(here.max()), float(here[values.argmax()] >= here.max() - _TIE)))
    return found


def main() -> None:
    known = workers_parser(__doc__)
    known.add_argument("--rounds", type=int, nargs="+", default=[0, 42, 66, 90, 132])
    options = known.parse_args()
    jobs = [(seed, options.rounds, options.scenario) for seed in options.seeds]
    in_workers(Row._fields, measure, jobs, options)


if __name__ == "__main__":
    main()
