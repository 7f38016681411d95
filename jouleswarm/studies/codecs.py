"""Bits that need not be sent: encodings of weights and of experience, what they cost on the wire and in rounds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from matplotlib.figure import Figure

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.energy.bill import Cost
from jouleswarm.energy.items import BITS_PER_BYTE
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import PriceList, own_lists
from jouleswarm.studies.columns import Column, Value
from jouleswarm.studies.comparison_figures import panels_figure, rounds_columns
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.kinds import Kind, Outputs
from jouleswarm.studies.prices import priced
from jouleswarm.studies.record import Record
from jouleswarm.studies.sweeps import Point, comparison_outputs, sweep


class Links(NamedTuple):
    """The links that an encoding is for: their name, bytes of a run and joules of a run."""

    name: str
    moved_bytes: Callable[[list[Fact]], float]
    joules: Callable[[Cost], float]


_LINKS = {
    "weights": Links(
        "down- and sidelinks",
        lambda run: sum(fact.downlink_bytes + fact.sidelink_bytes for fact in run),
        lambda cost: cost.downlink_j + cost.sidelink_j,
    ),
    "experience": Links(
        "uplinks",
        lambda run: sum(fact.uplink_bytes for fact in run),
        lambda cost: cost.uplink_j,
    ),
}


def codec_points(scenario: Scenario) -> list[Point]:
    """How weights are encoded between robots, and how experience is on its way up."""
    codecs = ("float32", "float16", "int8", "topk")
    points = [Point("weights", codec, (f'federation.codec="{codec}"',)) for codec in codecs]
    frames = ("raw", "png", "resized")
    return points + [Point("experience", codec, (f'meta.experience_codec="{codec}"',)) for codec in frames]


def codecs_figure(facts: Sequence[Fact], record: Record) -> Figure:
    """Rounds of unseen and of seen tasks, Gbit on the links that an encoding is for, and their joules; weights above,
    experience below."""
    own, rounds, energy = own_lists(record.lists), rounds_columns(record), record.scenario.energy
    rows = {
        what: (record.groups[what], [*rounds, *_columns(links, energy, own)])
        for what, links in _LINKS.items()
        if what in record.groups
    }
    return panels_figure(facts, record.scenario, rows, 2.3, numbered=True)


def outputs(facts: Sequence[Fact], record: Record) -> Outputs:
    """One table of all encodings, one figure."""
    made = comparison_outputs("Encodings", facts, record)
    made.figures["codecs"] = lambda: codecs_figure(facts, record)
    return made


def _columns(links: Links, energy: Energy, own: Sequence[PriceList]) -> list[Column]:
    def joules(prices: PriceList) -> Value:
        def value(run: list[Fact]) -> float | None:
            bill = priced(run, energy, prices)
            return None if bill is None or bill.both.untold_j else links.joules(bill.both)

        return value

    return [
        Column("bits", f"{links.name} (Gbit)", 1e9, lambda run: BITS_PER_BYTE * links.moved_bytes(run)),
        Column("joules", f"{links.name} (kJ)", 1e3, joules(literal)),
        *(Column(each.name, f"{links.name} (kJ),\n{each.label}", 1e3, joules(each)) for each in own),
    ]


KIND = Kind("codecs", 5, 90, partial(sweep, points=codec_points), outputs)
