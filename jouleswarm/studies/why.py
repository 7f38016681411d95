"""Why the verdict of a study is what it is: what the bills of mean facts hang on, and what break-even does."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial

from matplotlib.figure import Figure

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.energy.breakeven import tasks_to_pay
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import with_beta
from jouleswarm.energy.why import Hang, scaled, total_of
from jouleswarm.report.canvas import new_figure
from jouleswarm.report.table import Cell, Table
from jouleswarm.report.tornado import tornado
from jouleswarm.report.why import sorted_hangs, why_table
from jouleswarm.studies.arms import PLAIN, ArmOf, arms_by_variant, names_of
from jouleswarm.studies.breakeven import Compared, mean_facts
from jouleswarm.studies.facts import META_STAGE, Fact
from jouleswarm.studies.prices import facts_of, runs_of
from jouleswarm.studies.shares import training_robots
from jouleswarm.studies.style import META


def against_plain(facts: Sequence[Fact], scenario: Scenario) -> list[Compared]:
    """Every arm of every variant beside the one without transfer, by the seeds that both have; none without that one.

    The tasks that a stage was learned from are not known where a variant has other ones than the scenario.
    """
    pairs = []
    for variant, arms in arms_by_variant(facts).items():
        plain = {seed: facts_of(run) for seed, run in runs_of(facts, variant, PLAIN).items()}
        for arm in (each for each in arms if each.arm != PLAIN):
            runs = {seed: run for seed, run in runs_of(facts, variant, arm.arm).items() if seed in plain}
            if runs:
                seen = _seen(next(iter(runs.values())), scenario)
                mine = [facts_of(run) for run in runs.values()]
                pairs.append(Compared(arm.arm, arm.t0, mine, [plain[seed] for seed in runs], seen, variant))
    return pairs


def why_csv(pairs: Sequence[Compared], energy: Energy) -> Table:
    """A row an arm and constant: how the bill of the study's tasks hangs on it, where it turns, and what M* does.

    Args:
        pairs: of `against_plain`; M* is empty of arms without a stage, and where the tasks it has seen are not known.
        energy: constants and efficiencies; literal prices.
    """
    rows: list[tuple[Cell, ...]] = []
    for pair in pairs:
        for each in _hangs(pair, energy):
            here = with_beta(energy, pair.mine[0])
            pays: list[Cell] = [None] * 3
            if pair.t0 and pair.seen:
                pays = [break_even(pair, scaled(here, each.constant, factor)) for factor in (0.5, 1.0, 2.0)]
            rows.append((pair.variant, pair.arm, pair.t0, *each, *pays))
    headings = ("constant", "value", "elasticity", "turns_at", "tasks_halved", "break_even_tasks", "tasks_doubled")
    return Table("What the bill hangs on", (*ArmOf._fields, *headings), rows)


def why_markdown(pairs: Sequence[Compared], energy: Energy) -> list[Table]:
    """The same for readers, a table an arm, without break-even."""
    return [why_table(f"{_name(pairs, pair)} against {_plain(pairs, pair)}", _hangs(pair, energy)) for pair in pairs]


def why_figures(pairs: Sequence[Compared], energy: Energy) -> dict[str, Callable[[], Figure]]:
    """Of the arm that pays from the fewest tasks on, by the name of its file; none where no arm does."""
    pays = {break_even(pair, energy): pair for pair in pairs if pair.t0 and pair.seen}
    if math.isinf(fewest := min(pays, default=math.inf)):
        return {}
    name = _name(pairs, pays[fewest]).replace("t0", "$t_0$")
    return {"why": partial(why_figure, pays[fewest], name, energy)}


def why_figure(pair: Compared, name: str, energy: Energy) -> Figure:
    """How M*, the number of tasks beyond which an arm pays, moves where one constant is halved or doubled."""
    figure = new_figure(2.2)
    axes = figure.subplots()
    tornado(axes, with_beta(energy, pair.mine[0]), partial(break_even, pair), META)
    axes.set_xlabel(f"tasks $M$ from which {name} pays; a constant halved (arrow) or doubled")
    return figure


def break_even(pair: Compared, energy: Energy) -> float:
    """M*, literal prices; infinite where no number of tasks is enough, or there is no bill."""
    found = pair.means(energy)
    return math.inf if found is None else tasks_to_pay(found)


def _seen(run: Sequence[Fact], scenario: Scenario) -> tuple[int, ...]:
    stage = next((fact for fact in run if fact.task == META_STAGE), None)
    same = stage and training_robots(stage, scenario) == sum(map(len, scenario.training_agents.values()))
    return tuple(scenario.training_agents) if same else ()


def _hangs(pair: Compared, energy: Energy) -> list[Hang]:
    mine, plain = (total_of(mean_facts(facts), literal) for facts in (pair.mine, pair.plain))
    return sorted_hangs(with_beta(energy, pair.mine[0]), mine, plain)


def _name(pairs: Sequence[Compared], pair: Compared) -> str:
    """`t0 = 42`, `Q=1, t0 = 66`, `fomaml`."""
    name = _names(pairs, pair)[ArmOf(pair.variant, pair.arm, pair.t0)]
    return f"{pair.variant}, {name}" if pair.variant else name


def _plain(pairs: Sequence[Compared], pair: Compared) -> str:
    return _names(pairs, pair)[ArmOf(pair.variant, PLAIN, 0)]


def _names(pairs: Sequence[Compared], pair: Compared) -> dict[ArmOf, str]:
    mine = [ArmOf(each.variant, each.arm, each.t0) for each in pairs if each.variant == pair.variant]
    return names_of([ArmOf(pair.variant, PLAIN, 0), *mine])
