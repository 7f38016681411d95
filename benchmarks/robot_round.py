"""Where a robot's round goes: gradients, frames, the network's answers; with frames drawn large and drawn small.

    python -m benchmarks.robot_round [--scenario quick] [--rounds 20] [--steps 400]

Processor time of one robot, one thread, landmarks seen before: `learning.motions_per_round` motions, the gradient
steps, and a greedy evaluation of at most as many motions. Both values of `camera.draw` in turn, in one run. Frames are
all of `TaskEnvironment.step`, `reset` and shrinking. The last line is the whole `env.step`, frames a second.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np

import jouleswarm.agents.explorer as exploring
from benchmarks.harness import compare, cpu_seconds, in_turn, parser
from jouleswarm.agents.explorer import Explorer
from jouleswarm.codecs.frames import shrink
from jouleswarm.common.process import use_one_thread
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.environments.environment import TaskEnvironment
from jouleswarm.learning.learner import Learner
from jouleswarm.learning.networks import build_qnetwork, to_weights

_WARM_UP = 5
_PARTS = "frames", "answers", "gradients", "rest"
_TIMED: tuple[tuple[Any, str, str], ...] = (
    (TaskEnvironment, "step", "frames"),
    (TaskEnvironment, "reset", "frames"),
    (exploring, "shrink", "frames"),
    (Learner, "q_values", "answers"),
    (Learner, "learn", "gradients"),
)


class Stopwatch:
    """Processor time by part."""

    def __init__(self) -> None:
        self.spent = dict.fromkeys(_PARTS, 0.0)

    def timed(self, part: str, call: Callable[..., object]) -> Callable[..., object]:
        """The same, and its time booked."""

        def measured(*given: object, **named: object) -> object:
            begun = time.thread_time()
            try:
                return call(*given, **named)
            finally:
                self.spent[part] += time.thread_time() - begun

        return measured


class Side:
    """One robot's rounds."""

    def __init__(self, scenario: Scenario) -> None:
        network = build_qnetwork(scenario, 0)
        self._settings = scenario.learning
        self._learner = Learner(network, self._settings, to_weights(network), np.random.default_rng(0))
        self._explorer = Explorer(scenario, scenario.agents[0])
        self._explorer.begin("fl", scenario.cluster(scenario.tasks[0].id))
        self.parts: list[dict[str, float]] = []

    def round(self) -> float:
        """Seconds; what each part took is noted."""
        watch = Stopwatch()
        before = [(owner, name, getattr(owner, name)) for owner, name, _ in _TIMED]
        for owner, name, part in _TIMED:
            setattr(owner, name, watch.timed(part, getattr(owner, name)))
        try:
            whole = cpu_seconds(self._round)
        finally:
            for owner, name, call in before:
                setattr(owner, name, call)
        watch.spent["rest"] = whole - sum(watch.spent.values())
        self.parts.append(watch.spent)
        return whole

    def _round(self) -> None:
        self._explorer.collect(self._learner, self._settings.motions_per_round)
        self._learner.learn(self._settings.batches_per_round)
        self._explorer.evaluate(self._learner)


def steps_a_second(scenario: Scenario, steps: int) -> Callable[[], float]:
    """Of the whole `env.step` of Gymnasium, as large as the network looks at."""
    kept, environment = scenario.spaces.observation.kept(scenario.network), scenario.make(scenario.tasks[0].id)
    environment.reset(seed=1)
    environment.unwrapped.show_as(kept.shape)

    def measured() -> float:
        def walk() -> None:
            for index in range(steps):
                seen, _, terminated, truncated, _ = environment.step(index % len(scenario.spaces.actions))
                shrink(seen, kept)
                if terminated or truncated:
                    environment.reset()

        return steps / cpu_seconds(walk)

    return measured


def main() -> None:
    known = parser(__doc__)
    known.add_argument("--scenario", default="quick")
    known.add_argument("--rounds", type=int, default=20)
    known.add_argument("--steps", type=int, default=400)
    options = known.parse_args()
    use_one_thread()
    drawn = {draw: load_scenario(options.scenario, [f"camera.draw={draw}"]) for draw in ("input", "frame")}
    sides = {draw: Side(scenario) for draw, scenario in drawn.items()}
    found = in_turn({draw: side.round for draw, side in sides.items()}, options.rounds, _WARM_UP)
    for draw, side in sides.items():
        noted = side.parts[_WARM_UP:]
        whole = sum(sum(each.values()) for each in noted)
        shares = (f"{part} {sum(each[part] for each in noted) / whole:.1%}" for part in _PARTS)
        print(f"camera.draw = {draw}: {statistics.median(found[draw]) * 1e3:.1f} ms a round: {', '.join(shares)}")
    print(compare("a round", found))
    rates = in_turn({draw: steps_a_second(each, options.steps) for draw, each in drawn.items()}, 7)
    print(compare("env.step and shrinking", rates, unit="/s", factor=1))


if __name__ == "__main__":
    main()
