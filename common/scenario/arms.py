"""The arms of a run: which method, from which meta-model; and what the ground floor asks of a method."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any, NamedTuple, Protocol

from jouleswarm.common.scenario.sections import Meta

_ON_THE_WAY = re.compile(r"(.+)-t(\d+)")
_NAME = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9_.-]{0,63}")
_TAKEN = ("all", "meter")  # levels of topics that are no arm's


class AnyMethod(Protocol):
    """A method as far as a scenario depends on it (all of it: jouleswarm/methods/method.py)."""

    name: str
    partners: str
    sends: str
    stage: Any


class Arm(NamedTuple):
    """One column of a run: its name is a level of every topic."""

    name: str
    method: str
    """Name of its method."""
    t0: int
    """Rounds of meta-training behind the model that robots start from; 0 without."""


def arm_name(method: str, t0: int | None = None) -> str:
    """`maml`, or `maml-t42` for an arm that starts from the meta-model of round 42 on the way."""
    return method if t0 is None else f"{method}-t{t0}"


def method_of(arm: str) -> str:
    """The name of an arm's method, from its own; see `is_method_name`."""
    found = _ON_THE_WAY.fullmatch(arm)
    return found[1] if found else arm


def snapshot_of(arm: str) -> int | None:
    """The round on the way whose meta-model an arm starts from; None for the last one (or for none at all)."""
    found = _ON_THE_WAY.fullmatch(arm)
    return int(found[2]) if found else None


def is_method_name(name: str) -> bool:
    """Whether a method can be called so: a level of topics and of file names, that no arm on the way can be named."""
    return _NAME.fullmatch(name) is not None and snapshot_of(name) is None and name not in _TAKEN


def arms_of(methods: Iterable[type[AnyMethod]], settings: Meta) -> tuple[Arm, ...]:
    """What robots do one after the other: each method, from each meta-model that is adapted."""
    arms: list[Arm] = []
    for kind in methods:
        meta = kind.stage is not None
        on_the_way = sorted(set(settings.adapt_from) - {settings.t0}) if meta else []
        arms += [Arm(arm_name(kind.name, t0), kind.name, t0) for t0 in on_the_way]
        arms.append(Arm(kind.name, kind.name, settings.t0 if meta else 0))
    return tuple(arms)
