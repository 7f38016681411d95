"""Bars, arm beside arm: energy and rounds as the paper's Fig. 3; stage and tasks on scales of their own."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.bill import Bill, Cost
from jouleswarm.energy.facts import Facts
from jouleswarm.energy.prices import PriceList, price
from jouleswarm.report.arms import INK, looks
from jouleswarm.report.canvas import FEW, LEGEND_COLUMNS, SOME, arm_patches, bars, legend_in, new_figure
from jouleswarm.report.look import Look, hatched
from jouleswarm.report.tables import NOT_LEARNED
from jouleswarm.runs.arm_facts import in_closed_form
from jouleswarm.runs.columns import telling_lists
from jouleswarm.runs.run import Run
from jouleswarm.runs.sizes import scenario_sizes

_KILO_FROM_J = 10_000
_TIGHT = 4
"""With more tasks numbers would touch those beside."""
Bars = dict[str, list[tuple[float, float]]]  # arm -> (learning, communication) joules of each bar


def energy_figure(run: Run, energy: Energy) -> Figure:
    """Fig. 3a: E_ML, E_FL(t_i) and E, arm beside arm, each on a scale of its own; a row of panels a price list that
    tells causes."""
    few, lists = len(run.scenario.arms) <= FEW, telling_lists(run)
    rows = max(1, len(lists))
    figure = new_figure(2.8 * rows + legend_in(len(run.scenario.arms) + 2) if few else 3.4 * rows)
    widths = _widths(run, few)
    panels = figure.subplots(rows, len(widths), width_ratios=widths, squeeze=False)
    for row, (heading, prices) in zip(panels, lists.items(), strict=False):
        _energy_panels(list(row), run, energy, prices)
        if rows > 1:
            row[-2].set_title(heading)
    causes = [Patch(facecolor="#bbbbbb", label="learning"), Patch(**hatched("#bbbbbb"), label="communication")]
    figure.legend(handles=[*arm_patches(run), *causes], ncols=LEGEND_COLUMNS, loc="outside upper center")
    return figure


def _widths(run: Run, few: bool) -> list[float]:
    """Of the panels of the stage, where any arm has one, of the tasks, and of the whole."""
    one = 1.0 if few else 1.6
    return [one] * bool(run.scenario.meta_methods) + [max(1.5, 0.75 * len(run.scenario.clusters)), one]


def _energy_panels(panels: list[Axes], run: Run, energy: Energy, prices: PriceList) -> None:
    arms, tasks = run.scenario.arm_names, list(run.scenario.clusters)
    whole: Bars = {arm: [_parted(price(prices, _facts(run, arm), energy))] for arm in arms}
    unit, factor = ("kJ", 1e3) if max(sum(held[0]) for held in whole.values()) >= _KILO_FROM_J else ("J", 1.0)
    of_tasks: Bars = {arm: _priced(energy, prices, [_facts(run, arm).of_task(task) for task in tasks]) for arm in arms}
    drawn = [(of_tasks, [rf"$E_\mathrm{{FL}}(t_{{{task}}})$" for task in tasks]), (whole, ["$E$, eq. (12)"])]
    if run.scenario.meta_methods:
        stage: Bars = {arm: _priced(energy, prices, [_facts(run, arm).of_ml()]) for arm in arms}
        drawn.insert(0, (stage, [r"$E_\mathrm{ML}$"]))
    for axes, (held, names) in zip(panels, drawn, strict=True):
        numbered = len(arms) <= FEW or (len(names) == 1 and len(arms) <= SOME)
        _energy_bars(axes, held, factor, looks(run.scenario), numbered=numbered)
        axes.set_xticks(range(len(names)), names)
        axes.margins(x=0.03, y=0.14)
        if len(names) == 1:
            axes.set_xlim(-0.6, 0.6)
    panels[0].set_ylabel(f"energy ({unit})")


def rounds_figure(run: Run, energy: Energy) -> Figure:
    """Fig. 3b: t0 and t_i, arm beside arm. `energy` plays no part."""
    few = len(run.scenario.arms) <= FEW
    figure = new_figure(2.6 if few else 3.0 + legend_in(len(run.scenario.arms) + 1))
    widths = _widths(run, few)[:-1]
    *first, axes = figure.subplots(1, len(widths), width_ratios=widths, squeeze=False)[0]
    held = looks(run.scenario)
    for place, (arm, look) in enumerate(held.items()):
        values = list(run.rounds(arm).values())
        numbers = [f"{value:g}" if len(held) <= SOME else "" for value in values]
        learned = [result.learned for result in run.results[arm]]
        texts = [each if done else f"{each} {NOT_LEARNED}" for each, done in zip(numbers, learned, strict=True)]
        bars(axes, place, len(held), values, look, texts=texts)
        for stage in first:
            bars(stage, place, len(held), [float(run.t0[arm])], look, texts=[f"{run.t0[arm]}"])
    for stage in first:
        stage.set_xticks([0], ["$t_0$"])
        stage.margins(y=0.14)
        stage.set_xlim(-0.6, 0.6)
        stage.yaxis.get_major_locator().set_params(integer=True)
    axes.set_xticks(range(len(run.scenario.clusters)), [f"$t_{{{task}}}$" for task in run.scenario.clusters])
    axes.margins(x=0.03, y=0.14)
    (*first, axes)[0].set_ylabel("rounds")
    marked = any(not result.learned for results in run.results.values() for result in results)
    unlearned = [Line2D([], [], marker="x", color=INK, linestyle="", markersize=4, label="not learned")]
    handles = [*arm_patches(run), *(unlearned if marked else [])]
    figure.legend(handles=handles, ncols=LEGEND_COLUMNS, loc="outside upper center")
    return figure


def _priced(energy: Energy, prices: PriceList, stages: list[Facts]) -> list[tuple[float, float]]:
    """(learning, communication) joules of each."""
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


def _energy_bars(axes: Axes, found: Bars, factor: float, held: dict[str, Look], *, numbered: bool) -> None:
    for place, (arm, parts) in enumerate(found.items()):
        learning, communication = ([part / factor for part in each] for each in zip(*parts, strict=True))
        totals = [sum(each) / factor for each in parts]
        texts = [f"{total:.3g}" if total < 1000 else f"{total:.0f}" for total in totals] if numbered else []
        bars(
            axes,
            place,
            len(found),
            learning,
            held[arm],
            stacked=communication,
            texts=texts,
            turned=len(totals) > _TIGHT,
        )
