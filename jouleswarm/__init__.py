"""The house of JouleSwarm: docs/architecture.md shows its rooms."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jouleswarm.learning.qnetwork import QNetwork as QNetwork


def __getattr__(name: str) -> Any:
    """What others build on, loaded when it is asked for: `import jouleswarm` costs nothing."""
    if name == "QNetwork":
        from jouleswarm.learning.qnetwork import QNetwork

        return QNetwork
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
