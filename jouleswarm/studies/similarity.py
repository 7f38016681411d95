"""What transfer saves against what tasks have in common: families of tasks from far to near."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jouleswarm.environments.landmarks.families import MAX_STEM, Path, draw_family, drawing, similarity
from jouleswarm.environments.landmarks.settings import task_map, world_of
from jouleswarm.report.arms import INK
from jouleswarm.report.canvas import new_figure
from jouleswarm.report.look import look
from jouleswarm.report.table import Cell, Table
from jouleswarm.studies.arms import PLAIN, failures_of, groups_of
from jouleswarm.studies.estimates import estimate
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.jobs import Request, Variant
from jouleswarm.studies.kinds import Kind, Outputs, Plan
from jouleswarm.studies.prices import failures, runs_of, task_stages
from jouleswarm.studies.record import Record
from jouleswarm.studies.style import COLOURS
from jouleswarm.studies.sweeps import comparison_outputs, pair_settings


def plan(request: Request) -> Plan:
    """One deployment a stem and seed, each with a family of tasks of its own, drawn from the seed."""
    settings = pair_settings(request)
    scenario = request.scenario(settings)
    rows, cols = world_of(scenario).rows, world_of(scenario).cols
    ids = [task.id for task in scenario.tasks]
    entry = task_map(scenario, ids[0]).entry
    jobs, values = [], {}
    for stem in range(MAX_STEM + 1):
        label = f"stem={stem}"
        families = {seed: draw_family(seed, stem, len(ids), rows, cols, entry) for seed in request.seeds}
        for seed, family in families.items():
            override = tasks_setting(ids, family, rows, cols)
            jobs += request.jobs([Variant(label, (override,))], settings, [seed])
        values[label] = {seed: round(similarity(family), 6) for seed, family in families.items()}
    return Plan(jobs, settings, {"stem": {label.removeprefix("stem="): label for label in values}}, values)


def tasks_setting(ids: Sequence[int], family: Sequence[Path], rows: int, cols: int) -> str:
    """The override that gives a scenario these paths as its tasks."""
    tasks = [
        f"{{id = {task}, map = {json.dumps(drawing(path, rows, cols))}}}"
        for task, path in zip(ids, family, strict=True)
    ]
    return f"tasks=[{', '.join(tasks)}]"


def gains(facts: Sequence[Fact], tasks: Collection[int] | None = None) -> dict[str, dict[int, float]]:
    """Variant -> seed -> rounds without over rounds with meta-learning, summed over `tasks` (default all).

    Where with it none were needed the gain is infinite.
    """
    found: dict[str, dict[int, float]] = {}
    for variant in dict.fromkeys(fact.variant for fact in facts):
        arms = dict.fromkeys(fact.arm for fact in facts if fact.variant == variant and fact.arm != PLAIN)
        without = runs_of(facts, variant, PLAIN)
        for arm in arms:
            found[variant] = {
                seed: _gain(without[seed], run, tasks)
                for seed, run in runs_of(facts, variant, arm).items()
                if seed in without
            }
    return found


def gains_csv(facts: Sequence[Fact], values: dict[str, dict[int, float]], training: Collection[int]) -> Table:
    """A row a variant and seed: similarity, gain of all, unseen and seen tasks, and how many tasks of both arms were
    not learned."""
    rows: list[tuple[Cell, ...]] = []
    groups = groups_of(facts, training)
    apart = [gains(facts, groups[name]) if name in groups else {} for name in ("unseen", "seen")]
    for variant, of_seeds in gains(facts).items():
        for seed, gain in of_seeds.items():
            run = [fact for fact in facts if (fact.variant, fact.seed) == (variant, seed)]
            counted = (failures(run), len(task_stages(run)))
            told = (gain, *(each.get(variant, {}).get(seed) for each in apart))
            rows.append((variant, seed, values.get(variant, {}).get(seed), *told, *counted))
    headings = ("variant", "seed", "similarity", "gain", "gain_unseen", "gain_seen", "not_learned", "trials")
    return Table("Transfer gain", headings, rows)


def gains_figure(facts: Sequence[Fact], values: dict[str, dict[int, float]], training: Collection[int]) -> Figure:
    """Transfer gain against similarity, of unseen and of seen tasks: a point a run, and the mean of each stem with its
    interval; open where tasks were not learned."""
    groups = {name: of for name, of in groups_of(facts, training).items() if name != "all"}
    figure = new_figure(3.2)
    panels = figure.subplots(1, len(groups), squeeze=False, sharey=True)[0]
    for axes, (name, of) in zip(panels, groups.items(), strict=True):
        _draw_gains(axes, facts, of, values)
        axes.axhline(1.0, color=INK, linestyle="--", linewidth=0.7)
        axes.set_title(f"{name} tasks ({', '.join(map(str, of))})")
        axes.set_xlabel("similarity (mean share of\ncommon path landmarks)")
        axes.set_ylim(bottom=0)
    panels[0].set_ylabel("transfer gain\n(rounds without / with)")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside right center")
    return figure


def _draw_gains(axes: Axes, facts: Sequence[Fact], tasks: Collection[int], values: dict[str, dict[int, float]]) -> None:
    for place, (variant, of_seeds) in enumerate(gains(facts, tasks).items()):
        one = look(place, COLOURS[place % len(COLOURS)])
        known = values.get(variant, {})
        shown = {seed: gain for seed, gain in of_seeds.items() if seed in known and math.isfinite(gain)}
        xs, ys = [known[seed] for seed in shown], list(shown.values())
        if not xs:
            continue
        arms = dict.fromkeys(fact.arm for fact in facts)
        failed = sum(failures_of(facts, variant, arm)[0] for arm in arms)
        cut_off = any(failures_of(facts, variant, arm, tasks)[0] for arm in arms)
        name = variant.replace("=", " ") + (f", {failed} not learned" if failed else "")
        if len(xs) > 1:
            axes.plot(xs, ys, linestyle="", marker=one.marker, markersize=3, alpha=0.5, color=one.colour)
        x, y = estimate(xs), estimate(ys)
        spread: dict[str, Any] = {"xerr": x.drawn_ci95, "yerr": y.drawn_ci95} if y.drawn_ci95 else {}
        spread["markerfacecolor"] = "white" if cut_off else one.colour
        axes.errorbar(x.mean, y.mean, **spread, fmt=one.marker, color=one.colour, capsize=2, label=name)


def outputs(facts: Sequence[Fact], record: Record) -> Outputs:
    """The comparison of all stems, the gains, and gain against similarity."""
    training = record.scenario.meta.training_tasks
    made = comparison_outputs("Families of tasks from far to near", facts, record)
    made.csv["gains"] = gains_csv(facts, record.values, training)
    made.figures["similarity"] = lambda: gains_figure(facts, record.values, training)
    return made


def _gain(without: Sequence[Fact], with_: Sequence[Fact], tasks: Collection[int] | None) -> float:
    above, below = (
        sum(fact.rounds for fact in task_stages(run) if tasks is None or fact.task in tasks) for run in (without, with_)
    )
    return above / below if below else math.inf if above else 1.0


KIND = Kind("similarity", 5, 90, plan, outputs)
