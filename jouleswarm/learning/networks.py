"""The DeepMind Q-network (Mnih et al. 2015), sized by the scenario."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.sections import Network
from jouleswarm.common.wire.saved_models import Input, Layer, Use

CHANNEL_NAMES = ("red", "green", "blue", "depth")
ACTION_NAMES = ("forward", "backward", "left", "right")
CHANNELS, ACTIONS = len(CHANNEL_NAMES), len(ACTION_NAMES)
_CENTRE, _SCALE = 128.0, 64.0


def build_qnetwork(network: Network, seed: int | None = None) -> nn.Sequential:
    """Q(x, .): observations, float32 [batch, 4, height, width] -> float32 [batch, 4].

    With `seed` the weights are drawn from a generator of its own (He et al. 2015, uniform, as PyTorch's
    default), untouched by any other random state; at 96 x 72 there are 1,391,268 parameters.

    Raises:
        ConfigurationError: the convolutions do not fit into the input.
    """
    layers: list[nn.Module] = []
    channels, height, width = CHANNELS, network.height, network.width
    for out, kernel, stride in network.conv:
        layers += [nn.Conv2d(channels, out, kernel, stride), nn.ReLU()]
        channels, height, width = out, (height - kernel) // stride + 1, (width - kernel) // stride + 1
        if height < 1 or width < 1:
            raise ConfigurationError(
                f"network.conv: kernel {kernel} stride {stride} leaves nothing of "
                f"{network.width} x {network.height}; use a larger input or smaller kernels"
            )
    layers.append(nn.Flatten())
    features = channels * height * width
    for size in network.dense:
        layers += [nn.Linear(features, size), nn.ReLU()]
        features = size
    layers.append(nn.Linear(features, ACTIONS))
    model = nn.Sequential(*layers)
    if seed is not None:
        _initialise(model, torch.Generator().manual_seed(seed))
    for parameter in model.parameters():
        if parameter.dim() == 4:  # observations come channels last, and convolve faster so
            parameter.data = parameter.data.contiguous(memory_format=torch.channels_last)
    return model


def _initialise(model: nn.Sequential, generator: torch.Generator) -> None:
    for layer in model:
        if isinstance(layer, nn.Conv2d | nn.Linear):
            bound = 1 / math.sqrt(layer.weight[0].numel())
            for parameter in layer.parameters():
                with torch.no_grad():
                    parameter.uniform_(-bound, bound, generator=generator)


def observations(frames: npt.NDArray[np.uint8], device: torch.device | str = "cpu") -> Tensor:
    """Replayed frames, uint8 [batch, height, width, 4] -> float32 [batch, 4, height, width], -2 to 2.

    Centred: with 0..1 all frames share a large common part, so that a step for one landmark moves the values
    of all the others, and learning takes about twice as many rounds.
    """
    return torch.from_numpy(frames).to(device).permute(0, 3, 1, 2).to(torch.float32).sub_(_CENTRE).div_(_SCALE)


def use_of(network: Network) -> Use:
    """What a file of such a network's weights says of how it is used: all that `observations` and the layers do."""
    return Use(
        input=Input(
            height=network.height, width=network.width, channels=CHANNEL_NAMES, subtract=_CENTRE, divide=_SCALE
        ),
        network=tuple(_described(layer) for layer in build_qnetwork(network)),
        actions=ACTION_NAMES,
    )


def _described(layer: nn.Module) -> Layer:
    match layer:
        case nn.Conv2d():
            kernel, stride = layer.kernel_size[0], layer.stride[0]
            return Layer(
                layer="conv2d", inputs=layer.in_channels, outputs=layer.out_channels, kernel=kernel, stride=stride
            )
        case nn.Linear():
            return Layer(layer="linear", inputs=layer.in_features, outputs=layer.out_features)
        case nn.Flatten():
            return Layer(layer="flatten")
        case nn.ReLU():
            return Layer(layer="relu")
    raise TypeError(f"no description of {layer}")  # whoever adds a layer describes it


def to_weights(model: nn.Module) -> dict[str, npt.NDArray[np.float32]]:
    """A model's parameters as contiguous arrays of their own, in the model's order."""
    return {
        name: np.array(parameter.detach().cpu().numpy(), order="C", copy=True)
        for name, parameter in model.named_parameters()
    }


def load_weights(model: nn.Module, weights: dict[str, npt.NDArray[np.float32]]) -> None:
    """Copy arrays into a model's parameters, in place."""
    with torch.no_grad():
        for name, parameter in model.named_parameters():
            parameter.copy_(torch.tensor(weights[name]))


def shapes_of(model: nn.Module) -> dict[str, tuple[int, ...]]:
    """Tensor names and shapes that a payload of this model has."""
    return {name: tuple(parameter.shape) for name, parameter in model.named_parameters()}
