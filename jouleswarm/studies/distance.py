"""Sidelinks direct against via the base station as that moves away, by the price list `distance`. Nothing is run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from statistics import fmean
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from jouleswarm.common.scenario.links import DATA_CENTER
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.names import client_of
from jouleswarm.common.wire.topics import Link
from jouleswarm.energy.distance import bit_per_s, distance
from jouleswarm.energy.facts import Facts, Flow
from jouleswarm.energy.items import Item, items
from jouleswarm.methods.graph import task_graph
from jouleswarm.report.canvas import new_figure
from jouleswarm.report.look import looks_of
from jouleswarm.report.table import Table
from jouleswarm.runs.sizes import scenario_sizes
from jouleswarm.studies.kinds import Outputs, write_outputs
from jouleswarm.studies.style import COLOURS

_FARS_M = np.geomspace(1, 1000, 61)


class Point(NamedTuple):
    """One round of the first task's cluster, each robot's weights to each neighbour."""

    base_station_m: float
    """From the middle of the cluster, across the x axis."""
    direct_j: float
    via_j: float
    """Up once a message, down to each neighbour; gamma included."""
    up_j: float
    """Of that, the way up."""
    up_bit_per_s: float
    """Of the first robot."""


def points(scenario: Scenario) -> list[Point]:
    """What a round costs with the base station ever further away.

    Raises:
        ConfigurationError: a robot has no position.
    """
    cluster = next(iter(scenario.clusters.values()))
    places = [scenario.energy.place(robot) for robot in cluster]
    x, y = (fmean(place[axis] for place in places) for axis in (0, 1))
    facts, found = _round(scenario), []
    for far in map(float, _FARS_M):
        radio = scenario.energy.distance.model_copy(update={"base_station_m": (x, y + far)})
        energy = scenario.energy.model_copy(update={"distance": radio, "sidelink": "direct"})
        via = energy.model_copy(update={"sidelink": "via_base_station"})
        direct, relayed = (list(items(facts, each, distance.send, distance.receive)) for each in (energy, via))
        up = [item for item in relayed if item.ends is not None and item.ends[1] == DATA_CENTER]
        sums = _joules(direct), _joules(relayed), _joules(up)
        found.append(Point(far, *sums, bit_per_s(energy, cluster[0], DATA_CENTER)))
    return found


def crossing_m(found: Sequence[Point]) -> float | None:
    """How far away the base station is when going via it begins to cost more; None: never or from the start."""
    more = np.log([point.via_j / point.direct_j for point in found])
    if not more[0] < 0 < more[-1]:
        return None
    at = int(np.argmax(more > 0))
    pair = slice(at - 1, at + 1)
    return float(np.exp(np.interp(0.0, more[pair], np.log([point.base_station_m for point in found[pair]]))))


def verdict(found: Sequence[Point]) -> str:
    """Where going via the base station costs less, in words."""
    crossing, ends = crossing_m(found), f"{found[0].base_station_m:g} to {found[-1].base_station_m:g} m"
    if crossing is not None:
        return f"via the base station costs less where it is nearer than {crossing:.3g} m"
    return f"via the base station costs {'less' if found[0].via_j < found[0].direct_j else 'more'} from {ends}"


def study_distance(scenario: Scenario, folder: Path) -> tuple[str, list[Path]]:
    """The verdict, and what was written: `distance.csv` and the figure.

    Raises:
        ConfigurationError: a robot has no position.
        StudyError: a file cannot be written.
    """
    found = points(scenario)
    table = Table("Sidelinks by distance", Point._fields, [tuple(point) for point in found])
    return verdict(found), write_outputs(folder, Outputs({"distance": table}, {}, {"distance": lambda: _draw(found)}))


def _round(scenario: Scenario) -> Facts:
    task = scenario.tasks[0].id
    size, edges = scenario_sizes(scenario).weights_bytes, task_graph(scenario, task).edges
    pairs = [pair for one, other in edges for pair in ((one, other), (other, one))]
    flows = [Flow("fl", task, Link.SIDELINK, client_of(one), client_of(other), 1, size, size) for one, other in pairs]
    sent = [Flow("fl", task, Link.SIDELINK, client_of(robot), "", 1, size, size) for robot in scenario.cluster(task)]
    return Facts("", "fl", 0, {}, known_flows=tuple(flows), known_work=(), known_sent=tuple(sent))


def _joules(found: Sequence[Item]) -> float:
    return sum(item.joules for item in found)


def _draw(found: Sequence[Point]) -> Figure:
    figure, fars = new_figure(3.0), [point.base_station_m for point in found]
    axes = figure.subplots()
    lines = {"direct": "direct_j", "via the base station": "via_j", "of it, the way up": "up_j"}
    for one, (label, field) in zip(looks_of(COLOURS), lines.items(), strict=False):
        joules = [getattr(point, field) for point in found]
        axes.loglog(fars, joules, linestyle=one.line, color=one.colour, label=label)
    if (crossing := crossing_m(found)) is not None:
        axes.axvline(crossing, color=COLOURS[-1], linewidth=0.8, linestyle="--")
        axes.annotate(f" {crossing:.3g} m", (crossing, 0.03), xycoords=("data", "axes fraction"))
    axes.set_xlabel("from the cluster to the base station (m)")
    axes.set_ylabel("sidelinks of a round (J)")
    axes.legend()
    return figure
