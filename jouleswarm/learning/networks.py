"""The network door: a Q-network for whatever an environment shows, built by name, its weights drawn here."""

from __future__ import annotations

import math
import threading
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from gymnasium import spaces
from torch import Tensor, nn

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.environments import first_line
from jouleswarm.common.scenario.fitting import size_misfits
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.scenario.sections import Network
from jouleswarm.common.scenario.spaces import Interface, Observation, Spaces, shipped_build
from jouleswarm.common.wire.saved_models import Input, Layer, Use
from jouleswarm.learning.heads import head_of
from jouleswarm.learning.qnetwork import QNetwork, deepmind, mlp

_drawing = threading.Lock()  # PyTorch has one generator for all threads
_PLAIN = (nn.Conv1d, nn.Conv2d, nn.Conv3d, nn.Linear)


def build_qnetwork(scenario: Scenario, seed: int | None = None) -> QNetwork:
    """The scenario's Q-network.

    With `seed` the weights of dense and convolutional layers are drawn from a generator of its own (He et al. 2015,
    uniform, as PyTorch's default); other parameters are as the layer begins, whatever PyTorch drew before.

    Raises:
        ConfigurationError: there is none of that name, it does not fit what it is given or the actions, or holds what
            would not be sent.
    """
    told = scenario.spaces
    takes, actions = told.observation.kept(scenario.network), len(told.actions)
    name = scenario.network.build or shipped_build(takes)
    build, what = scenario.open("networks", name), f"network {name!r}"
    model = _built(build, what, takes, actions, scenario.network, seed or 0)
    model.takes = takes
    if build not in (mlp, deepmind):
        _check(model, what, actions)
    elif scenario.network.kwargs:
        raise ConfigurationError(f"network.kwargs {sorted(scenario.network.kwargs)}: {name} takes none")
    if misfit := next(size_misfits(scenario, told, _interface(model, told)), None):
        raise ConfigurationError(f"scenario {scenario.name}: {misfit}")
    if seed is not None:
        _draw(model, torch.Generator().manual_seed(seed))
    for parameter in model.parameters():
        if parameter.dim() == 4:  # images come channels last, and convolve faster so
            parameter.data = parameter.data.contiguous(memory_format=torch.channels_last)
    return model


def _built(build: Any, what: str, takes: Observation, actions: int, settings: Network, seed: int) -> QNetwork:
    low, high = (0.0, 255.0) if takes.is_image else (0.0, 1.0) if takes.values is not None else (-np.inf, np.inf)
    try:
        with _drawing, torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            model = build(spaces.Box(low, high, takes.fed, np.float32), actions, settings)
    except ConfigurationError:
        raise
    except Exception as error:  # whatever a builder of the user's does
        raise ConfigurationError(f"{what}: {type(error).__name__}: {first_line(error)}") from error
    if not isinstance(model, QNetwork):
        raise ConfigurationError(f"{what}: gave a {type(model).__name__}, expected a jouleswarm.QNetwork")
    return model


def _draw(model: QNetwork, generator: torch.Generator) -> None:
    for layer in model.modules():
        if isinstance(layer, _PLAIN):
            bound = 1 / math.sqrt(layer.weight[0].numel())
            for parameter in layer.parameters():
                with torch.no_grad():
                    parameter.uniform_(-bound, bound, generator=generator)


def _check(model: QNetwork, what: str, actions: int) -> None:
    """Feed a network that somebody brought, twice."""
    batch = np.zeros((2, *model.takes.shape), model.takes.dtype)
    try:
        with torch.no_grad():
            values, again = (model(model.prepare(batch)) for _ in range(2))
    except Exception as error:  # whatever its layers do
        shape = list(model.takes.fed)
        raise ConfigurationError(
            f"{what}: does not take observations of shape {shape}: {type(error).__name__}: {first_line(error)}"
        ) from error
    if not isinstance(values, Tensor) or values.shape != (2, actions) or values.dtype != torch.float32:
        got = f"{values.dtype} {list(values.shape)}" if isinstance(values, Tensor) else type(values).__name__
        raise ConfigurationError(
            f"{what}: gives {got} for 2 observations, expected torch.float32 {[2, actions]}: a value for each action"
        )
    if not torch.equal(values, again):
        raise ConfigurationError(f"{what}: gives other values each time (Dropout?); expected the same")
    if not head_of(model):
        raise ConfigurationError(f"{what}: its last child has no parameters; expected the layer that gives the values")
    if unsent := [name for name, _ in model.named_buffers()]:
        raise ConfigurationError(
            f"{what}: {', '.join(unsent)} would not be sent with its parameters; use LayerNorm or GroupNorm"
        )
    if odd := [name for name, parameter in model.named_parameters() if parameter.dtype != torch.float32]:
        raise ConfigurationError(f"{what}: {', '.join(odd)} not in float32")


def interface_of(scenario: Scenario) -> Interface:
    """All sizes, from the network itself."""
    return _interface(build_qnetwork(scenario), scenario.spaces)


def _interface(model: QNetwork, told: Spaces) -> Interface:
    return Interface(spaces=told, tensors=tuple(shapes_of(model).items()), head=len(head_of(model)))


def use_of(scenario: Scenario) -> Use:
    """What a file of such a network's weights says of how it is used: all that is done to an observation."""
    model, told = build_qnetwork(scenario), scenario.spaces
    takes, is_image = model.takes, model.takes.is_image
    return Use(
        input=Input(
            observation=told.observation,
            shape=takes.fed,
            height=takes.shape[0] if is_image else None,
            width=takes.shape[1] if is_image else None,
            channels=told.channels if is_image else None,
            resize="area" if is_image else None,
            subtract=model.shift,
            divide=model.divisor,
            layout="NCHW" if is_image else "one-hot" if takes.values is not None else "flat",
        ),
        network=tuple(_described(layer) for layer in model),
        actions=told.actions,
    )


def _described(layer: nn.Module) -> Layer:
    name, said = type(layer).__name__.lower(), str(layer)
    if isinstance(layer, nn.Conv2d):
        inputs, outputs, kernel, stride = layer.in_channels, layer.out_channels, layer.kernel_size[0], layer.stride[0]
        if said == str(nn.Conv2d(inputs, outputs, kernel, stride)):
            return Layer(layer=name, inputs=inputs, outputs=outputs, kernel=kernel, stride=stride)
    if isinstance(layer, nn.Linear) and said == str(nn.Linear(layer.in_features, layer.out_features)):
        return Layer(layer=name, inputs=layer.in_features, outputs=layer.out_features)
    return Layer(layer=name, module=None if said in (str(nn.Flatten()), str(nn.ReLU())) else said)


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
