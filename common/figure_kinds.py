"""Which files figures can be. Here, so that the command line knows without loading what draws them."""

from __future__ import annotations

from collections.abc import Sequence

from jouleswarm.common.errors import ConfigurationError

KINDS = ("png", "svg")
"""Of files that are written where nobody asks for others."""
DEFAULT = ",".join(KINDS)
_ALL = (*KINDS, "pdf")


def figure_kinds(text: str) -> Sequence[str]:
    """`png,pdf` as kinds; of nothing none.

    Raises:
        ConfigurationError: one that there is not.
    """
    kinds = tuple(dict.fromkeys(each.strip().lower() for each in text.split(",") if text))
    if unknown := [each for each in kinds if each not in _ALL]:
        raise ConfigurationError(
            f"--figures {text}: got {unknown[0]!r}, expected some of {', '.join(_ALL)}, as png,pdf"
        )
    return kinds
