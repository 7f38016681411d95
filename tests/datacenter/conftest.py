"""A small scenario of two training tasks, and made-up experience for it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.messages import MotionHeader
from jouleswarm.datacenter.experience import Motion

Experience = dict[int, list[list[Motion]]]


def _scenario(**sections: Any) -> Scenario:
    base: dict[str, Any] = {
        "name": "t", "seed": 5,
        "world": {"rows": 4, "cols": 3},
        "camera": {"width": 16, "height": 12},
        "network": {"width": 8, "height": 6, "conv": [[4, 3, 1]], "dense": [8]},
        "learning": {"motions_per_round": 4},
        "meta": {
            "t0": 4, "training_tasks": [1, 2], "batch_size": 4, "support_batches": 2, "query_batches": 3,
            "inner_steps": 2,
        },
        "tasks": [{"id": task, "map": ". E . \n . * . \n . * . \n . X ."} for task in (1, 2, 3)],
    }  # fmt: skip
    for name, values in sections.items():
        base[name] = {**base.get(name, {}), **values} if isinstance(values, dict) else values
    return scenario_from(base, "test")


def _experience(scenario: Scenario, round_: int) -> Experience:
    rng = np.random.default_rng([round_, 7])
    motions = scenario.learning.motions_per_round

    def motion(task: int, agent: int, index: int) -> Motion:
        walked = (round_ - 1) * motions + index  # episodes of three motions, whatever the rounds
        header = MotionHeader(
            task=task, agent=agent, round=round_, motion=index, action=int(rng.integers(4)),
            reward=float(rng.normal()), first=walked % 3 == 0, terminated=walked % 3 == 2,
        )  # fmt: skip
        return Motion(rng.integers(0, 256, (6, 8, 4), dtype=np.uint8), header)

    return {
        task: [[motion(task, agent, index) for index in range(motions)] for agent in agents]
        for task, agents in scenario.training_agents.items()
    }


@pytest.fixture
def make_scenario() -> Callable[..., Scenario]:
    return _scenario


@pytest.fixture
def make_experience() -> Callable[[Scenario, int], Experience]:
    return _experience
