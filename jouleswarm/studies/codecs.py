"""Bits that need not be sent: encodings of weights and of experience, what they cost on the wire and in rounds."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from matplotlib.figure import Figure

from jouleswarm.common.scenario.arms import method_of
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.energy.bill import Cost
from jouleswarm.energy.items import BITS_PER_BYTE
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import PriceList, own_lists, price_lists
from jouleswarm.report.arms import method_colour
from jouleswarm.studies.arms import over_runs
from jouleswarm.studies.comparison_figures import bars, measured_variants, method_patches
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.kinds import Kind, Outputs
from jouleswarm.studies.prices import priced, runs_of, task_stages
from jouleswarm.studies.record import Record
from jouleswarm.studies.style import blank
from jouleswarm.studies.sweeps import Point, comparison_outputs, sweep

Value = Callable[[list[Fact]], float]


class Links(NamedTuple):
    """The links that an encoding is for: their name, bytes of a run and joules of a run."""

    name: str
    moved_bytes: Value
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


def codecs_figure(facts: Sequence[Fact], scenario: Scenario, groups: dict[str, dict[str, str]]) -> Figure:
    """Rounds, Gbit on the links that an encoding is for, and their joules; weights above, experience below."""
    shown, own = [what for what in _LINKS if what in groups], own_lists(price_lists(scenario))
    figure = blank(2.3 * len(shown))
    panels = figure.subplots(len(shown), 3 + len(own), squeeze=False)
    arms = list(dict.fromkeys(fact.arm for fact in facts))
    for row, what in zip(panels, shown, strict=True):
        variants = measured_variants(facts, groups[what])
        for axes, (label, value) in zip(row, _values(_LINKS[what], scenario.energy, own).items(), strict=True):
            for place, arm in enumerate(arms):
                found = [over_runs(runs_of(facts, variant, arm), value) for variant in variants.values()]
                drawn = bars(axes, place, len(arms), found, method_colour(scenario, method_of(arm)))
                axes.bar_label(drawn, fmt="%.3g", fontsize=5.5, padding=1)
            axes.set_xticks(range(len(variants)), list(variants))
            axes.set_xlabel(what)
            axes.set_ylabel(label)
    figure.legend(handles=method_patches(scenario, arms), loc="outside upper right", ncols=len(arms))
    return figure


def outputs(facts: Sequence[Fact], record: Record) -> Outputs:
    """One table of all encodings, one figure."""
    made = comparison_outputs("Encodings", facts, record)
    made.figures["codecs"] = lambda: codecs_figure(facts, record.scenario, record.groups)
    return made


def _values(links: Links, energy: Energy, own: Sequence[PriceList]) -> dict[str, Value]:
    def kilojoules(prices: PriceList) -> Value:
        def value(run: list[Fact]) -> float:
            bill = priced(run, energy, prices)
            return math.nan if bill is None or bill.both.untold_j else links.joules(bill.both) / 1e3

        return value

    return {
        "rounds, all tasks": lambda run: sum(fact.rounds for fact in task_stages(run)),
        f"{links.name} (Gbit)": lambda run: BITS_PER_BYTE * links.moved_bytes(run) / 1e9,
        f"{links.name} (kJ)": kilojoules(literal),
        **{f"{links.name} (kJ),\n{each.label}": kilojoules(each) for each in own},
    }


KIND = Kind("codecs", 3, 90, partial(sweep, points=codec_points), outputs)
