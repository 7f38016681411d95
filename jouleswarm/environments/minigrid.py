"""MiniGrid (Chevalier-Boisvert et al. 2023) as pictures: `pip install jouleswarm[minigrid]`."""

from __future__ import annotations

import importlib
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

from jouleswarm.common.errors import ConfigurationError

Picture = npt.NDArray[np.uint8]

_ACTIONS = ("left", "right", "forward", "pickup", "drop", "toggle", "done")


class MiniGrid(gymnasium.Wrapper[Picture, np.int64, Any, Any]):
    """The picture of what the agent sees, and the first of its actions."""

    def __init__(self, environment: gymnasium.Env[Picture, np.int64], actions: int) -> None:
        super().__init__(environment)
        self.action_space = gymnasium.spaces.Discrete(actions)
        self.metadata = {**environment.metadata, "actions": _ACTIONS[:actions], "channels": ("red", "green", "blue")}


def minigrid(
    id: str = "MiniGrid-Empty-5x5-v0", actions: int = 3, tile_size: int = 4, **kwargs: Any
) -> gymnasium.Env[Picture, np.int64]:
    """A task of MiniGrid: uint8 [7 tile_size, 7 tile_size, 3], what the agent sees before it.

    Arguments:
        id: Gymnasium's, of the task.
        actions: so many: left, right, forward, pickup, drop, toggle, done.
        tile_size: pixels of a field's side.
        kwargs: of the task.

    Raises:
        ConfigurationError: MiniGrid is not installed, or there are not so many actions.
    """
    if not 1 <= actions <= len(_ACTIONS):
        raise ConfigurationError(f"minigrid: {actions} actions, expected 1 to {len(_ACTIONS)}")
    try:
        importlib.import_module("minigrid")  # to its end, where it registers: its parts are there before
        from minigrid.wrappers import ImgObsWrapper, RGBImgPartialObsWrapper
    except ModuleNotFoundError as error:
        raise ConfigurationError(
            "environment 'minigrid': MiniGrid is not installed; expected `pip install jouleswarm[minigrid]`"
        ) from error
    made = gymnasium.make(id, disable_env_checker=True, **kwargs)
    return MiniGrid(ImgObsWrapper(RGBImgPartialObsWrapper(made, tile_size=tile_size)), actions)
