"""A meta-model with a last layer for each training task: names on the wire, and which layers a robot starts from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:  # a report needs no torch
    from torch import nn

T = TypeVar("T")


def head_of(model: nn.Sequential) -> tuple[str, ...]:
    """Names of the last child's parameters."""
    last = [name for name, _ in model.named_children()][-1]
    return tuple(name for name, _ in model.named_parameters() if name.split(".")[0] == last)


def head_key(task: int, name: str) -> str:
    """Name of a task's own copy of a last layer's parameter."""
    return f"task{task}/{name}"


def meta_shapes(
    shapes: Mapping[str, tuple[int, ...]], head: Sequence[str], tasks: Sequence[int]
) -> dict[str, tuple[int, ...]]:
    """Names and shapes of a meta-model with heads for `tasks` (none: the network's own)."""
    return {**shapes, **{head_key(task, name): shapes[name] for task in tasks for name in head}}


def start_of(meta_model: Mapping[str, T], task: int) -> dict[str, T]:
    """The network that robots of `task` start from: with the task's own head where there is one, else the mean's."""
    own: dict[str, Any] = {}
    network = {}
    for name, value in meta_model.items():
        if name.startswith(head_key(task, "")):
            own[name.removeprefix(head_key(task, ""))] = value
        elif "/" not in name:
            network[name] = value
    return {name: own.get(name, value) for name, value in network.items()}
