"""A scenario's own methods, tried when it is read: what their functions make of small random weights."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.types import Weights
from jouleswarm.methods.contract import in_a_line, is_shipped, read_only, unfit
from jouleswarm.methods.method import DATACENTER, ClusterRound, Method, Update

SHAPES = {"0.weight": (3, 2), "0.bias": (3,)}


def try_methods(scenario: Scenario) -> None:
    """Mix, and serve, by each method that does not ship here, once with one partner and once with three.

    Raises:
        ConfigurationError: one fails, or returns what is no model of the same shapes, float32 and finite.
    """
    for named, method in zip(scenario.methods, methods_of(scenario), strict=True):
        if not is_shipped(type(method)):
            try:
                _try(type(method))
            except ConfigurationError as error:
                raise ConfigurationError(f"method {named!r}: {error}") from error


def methods_of(scenario: Scenario) -> list[Method]:
    """An object of each of a scenario's methods."""
    return [scenario.method(name) for name in scenario.method_names]


def needs_learning(method: Method) -> bool:
    """Whether it is of the user's own, and adds to what is learned with PyTorch: `try_learning` tries that."""
    return not is_shipped(type(method)) and (method.own_penalty is not None or method.stage is not None)


def try_learning(scenario: Scenario) -> None:
    """Try penalties and stages of the user's own. Loads PyTorch: for a process of its own, and those that learn.

    Raises:
        ConfigurationError: one fails, or returns what it must not.
    """
    for method in filter(needs_learning, methods_of(scenario)):
        try_penalty(method)
        if method.stage is not None:
            _try_stage(scenario, method)


def try_penalty(method: Method) -> None:
    """Try a penalty of the method's own, on small random parameters.

    Raises:
        ConfigurationError: it fails, or returns neither a number nor a finite tensor without dimensions.
    """
    if method.own_penalty is None:
        return
    import torch

    rng = np.random.default_rng(0)
    params, start = ({name: torch.from_numpy(each) for name, each in _weights(rng).items()} for _ in range(2))
    for each in params.values():
        each.requires_grad_()
    what = f"method {method.name!r}: penalty"
    found = _call(lambda: method.penalty(params, start), what)
    is_one = isinstance(found, torch.Tensor) and found.ndim == 0 and bool(torch.isfinite(found))
    if not (is_one or isinstance(found, int | float)):
        got = f"a tensor of shape {list(found.shape)}" if isinstance(found, torch.Tensor) else in_a_line(found)[:60]
        raise ConfigurationError(f"{what}: got {got}, expected one finite number: a tensor without dimensions, or 0.0")


def _try_stage(scenario: Scenario, method: Method) -> None:
    from jouleswarm.learning.heads import head_of, meta_shapes
    from jouleswarm.learning.networks import build_qnetwork, shapes_of

    assert method.stage is not None
    what, make, network = f"method {method.name!r}: its stage", method.stage, build_qnetwork(scenario)
    stage = _call(lambda: make(scenario), what)
    shapes = meta_shapes(shapes_of(network), head_of(network), method.heads(scenario))
    if wrong := unfit(_call(stage.weights, f"{what}: weights"), shapes):
        raise ConfigurationError(f"{what}: weights: {wrong}")


def _try(kind: type[Method]) -> None:
    rng = np.random.default_rng(0)
    for partners in (1, 3):
        agents = (DATACENTER,) if kind.partners == "datacenter" else tuple(range(2, 2 + partners))
        theirs = {agent: Update(read_only(_weights(rng)), 10 * agent + 10, 1) for agent in agents}
        if kind.partners != "nobody":
            _try_to_mix(kind, read_only(_weights(rng)), theirs)
        if kind.partners == "datacenter" and kind.sends == "weights":
            served = {agent: Update(read_only(_weights(rng)), 10, 1) for agent in range(1, 1 + partners)}
            _try_to_serve(kind, ClusterRound(1, 1, served, batches=20))


def _try_to_mix(kind: type[Method], own: Weights, theirs: Mapping[int, Update]) -> None:
    for mix in (lambda: kind().mix(own, theirs, 0.5), lambda: kind().mix_lossy(own, own, theirs, 0.5)):
        first, again = (_call(mix, "mix") for _ in range(2))
        if wrong := unfit(first, SHAPES):
            raise ConfigurationError(f"mix: {wrong}")
        if any(first[name].tobytes() != again[name].tobytes() for name in SHAPES):
            raise ConfigurationError("mix: other weights the second time, expected the same of the same models")


def _try_to_serve(kind: type[Method], round_: ClusterRound) -> None:
    found = _call(lambda: kind().serve(round_), "serve")
    if not isinstance(found, tuple) or len(found) != 2 or not isinstance(found[1], int):
        raise ConfigurationError(
            f"serve: got {in_a_line(found):.60}, expected weights and the number of batch gradients"
        )
    if wrong := unfit(found[0], SHAPES):
        raise ConfigurationError(f"serve: {wrong}")


def _call(function: Callable[[], Any], what: str) -> Any:
    try:
        return function()
    except Exception as error:  # whatever a function of the user's does
        told = f"{type(error).__name__}: {in_a_line(error, str)}"
        raise ConfigurationError(f"{what} failed when it was tried: {told}") from error


def _weights(rng: np.random.Generator) -> Weights:
    return {name: rng.normal(size=shape).astype(np.float32) for name, shape in SHAPES.items()}
