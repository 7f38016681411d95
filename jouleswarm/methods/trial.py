"""A scenario's own methods, tried when it is read: what their functions make of small random weights."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.types import Weights
from jouleswarm.methods.contract import is_shipped, read_only, unfit
from jouleswarm.methods.method import DATACENTER, ClusterRound, Method, Update

SHAPES = {"0.weight": (3, 2), "0.bias": (3,)}


def try_methods(scenario: Scenario) -> None:
    """Mix, and serve, by each method that does not ship here, once with one partner and once with three.

    Raises:
        ConfigurationError: one fails, or returns what is no model of the same shapes, float32 and finite.
    """
    for named, name in zip(scenario.methods, scenario.method_names, strict=True):
        kind = type(scenario.method(name))
        if not is_shipped(kind):
            try:
                _try(kind)
            except ConfigurationError as error:
                raise ConfigurationError(f"method {named!r}: {error}") from error


def try_penalty(method: Method) -> None:
    """Try a penalty of the method's own. Loads PyTorch, so it is done by who starts processes, and by who learns.

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
        got = f"a tensor of shape {list(found.shape)}" if isinstance(found, torch.Tensor) else f"{found!r:.60}"
        raise ConfigurationError(f"{what}: got {got}, expected one finite number: a tensor without dimensions, or 0.0")


def _try(kind: type[Method]) -> None:
    rng = np.random.default_rng(0)
    _call(kind, "a call without arguments")
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
        raise ConfigurationError(f"serve: got {found!r:.60}, expected weights and the number of batch gradients")
    if wrong := unfit(found[0], SHAPES):
        raise ConfigurationError(f"serve: {wrong}")


def _call(function: Callable[[], Any], what: str) -> Any:
    try:
        return function()
    except Exception as error:  # whatever a function of the user's does
        told = " ".join(str(error).split())
        raise ConfigurationError(f"{what} failed on small random weights: {type(error).__name__}: {told}") from error


def _weights(rng: np.random.Generator) -> Weights:
    return {name: rng.normal(size=shape).astype(np.float32) for name, shape in SHAPES.items()}
