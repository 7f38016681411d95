"""The methods that ship here, for who has a name and no scenario: facts of a study, the paper's own numbers."""

from __future__ import annotations

import functools

from jouleswarm.common.doors import SHIPPED, open_door
from jouleswarm.methods.method import Method


@functools.cache
def all_shipped() -> dict[str, Method]:
    """Each by its name, in the order that tables have them."""
    return {name: open_door("methods", name, None)() for name in SHIPPED["methods"]}


def shipped(name: str) -> Method | None:
    """The one of this name; None if it is a user's."""
    return all_shipped().get(name)
