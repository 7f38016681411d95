"""Bits that need not be sent: encodings of weights and of experience, what they cost on the wire and in rounds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from matplotlib.figure import Figure

from jouleswarm.common.scenario.arms import method_of
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.scenario.sections import Energy
from jouleswarm.energy.equations import BITS_PER_BYTE
from jouleswarm.report.arms import method_colour
from jouleswarm.studies.arms import over_runs
from jouleswarm.studies.comparison_figures import bars, measured_variants, method_patches
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.kinds import Kind, Outputs
from jouleswarm.studies.prices import causes, runs_of, task_stages
from jouleswarm.studies.record import Record
from jouleswarm.studies.style import blank
from jouleswarm.studies.sweeps import Point, comparison_outputs, sweep

Value = Callable[[list[Fact]], float]


class Links(NamedTuple):
    """The links that an encoding is for: their name, bytes of a run and joules of a run."""

    name: str
    moved_bytes: Value
    joules: Callable[[list[Fact], Energy], float]


_LINKS = {
    "weights": Links(
        "down- and sidelinks",
        lambda run: sum(fact.downlink_bytes + fact.sidelink_bytes for fact in run),
        lambda run, energy: causes(run, energy).downlink_j + causes(run, energy).sidelink_j,
    ),
    "experience": Links(
        "uplinks",
        lambda run: sum(fact.uplink_bytes for fact in run),
        lambda run, energy: causes(run, energy).uplink_j,
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
    shown = [what for what in _LINKS if what in groups]
    figure = blank(2.3 * len(shown))
    panels = figure.subplots(len(shown), 3, squeeze=False)
    arms = list(dict.fromkeys(fact.arm for fact in facts))
    for row, what in zip(panels, shown, strict=True):
        variants = measured_variants(facts, groups[what])
        for axes, (label, value) in zip(row, _values(_LINKS[what], scenario.energy).items(), strict=True):
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


def _values(links: Links, energy: Energy) -> dict[str, Value]:
    return {
        "rounds, all tasks": lambda run: sum(fact.rounds for fact in task_stages(run)),
        f"{links.name} (Gbit)": lambda run: BITS_PER_BYTE * links.moved_bytes(run) / 1e9,
        f"{links.name} (kJ)": lambda run: links.joules(run, energy) / 1e3,
    }


KIND = Kind("codecs", 3, 90, partial(sweep, points=codec_points), outputs)
