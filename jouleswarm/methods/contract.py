"""What a method must be: what its class says of itself, and what its functions return."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any, get_args

import numpy as np

from jouleswarm.common.doors import SHIPPED
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.arms import is_method_name
from jouleswarm.common.wire.types import Array, Shapes, Weights
from jouleswarm.methods.method import Method, Partners, Sends

_COLOUR = re.compile(r"#[0-9A-Fa-f]{6}")


def keep(found: Any, what: str) -> None:
    """Hold what came in by the door against the contract; `what` names it in errors.

    Raises:
        ConfigurationError: it is no method, or says something of itself that cannot be.
    """
    if not (isinstance(found, type) and issubclass(found, Method)):
        got = f"class {found.__name__}" if isinstance(found, type) else f"{type(found).__name__} {in_a_line(found)}"
        raise ConfigurationError(f"{what}: got {got}, expected a class that extends jouleswarm.Method")
    if is_shipped(found):
        return
    if wrong := _wrong(found):
        raise ConfigurationError(f"{what}: {wrong}")
    try:
        found()
    except Exception as error:  # whatever a class of the user's does
        told = f"{type(error).__name__}: {in_a_line(str(error), str)}"
        raise ConfigurationError(f"{what}: cannot be made without arguments: {told}") from error


def is_shipped(kind: type[Method]) -> bool:
    """Whether it is one of ours."""
    return kind.__module__.split(".")[:2] == ["jouleswarm", "methods"]


def in_a_line(value: Any, as_text: Callable[[Any], str] = repr) -> str:
    """Whatever it is, short and without line ends."""
    return " ".join(as_text(value).split())[:200]


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
    name: Any = kind.name
    if not isinstance(name, str) or not is_method_name(name):
        return (
            f'its name is {in_a_line(name)}, expected letters, digits, _ - and ., such as name = "median", and no '
            "ending -t and a number"
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
    return ""
