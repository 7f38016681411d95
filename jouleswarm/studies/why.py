"""Why the verdict of a study is what it is: what the bills of mean facts hang on, and what break-even does."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

from matplotlib.figure import Figure

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.breakeven import tasks_to_pay
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import with_beta
from jouleswarm.energy.why import Hang, scaled, total_of
from jouleswarm.report.canvas import new_figure
from jouleswarm.report.table import Cell, Table
from jouleswarm.report.why import sorted_hangs, tornado, why_table
from jouleswarm.studies.breakeven import Compared, mean_facts
from jouleswarm.studies.style import META


def why_csv(arms: Sequence[Compared], energy: Energy) -> Table:
    """A row an arm and constant: how the bill of the study's tasks hangs on it, where it turns, and what M* does.

    Args:
        arms: with a stage, beside the one without.
        energy: constants and efficiencies; literal prices.
    """
    rows: list[tuple[Cell, ...]] = []
    for arm in arms:
        for each in _hangs(arm, energy):
            here = with_beta(energy, arm.mine[0])
            pays = [break_even(arm, scaled(here, each.constant, factor)) for factor in (0.5, 1.0, 2.0)]
            rows.append((arm.t0, *each, *pays))
    headings = (
        "t0",
        "constant",
        "value",
        "elasticity",
        "turns_at",
        "tasks_halved",
        "break_even_tasks",
        "tasks_doubled",
    )
    return Table("What the bill hangs on", headings, rows)


def why_markdown(arms: Sequence[Compared], energy: Energy) -> list[Table]:
    """The same for readers, a table an arm, without break-even."""
    return [why_table(f"t0 = {arm.t0} against without", _hangs(arm, energy)) for arm in arms]


def why_figure(arm: Compared, energy: Energy) -> Figure:
    """How M*, the number of tasks beyond which an arm pays, moves where one constant is halved or doubled."""
    figure = new_figure(2.2)
    axes = figure.subplots()
    tornado(axes, with_beta(energy, arm.mine[0]), partial(break_even, arm), META)
    axes.set_xlabel(f"tasks $M$ from which $t_0$ = {arm.t0} pays; a constant halved (arrow) or doubled")
    return figure


def _hangs(arm: Compared, energy: Energy) -> list[Hang]:
    mine, plain = (total_of(mean_facts(facts), literal) for facts in (arm.mine, arm.plain))
    return sorted_hangs(with_beta(energy, arm.mine[0]), mine, plain)


def break_even(arm: Compared, energy: Energy) -> float:
    """M*, literal prices; infinite where no number of tasks is enough, or there is no bill."""
    found = arm.means(energy)
    return math.inf if found is None else tasks_to_pay(found)
