"""Which motion a robot makes while it collects, whatever it is learning."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from jouleswarm.environments.environment import TaskEnvironment

Choice = Callable[[npt.NDArray[Any]], int]
"""From the newest observation to an action, counted from 0."""


def by_guide(environment: TaskEnvironment, epsilon: float, rng: np.random.Generator) -> Choice:
    """Epsilon-greedy on the environment's guide, "independent from the policy being learned" (the paper's footnote).

    Each action is a random one with probability `epsilon`; always in an environment that has no guide.
    """

    def choose(_shown: npt.NDArray[Any]) -> int:
        if not environment.has_guide or rng.random() < epsilon:
            return int(rng.integers(len(environment.spaces.actions)))
        return environment.guide()

    return choose
