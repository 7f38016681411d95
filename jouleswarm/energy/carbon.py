"""Grams of CO2 equivalent: joules times the carbon intensity of the electricity where, and when, they were spent."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from typing import NamedTuple

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.links import DATA_CENTER
from jouleswarm.energy.bill import Bill, Cost
from jouleswarm.energy.facts import Facts, UnknownFactError
from jouleswarm.energy.items import Item, items
from jouleswarm.energy.prices import with_beta
from jouleswarm.energy.times import times

JOULES_PER_KWH = 3.6e6
_HOUR_S = 3600.0


class Carbon(NamedTuple):
    """Grams of CO2 equivalent by site; None where the intensity is not known, which is not nothing."""

    datacenter_g: float | None
    robots_g: float | None

    @property
    def total_g(self) -> float | None:
        """Both sites, if both are known."""
        if self.datacenter_g is None or self.robots_g is None:
            return None
        return self.datacenter_g + self.robots_g


def has_carbon(energy: Energy) -> bool:
    """Whether any site has an intensity, so that there is something to show."""
    sites = energy.intensity_of(DATA_CENTER), energy.intensity_of(None)
    return energy.has_own_carbon or bool(energy.hours) or any(each is not None for each in sites)


def carbon(cost: Cost | Bill, energy: Energy) -> Carbon:
    """`cost` in grams: J / 3.6e6 (J/kWh) x g/kWh at each site; not known where the price list tells no sites."""
    if (cost.both if isinstance(cost, Bill) else cost).untold_j:
        return Carbon(None, None)
    return Carbon(
        datacenter_g=_grams(cost.datacenter_j, energy.datacenter_g_per_kwh),
        robots_g=_grams(cost.robots_j, energy.robots_g_per_kwh),
    )


def at_sites(energy: Energy, facts: Facts | None = None) -> Energy:
    """`energy` with one intensity a site, for `carbon`: its number, else its country's, else that of the hours.

    Where robots have intensities of their own, or hours count, it is the mean over what the arm of these `facts` spent
    there by the literal list: each phase and task evenly over its seconds (`energy.times`), from `energy.start_hour`
    on. Without facts, flows or seconds the mean of all hours.
    """
    flat = [_intensity(energy, who, None) for who in (DATA_CENTER, None)]
    if facts is not None and (energy.has_own_carbon or energy.hours):
        with suppress(UnknownFactError):  # of sums alone nobody knows whose and when
            flat = _spent(with_beta(energy, facts), facts, flat)
    return energy.model_copy(update={"datacenter_g_per_kwh": flat[0], "robots_g_per_kwh": flat[1]})


def mean_of_hours(hours: tuple[float, ...], begin_s: float, end_s: float) -> float:
    """Mean intensity from `begin_s` to `end_s`, in seconds from hour 0; the table comes again and again."""

    def summed(until_s: float) -> float:
        cycles, rest_s = divmod(until_s, len(hours) * _HOUR_S)
        whole = min(int(rest_s // _HOUR_S), len(hours) - 1)
        return cycles * sum(hours) + sum(hours[:whole]) + hours[whole] * (rest_s / _HOUR_S - whole)

    if end_s <= begin_s:
        return hours[int(begin_s // _HOUR_S) % len(hours)]
    return (summed(end_s) - summed(begin_s)) * _HOUR_S / (end_s - begin_s)


Span = tuple[float, float]


def _spent(energy: Energy, facts: Facts, flat: list[float | None]) -> list[float | None]:
    """The means of both sites over an arm's items."""
    spans, paid = _spans(energy, facts), list(items(facts, energy))
    here: list[list[Item]] = [[], []]
    for item in paid:
        here[item.payer != DATA_CENTER].append(item)
    return [_mean(energy, each, spans, otherwise) for each, otherwise in zip(here, flat, strict=True)]


def _mean(energy: Energy, paid: Iterable[Item], spans: dict[int | None, Span], otherwise: float | None) -> float | None:
    joules = weighted = 0.0
    for item in paid:
        when = spans.get(None if item.phase == "ml" else item.task)
        if (g_per_kwh := _intensity(energy, item.payer, when)) is None and item.joules:
            return None
        joules, weighted = joules + item.joules, weighted + item.joules * (g_per_kwh or 0.0)
    return weighted / joules if joules else otherwise


def _intensity(energy: Energy, who: int | None, when: Span | None) -> float | None:
    if (found := energy.intensity_of(who)) is not None or not energy.hours:
        return found
    return sum(energy.hours) / len(energy.hours) if when is None else mean_of_hours(energy.hours, *when)


def _spans(energy: Energy, facts: Facts) -> dict[int | None, Span]:
    """When each task was learned, and under None the stage; empty where seconds are not known."""
    found, begin_s = times(facts, energy), energy.start_hour * _HOUR_S
    told = {task: each.total_s for task, each in found.tasks.items()}
    ml_s = 0.0 if found.ml is None else found.ml.total_s
    if ml_s is None:
        return {}
    then_s = begin_s + ml_s
    tasks: dict[int | None, Span] = {
        task: (then_s, then_s + lasts) for task, lasts in told.items() if lasts is not None
    }
    return tasks | {None: (begin_s, then_s)}


def _grams(joules: float, g_per_kwh: float | None) -> float | None:
    return None if g_per_kwh is None else joules / JOULES_PER_KWH * g_per_kwh
