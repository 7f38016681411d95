"""Bars, arm beside arm: energy and rounds as the paper's Fig. 3."""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.bill import Bill, Cost
from jouleswarm.energy.facts import Facts
from jouleswarm.energy.prices import PriceList, price
from jouleswarm.report.arms import INK, colours
from jouleswarm.report.canvas import FEW, LEGEND_COLUMNS, SOME, arm_patches, bars, hatched, legend_in, new_figure
from jouleswarm.report.tables import NOT_LEARNED
from jouleswarm.runs.arm_facts import in_closed_form
from jouleswarm.runs.columns import telling_lists
from jouleswarm.runs.run import Run
from jouleswarm.runs.sizes import scenario_sizes

_KILO_FROM_J = 10_000
Bars = dict[str, list[tuple[float, float]]]  # arm -> (learning, communication) joules of each bar


def energy_figure(run: Run, energy: Energy) -> Figure:
    """Fig. 3a: E_ML and E_FL(t_i), arm beside arm, and the totals; a row of panels a price list that tells causes."""
    few, lists = len(run.scenario.arms) <= FEW, telling_lists(run)
    rows = max(1, len(lists))
    figure = new_figure(2.6 * rows if few else 3.0 * rows + legend_in(len(run.scenario.arms) + 2))
    panels = figure.subplots(rows, 2, width_ratios=[4.5, 1 if few else 1.6], squeeze=False)
    for (left, right), (heading, prices) in zip(panels, lists.items(), strict=False):
        _energy_panels(left, right, run, energy, prices)
        if rows > 1:
            left.set_title(heading)
    causes = [Patch(facecolor="#bbbbbb", label="learning"), Patch(**hatched("#bbbbbb"), label="communication")]
    _legend(figure, panels[0, 0], [*arm_patches(run), *causes], few)
    return figure


def _energy_panels(left: Axes, right: Axes, run: Run, energy: Energy, prices: PriceList) -> None:
    few = len(run.scenario.arms) <= FEW
    stages_j: Bars = {arm: _stage_bars(run, arm, energy, prices) for arm in run.scenario.arm_names}
    totals: Bars = {arm: [_parted(price(prices, _facts(run, arm), energy))] for arm in run.scenario.arm_names}
    unit, factor = ("kJ", 1e3) if max(sum(held[0]) for held in totals.values()) >= _KILO_FROM_J else ("J", 1.0)
    labels = [rf"$E_\mathrm{{FL}}(t_{{{task}}})$" for task in run.scenario.clusters]
    stages = [r"$E_\mathrm{ML}$", *labels] if run.scenario.meta_methods else labels
    for axes, held, names in ((left, stages_j, stages), (right, totals, ["$E$, eq. (12)"])):
        _energy_bars(axes, held, factor, colours(run.scenario), numbered=few or axes is right)
        axes.set_xticks(range(len(names)), names)
        axes.margins(x=0.02 if axes is left else 0.25 if few else 0.05, y=0.14)
    left.set_ylabel(f"energy ({unit})")


def rounds_figure(run: Run, energy: Energy) -> Figure:
    """Fig. 3b: t0 and t_i, arm beside arm. `energy` plays no part."""
    few = len(run.scenario.arms) <= FEW
    figure = new_figure(2.4 if few else 2.8 + legend_in(len(run.scenario.arms) + 1))
    axes = figure.subplots()
    held, meta = colours(run.scenario), bool(run.scenario.meta_methods)
    for place, arm in enumerate(run.scenario.arm_names):
        values = [float(run.t0[arm])] * meta + list(run.rounds(arm).values())
        learned = [True] * meta + [result.learned for result in run.results[arm]]
        numbers = [f"{value:g}" if len(held) <= SOME else "" for value in values]
        texts = [each if done else f"{each} {NOT_LEARNED}" for each, done in zip(numbers, learned, strict=True)]
        bars(axes, place, len(held), values, held[arm], texts=texts)
    names = ["$t_0$"] * meta + [f"$t_{{{task}}}$" for task in run.scenario.clusters]
    axes.set_xticks(range(len(names)), names)
    axes.set_ylabel("rounds")
    axes.margins(x=0.02, y=0.14)
    marked = any(not result.learned for results in run.results.values() for result in results)
    unlearned = [Line2D([], [], marker="x", color=INK, linestyle="", markersize=4, label="not learned")]
    _legend(figure, axes, [*arm_patches(run), *(unlearned if marked else [])], few)
    return figure


def _stage_bars(run: Run, arm: str, energy: Energy, prices: PriceList) -> list[tuple[float, float]]:
    """(learning, communication) joules of E_ML where any arm has one, then of each task."""
    facts = _facts(run, arm)
    stages = [facts.of_ml()] if run.scenario.meta_methods else []
    stages += [facts.of_task(task) for task in run.scenario.clusters]
    return [_parted(price(prices, stage, energy)) for stage in stages]


def _facts(run: Run, arm: str) -> Facts:
    """What was counted; the closed form where nothing was."""
    facts = run.facts[arm]
    return (
        facts
        if facts.metered
        else in_closed_form(facts, run.scenario, run.mean_rounds(arm), scenario_sizes(run.scenario))
    )


def _parted(bill: Bill | None) -> tuple[float, float]:
    """Learning, acting and waiting, and what is not: nothing is drawn of an arm for which the list is not defined."""
    cost = bill.both if bill else Cost()
    moved = cost.communication_j + cost.other_j + cost.untold_j
    return cost.total_j - moved, moved


def _energy_bars(axes: Axes, found: Bars, factor: float, held: dict[str, str], *, numbered: bool) -> None:
    for place, (arm, parts) in enumerate(found.items()):
        learning, communication = ([part / factor for part in each] for each in zip(*parts, strict=True))
        totals = [sum(each) / factor for each in parts]
        texts = [f"{total:.3g}" if total < 1000 else f"{total:.0f}" for total in totals] if numbered else []
        bars(axes, place, len(found), learning, held[arm], stacked=communication, texts=texts)


def _legend(figure: Figure, axes: Axes, handles: list[Any], few: bool) -> None:
    if few:
        axes.legend(handles=handles, ncols=2, loc="best")
    else:
        figure.legend(handles=handles, ncols=LEGEND_COLUMNS, loc="outside upper center")
