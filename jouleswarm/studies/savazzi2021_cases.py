"""What centralized learning, FL by a server and consensus FL cost, against efficiencies and by who pays. Pure.

Prices are those of eqs. (9) and (11), and gamma on all that the base station sends.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from statistics import fmean
from typing import NamedTuple

from jouleswarm.common.errors import StudyError
from jouleswarm.common.scenario.countries import intensities
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.carbon import JOULES_PER_KWH
from jouleswarm.energy.closed_form import TABLE_I
from jouleswarm.energy.crossing import NOTHING, Footprint
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.prices import cost_of, runs_of

METHODS = {"fl": "consensus FL", "fedavg": "FL by a server", "centralized": "centralized"}
COUNTRIES = ("NO", "FI", "IT", "DE", "PL")
_RESIZED = 96 * 72 / (640 * 480)  # pixels of the full-size network's input over a frame's, as in scenario `paper`
CASES = {"counted": "as counted", "paper": "Table I's weights", "resized": "Table I's weights, frames resized"}


class Sites(NamedTuple):
    """Joules of an arm by who pays."""

    robots: Footprint
    datacenter: Footprint

    def weighted(self, robots: float = 1.0, datacenter: float = 1.0) -> Footprint:
        """The sum of both; grams where the weights are gCO2e a joule."""
        return NOTHING.plus(self.robots, robots).plus(self.datacenter, datacenter)


Case = Mapping[str, list[Sites]]
"""Method -> its arm seed by seed."""


def sites_of(run: Sequence[Fact], energy: Energy) -> Sites:
    """An arm of one run by literal prices, and gamma on the downlink too; E_DL keeps its ratio to E_UL."""
    cost, ul, sl = cost_of(run, energy), energy.ul_bit_per_j, energy.sl_bit_per_j
    down_j = (energy.base_station_pue or energy.pue) * cost.downlink_j
    if energy.sidelink == "direct":
        robots = Footprint(cost.computing_robots_j, ul * cost.uplink_j, sl * cost.sidelink_robots_j)
    else:
        robots = Footprint(cost.computing_robots_j, ul * (cost.uplink_j + cost.sidelink_robots_j), 0.0)
        down_j += cost.sidelink_datacenter_j  # has its gamma
    return Sites(robots, Footprint(cost.computing_datacenter_j, ul * down_j, 0.0))


def cases(facts: Sequence[Fact], energy: Energy) -> dict[str, Case]:
    """The three methods by whose bytes: as they were counted; weights of Table I; those and frames shrunk on the robot.

    Raises:
        StudyError: a method has no facts, or not the same seeds as the others.
    """
    runs = {method: runs_of(facts, "", method) for method in METHODS}
    seeds = {method: tuple(found) for method, found in runs.items()}
    if not all(seeds.values()) or len(set(seeds.values())) > 1:
        got = ", ".join(f"{method} {len(found)}" for method, found in seeds.items())
        raise StudyError(
            f"got seeds of {got}; expected the same of each, and one or more: `jouleswarm study baselines`"
        )
    links = [fact for run in runs["fl"].values() for fact in run]
    weights = TABLE_I.weights_bytes / (sum(f.sidelink_bytes for f in links) / sum(f.links * f.rounds for f in links))
    factors = {"counted": (1.0, 1.0), "paper": (weights, 1.0), "resized": (weights, _RESIZED)}
    return {
        case: {
            method: [sites_of([_sized(fact, *factor) for fact in run], energy) for run in found.values()]
            for method, found in runs.items()
        }
        for case, factor in factors.items()
    }


def mean(runs: Sequence[Footprint]) -> Footprint:
    """Over seeds."""
    return Footprint(*(fmean(values) for values in zip(*runs, strict=True)))


def totals(case: Case, robots: float = 1.0, datacenter: float = 1.0) -> dict[str, Footprint]:
    """Method -> its mean footprint over seeds, sites weighted."""
    return {method: mean([each.weighted(robots, datacenter) for each in runs]) for method, runs in case.items()}


def cheapest(found: Mapping[str, Footprint], ul_bit_per_j: float, sl_bit_per_j: float) -> str:
    """The method that costs least; the first of those that cost the same."""
    return min(found, key=lambda method: found[method].at(ul_bit_per_j, sl_bit_per_j))


def grams(robots: str, datacenter: str) -> tuple[float, float]:
    """gCO2e a joule at both sites, by country."""
    return intensities()[robots] / JOULES_PER_KWH, intensities()[datacenter] / JOULES_PER_KWH


def _sized(fact: Fact, weights: float, frames: float) -> Fact:
    """The fact with other sizes of what was sent; what goes up is frames where the data center learns, else weights."""
    up = frames if fact.method == "centralized" else weights
    names = "downlink_bytes", "sidelink_bytes", "sidelink_sent_bytes"
    sizes = {name: weights * getattr(fact, name) for name in names}
    return fact.model_copy(update=sizes | {"uplink_bytes": up * fact.uplink_bytes})
