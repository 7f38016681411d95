"""How things are told apart in drawings: by colour, and in grey print by hatch, line and marker."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

_HATCHES = ("", "xxxx", "----", "||||", "\\\\\\\\", "++++", "..", "oo", "**")
_LINES: tuple[Any, ...] = ("-", "--", "-.", ":", (0, (6, 1.5, 1, 1.5, 1, 1.5)), (0, (9, 2)), (0, (3, 1)))
_MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">")
_COMMUNICATION = "/////"
"""No arm's own."""
_LIGHT = 0.35


class Look(NamedTuple):
    """One thing's look; those of a drawing's first things are alike in nothing."""

    colour: str
    hatch: str = ""
    line: Any = "-"
    marker: str = "o"

    @property
    def face(self) -> dict[str, Any]:
        """Of a bar or a patch: hatches are white on the colour."""
        return {"facecolor": self.colour, "edgecolor": "white", "hatch": self.hatch, "linewidth": 0}


def look(place: int, colour: str) -> Look:
    """The look of the thing at a place, from 0."""
    hatch, line, marker = (held[place % len(held)] for held in (_HATCHES, _LINES, _MARKERS))
    return Look(colour, hatch, line, marker)


def looks_of(colours: Sequence[str]) -> list[Look]:
    """Looks of things in their order."""
    return [look(place, colour) for place, colour in enumerate(colours)]


def hatched(colour: str) -> dict[str, Any]:
    """The look of communication, for a bar or a patch.

    Its face is opaque: matplotlib's SVG writer drops the transparency of a hatched one, and the hatch with it.
    """
    return {"facecolor": tint(colour, _LIGHT), "edgecolor": colour, "hatch": _COMMUNICATION, "linewidth": 0}


def tint(colour: str, strength: float) -> str:
    """So much of a colour `#rrggbb` on white."""
    parts = (int(colour[at : at + 2], 16) for at in (1, 3, 5))
    return "#" + "".join(f"{round(255 - strength * (255 - part)):02x}" for part in parts)


def dashes(line: Any) -> str:
    """A line as SVG's `stroke-dasharray`."""
    named = {"-": "", "--": "6 3", "-.": "7 2 1.5 2", ":": "1.5 2"}
    return named[line] if isinstance(line, str) else " ".join(f"{each:g}" for each in line[1])
