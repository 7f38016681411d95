"""What a Q-network is, and the two that ship here."""

from __future__ import annotations

import math
from typing import Any

import numpy.typing as npt
import torch
from gymnasium import spaces
from torch import Tensor, nn

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.sections import Network
from jouleswarm.common.scenario.spaces import Observation

Array = npt.NDArray[Any]

_CENTRE, _SCALE = 128.0, 64.0


class QNetwork(nn.Sequential):
    """Q(x, .): float32 [batch, *observation] -> float32 [batch, actions].

    Images come channels first, numbers of a Discrete space one-hot. The last child is the head: what a training task
    may have a copy of.
    """

    shift: float = 0.0
    divisor: float = 1.0
    """x -> (x - shift) / divisor before the first layer."""
    takes = Observation(shape=(1,), dtype="float32")
    """What the core gives it, as a replay memory keeps it; set when it has been built."""

    def prepare(self, batch: Array, device: torch.device | str = "cpu") -> Tensor:
        """Observations as they are kept, [batch, ...], as the first layer takes them, float32."""
        given = torch.from_numpy(batch).to(device)
        if self.takes.values is not None:
            return nn.functional.one_hot(given.to(torch.int64), self.takes.values).to(torch.float32)
        if self.takes.is_image:
            # Centred: with 0..1 all frames share a large common part, so that a step for one landmark moves the values
            # of all the others, and learning takes about twice as many rounds.
            return given.permute(0, 3, 1, 2).to(torch.float32).sub_(self.shift).div_(self.divisor)
        fed = given.to(torch.float32).reshape(len(batch), *self.takes.fed)
        return fed if (self.shift, self.divisor) == (0.0, 1.0) else (fed - self.shift) / self.divisor


def mlp(observation: spaces.Box, actions: int, settings: Network) -> QNetwork:
    """Dense layers, `network.dense` units each."""
    return _dense([nn.Flatten()], math.prod(observation.shape), observation, actions, settings)


def deepmind(observation: spaces.Box, actions: int, settings: Network) -> QNetwork:
    """The network of Mnih et al. (2015): `network.conv`, then `network.dense`; at 96 x 72 x 4 with the settings'
    defaults and 4 actions there are 1,391,268 parameters.

    Raises:
        ConfigurationError: it is no image, or the convolutions do not fit into it.
    """
    if len(observation.shape) != 3:
        raise ConfigurationError(
            f"network.build deepmind takes images [channels, height, width], got observations {observation.shape}; "
            'expected network.build = "mlp"'
        )
    layers: list[nn.Module] = []
    channels, height, width = observation.shape
    for out, kernel, stride in settings.conv:
        layers += [nn.Conv2d(channels, out, kernel, stride), nn.ReLU()]
        channels, height, width = out, (height - kernel) // stride + 1, (width - kernel) // stride + 1
        if height < 1 or width < 1:
            raise ConfigurationError(
                f"network.conv: kernel {kernel} stride {stride} leaves nothing of "
                f"{observation.shape[2]} x {observation.shape[1]}; use a larger input or smaller kernels"
            )
    layers.append(nn.Flatten())
    return _dense(layers, channels * height * width, observation, actions, settings)


def _dense(
    layers: list[nn.Module], features: int, observation: spaces.Box, actions: int, settings: Network
) -> QNetwork:
    for size in settings.dense:
        layers += [nn.Linear(features, size), nn.ReLU()]
        features = size
    model = QNetwork(*layers, nn.Linear(features, actions))
    if len(observation.shape) == 3 and observation.high.max() == 255:
        model.shift, model.divisor = _CENTRE, _SCALE
    return model
