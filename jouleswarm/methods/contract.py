"""What a method must be, seen when a scenario is loaded: its class, and its functions tried on small random weights."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any, get_args

import numpy as np

from jouleswarm.codecs.codec import Array, Shapes, Weights
from jouleswarm.common.doors import SHIPPED
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.arms import is_method_name
from jouleswarm.methods.method import DATACENTER, ClusterRound, Method, Partners, Sends, Update

_SHAPES = {"0.weight": (3, 2), "0.bias": (3,)}
_COLOUR = re.compile(r"#[0-9A-Fa-f]{6}")


def keep(found: Any, what: str) -> None:
    """Hold what came in by the door against the contract; `what` names it in errors.

    Raises:
        ConfigurationError: it is no method, says something of itself that cannot be, or fails on small weights.
    """
    if not (isinstance(found, type) and issubclass(found, Method)):
        got = f"class {found.__name__}" if isinstance(found, type) else f"{type(found).__name__} {found!r:.60}"
        raise ConfigurationError(f"{what}: got {got}, expected a class that extends jouleswarm.methods.method.Method")
    if wrong := _wrong(found):
        raise ConfigurationError(f"{what}: {wrong}")


def try_penalty(method: Method) -> None:
    """Try a penalty of the method's own. Loads PyTorch, so it is done by who starts or is a process that learns.

    Raises:
        ConfigurationError: it fails, or returns neither a number nor a finite tensor without dimensions.
    """
    if type(method).penalty is Method.penalty:
        return
    import torch

    rng = np.random.default_rng(0)
    params, start = (
        {name: torch.from_numpy(each).requires_grad_() for name, each in _weights(rng).items()} for _ in range(2)
    )
    found = _call(lambda: method.penalty(params, start), f"method {method.name!r}: penalty")
    is_number = isinstance(found, torch.Tensor) and found.ndim == 0 and bool(torch.isfinite(found))
    if not (is_number or isinstance(found, int | float)):
        raise ConfigurationError(
            f"method {method.name!r}: penalty returned {found!r:.60}, expected one finite number: a tensor of no "
            "dimensions, or 0.0"
        )


def unfit(found: Any, shapes: Shapes) -> str:
    """What is wrong with weights that are to be of these shapes; "" if nothing is."""
    if not isinstance(found, Mapping) or set(found) != set(shapes):
        got = ", ".join(map(str, found)) if isinstance(found, Mapping) else f"{type(found).__name__}"
        return f"got {got:.80}, expected a dict of {', '.join(shapes)}"
    for name, shape in shapes.items():
        array = found[name]
        if not isinstance(array, np.ndarray) or array.shape != tuple(shape) or array.dtype != np.float32:
            got = f"{array.dtype} {list(array.shape)}" if isinstance(array, np.ndarray) else type(array).__name__
            return f"{name} is {got}, expected float32 {list(shape)}"
        if not np.isfinite(array).all():
            return f"{name} is not finite"
    return ""


def read_only(weights: Mapping[str, Array]) -> Weights:
    """The same weights, not to be written to; no copy is made."""
    seen = {name: array.view() for name, array in weights.items()}
    for array in seen.values():
        array.flags.writeable = False
    return seen


def _wrong(kind: type[Method]) -> str:
    name = kind.name
    if kind.__module__.split(".")[:2] == ["jouleswarm", "methods"]:
        return ""
    if not isinstance(name, str) or not is_method_name(name):
        return (
            f'its name is {name!r:.60}, expected letters, digits, _ - and ., such as name = "median", and no ending -t '
            "and a number"
        )
    if name in SHIPPED["methods"]:
        return f"its name is {name}, which is that of a method that ships here; give it one of its own"
    if not isinstance(kind.label, str) or not isinstance(kind.colour, str) or not _COLOUR.fullmatch(kind.colour):
        return f"its label and colour are {kind.label!r} and {kind.colour!r}, expected a text and #RRGGBB"
    for attribute, kinds in (("partners", get_args(Partners)), ("sends", get_args(Sends))):
        if getattr(kind, attribute) not in kinds:
            return f"its {attribute} is {getattr(kind, attribute)!r}, expected one of {', '.join(kinds)}"
    if kind.sends == "experience" and (kind.partners != "datacenter" or kind.serve is Method.serve):
        return 'it sends experience, expected partners = "datacenter" and a function serve(round_) that learns from it'
    try:
        _try(kind)
    except ConfigurationError as error:
        return str(error)
    return ""


def _try(kind: type[Method]) -> None:
    """Mix, and serve, once with one partner and once with three."""
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
    for lossy in (False, True):

        def mixed(lossy: bool = lossy) -> Weights:
            method = kind()
            return method.mix_lossy(own, own, theirs, 0.5) if lossy else method.mix(own, theirs, 0.5)

        first = _call(mixed, "mix")
        if wrong := unfit(first, _SHAPES):
            raise ConfigurationError(f"mix: {wrong}")
        again = mixed()
        if any(first[name].tobytes() != again[name].tobytes() for name in own):
            raise ConfigurationError("mix: twice from the same models other weights, expected the same on any machine")


def _try_to_serve(kind: type[Method], round_: ClusterRound) -> None:
    found = _call(lambda: kind().serve(round_), "serve")
    if not isinstance(found, tuple) or len(found) != 2 or not isinstance(found[1], int):
        raise ConfigurationError(f"serve: got {found!r:.60}, expected weights and the number of batch gradients")
    if wrong := unfit(found[0], _SHAPES):
        raise ConfigurationError(f"serve: {wrong}")


def _call(function: Callable[[], Any], what: str) -> Any:
    try:
        return function()
    except Exception as error:  # whatever a function of the user's does
        told = " ".join(str(error).split())
        raise ConfigurationError(f"{what} failed on small random weights: {type(error).__name__}: {told}") from error


def _weights(rng: np.random.Generator) -> Weights:
    return {name: rng.normal(size=shape).astype(np.float32) for name, shape in _SHAPES.items()}
