"""A user's table of links: what each costs, and how fast it is."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Annotated, Self

from pydantic import BeforeValidator, Field, ValidationError, model_validator

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.bounds import BitRate, Efficiency, Joules, Loss
from jouleswarm.common.scenario.sections import Section
from jouleswarm.common.scenario.tables import first_error, table_lines

DATA_CENTER = 0
"""In place of a robot's number."""


def _number(cell: object) -> object:
    return DATA_CENTER if cell == "datacenter" else cell


_Node = Annotated[int, BeforeValidator(_number), Field(ge=0, le=1_000_000)]


class LinkConstants(Section):
    """One directed link."""

    bit_per_j: Efficiency | None = None
    """None: relayed."""
    j_per_message: Joules = 0.0
    bit_per_s: BitRate | None = None
    loss: Loss = 0.0
    via: _Node | None = None
    """Who passes on what goes over it, 0 for the base station; the two links that it goes over have the costs."""

    @model_validator(mode="after")
    def _is_direct_or_relayed(self) -> Self:
        if (self.bit_per_j is None) == (self.via is None):
            raise ValueError("expected bit_per_j of a direct link, or via of a relayed one")
        return self


class _Line(LinkConstants):
    sender: _Node = Field(alias="from")
    receiver: _Node = Field(alias="to")


Links = Mapping[tuple[int, int], LinkConstants]
"""(sender, receiver) -> its constants; 0 is the data center."""


def read_links(path: Path, robots: Collection[int]) -> dict[tuple[int, int], LinkConstants]:
    """A CSV table of columns from, to, bit_per_j and, where wanted, j_per_message, bit_per_s, loss, via.

    Ends are robots' numbers or `datacenter`; an empty cell is the column's default.

    Raises:
        ConfigurationError: it cannot be read, a number is out of bounds, a robot does not exist, or a link stands
            there twice.
    """
    links: dict[tuple[int, int], LinkConstants] = {}
    for number, cells in table_lines(path, "energy.links", ("from", "to", "bit_per_j")):
        where = f"energy.links {path}, line {number}"
        try:
            line = _Line.model_validate(cells)
        except ValidationError as error:
            raise ConfigurationError(f"{where}: {first_error(error)}") from None
        ends = line.sender, line.receiver
        if unknown := [end for end in (*ends, line.via or DATA_CENTER) if end != DATA_CENTER and end not in robots]:
            raise ConfigurationError(f"{where}: robot {unknown[0]} does not exist, expected one of {_told(robots)}")
        if line.sender == line.receiver or ends in links:
            raise ConfigurationError(f"{where}: {_way(ends)}: expected each link once, between two")
        links[ends] = LinkConstants(**line.model_dump(exclude={"sender", "receiver"}))
    for (sender, receiver), link in links.items():
        for hop in () if link.via is None else ((sender, link.via), (link.via, receiver)):
            if hop not in links or links[hop].via is not None:
                way, needed = _way((sender, receiver)), _way(hop)
                raise ConfigurationError(f"energy.links {path}: {way} needs a direct link {needed}, expected its line")
    return links


def missing(links: Links, sender: int, receiver: int) -> ConfigurationError:
    """What to say of a link that carried something and is not in the table."""
    return ConfigurationError(
        f"energy.links: no line for the link {_way((sender, receiver))}, which carried messages; expected one of "
        f"{len(links)} lines to be it"
    )


def _way(ends: tuple[int, int]) -> str:
    return " to ".join("datacenter" if end == DATA_CENTER else str(end) for end in ends)


def _told(robots: Collection[int]) -> str:
    return f"{min(robots)} to {max(robots)}"
