"""Gymnasium's CartPole with a pole of another length for each task."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.envs.classic_control.cartpole import CartPoleEnv

from jouleswarm.common.errors import ConfigurationError

Floats = npt.NDArray[np.float32]


class CartPole(gymnasium.Env[Floats, np.int64]):
    """Keep a pole upright by pushing its cart: a reward of 1 for each step until it falls.

    Observations are float32 [4]: place and speed of the cart, angle and angular speed of the pole. It can go on in the
    middle of an episode (`state`), and knows a policy that keeps the pole up (`guide`).

    Arguments:
        length: of the pole, metres.
        max_steps: an episode is truncated after so many.

    Raises:
        ConfigurationError: one of them is not above 0.
    """

    metadata: dict[str, Any] = {"actions": ("left", "right")}  # noqa: RUF012

    def __init__(self, length: float = 1.0, max_steps: int = 200) -> None:
        if not 0 < length < 100 or max_steps < 1:
            raise ConfigurationError(f"cartpole: length {length}, max_steps {max_steps}; expected above 0")
        self._inner: Any = CartPoleEnv()
        self._inner.length = length / 2  # half of it, as everywhere there
        self._inner.polemass_length = self._inner.masspole * self._inner.length
        self._max_steps, self._steps = max_steps, 0
        self.observation_space = self._inner.observation_space
        self.action_space = gymnasium.spaces.Discrete(2)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Floats, dict[str, Any]]:
        super().reset(seed=seed)
        self._inner.np_random = self.np_random
        self._steps = 0
        observation, _ = self._inner.reset(options=options)
        return observation, {}

    def step(self, action: np.int64 | int) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        observation, reward, fallen, _, _ = self._inner.step(action)
        self._steps += 1
        return observation, float(reward), fallen, self._steps >= self._max_steps, {}

    def state(self) -> dict[str, Any]:
        """Where cart and pole are, and since when."""
        return {"motion": np.asarray(self._inner.state).tolist(), "steps": self._steps}

    def load_state(self, state: dict[str, Any]) -> None:
        """Take up what `state` returned."""
        self._inner.state, self._inner.steps_beyond_terminated = np.array(state["motion"]), None
        self._steps = state["steps"]

    def guide(self) -> int:
        """Push to where the pole is falling, and a little towards the middle."""
        place, speed, angle, turning = np.asarray(self._inner.state)
        return int(0.05 * place + 0.1 * speed + angle + 0.3 * turning > 0)
