"""What transfer saves against what tasks have in common: families of tasks from far to near."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from matplotlib.figure import Figure

from jouleswarm.environments.landmarks.families import MAX_STEM, Path, draw_family, drawing, similarity
from jouleswarm.environments.landmarks.settings import task_map, world_of
from jouleswarm.report.arms import INK
from jouleswarm.report.canvas import new_figure
from jouleswarm.report.look import look
from jouleswarm.report.table import Cell, Table
from jouleswarm.studies.arms import PLAIN, failures_of
from jouleswarm.studies.comparison import comparison_csv, comparison_markdown
from jouleswarm.studies.estimates import estimate
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.jobs import Request, Variant
from jouleswarm.studies.kinds import Kind, Outputs, Plan
from jouleswarm.studies.prices import failures, runs_of, task_stages
from jouleswarm.studies.record import Record
from jouleswarm.studies.style import COLOURS
from jouleswarm.studies.sweeps import pair_settings


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


def gains(facts: Sequence[Fact]) -> dict[str, dict[int, float]]:
    """Variant -> seed -> rounds without over rounds with meta-learning, summed over tasks."""
    found: dict[str, dict[int, float]] = {}
    for variant in dict.fromkeys(fact.variant for fact in facts):
        arms = dict.fromkeys(fact.arm for fact in facts if fact.variant == variant and fact.arm != PLAIN)
        without = runs_of(facts, variant, PLAIN)
        for arm in arms:
            found[variant] = {
                seed: _rounds(without[seed]) / _rounds(run)
                for seed, run in runs_of(facts, variant, arm).items()
                if seed in without
            }
    return found


def gains_csv(facts: Sequence[Fact], values: dict[str, dict[int, float]]) -> Table:
    """A row a variant and seed: similarity, gain, and how many tasks of both arms were not learned."""
    rows: list[tuple[Cell, ...]] = []
    for variant, of_seeds in gains(facts).items():
        for seed, gain in of_seeds.items():
            run = [fact for fact in facts if (fact.variant, fact.seed) == (variant, seed)]
            counted = (failures(run), len(task_stages(run)))
            rows.append((variant, seed, values.get(variant, {}).get(seed), gain, *counted))
    return Table("Transfer gain", ("variant", "seed", "similarity", "gain", "not_learned", "trials"), rows)


def gains_figure(facts: Sequence[Fact], values: dict[str, dict[int, float]]) -> Figure:
    """Transfer gain against similarity: a point a run, and the mean of each stem with its interval."""
    figure = new_figure(3.2)
    axes = figure.subplots()
    for place, (variant, of_seeds) in enumerate(gains(facts).items()):
        one = look(place, COLOURS[place % len(COLOURS)])
        known = values.get(variant, {})
        xs = [known[seed] for seed in of_seeds if seed in known]
        ys = [gain for seed, gain in of_seeds.items() if seed in known]
        if not xs:
            continue
        arms = dict.fromkeys(fact.arm for fact in facts)
        failed = sum(failures_of(facts, variant, arm)[0] for arm in arms)
        name = variant.replace("=", " ") + (f", {failed} not learned" if failed else "")
        if len(xs) > 1:
            axes.plot(xs, ys, linestyle="", marker=one.marker, markersize=3, alpha=0.5, color=one.colour)
        x, y = estimate(xs), estimate(ys)
        spread: dict[str, Any] = {"xerr": x.drawn_ci95, "yerr": y.drawn_ci95} if y.drawn_ci95 else {}
        axes.errorbar(x.mean, y.mean, **spread, fmt=one.marker, color=one.colour, capsize=2, label=name)
    axes.axhline(1.0, color=INK, linestyle="--", linewidth=0.7)
    axes.set_xlabel("similarity (mean share of common path landmarks)")
    axes.set_ylabel("transfer gain\n(rounds without / with)")
    axes.set_ylim(bottom=0)
    figure.legend(loc="outside right center")
    return figure


def outputs(facts: Sequence[Fact], record: Record) -> Outputs:
    """The comparison of all stems, the gains, and gain against similarity."""
    energy = record.scenario.energy
    title, lists = "Families of tasks from far to near", record.lists
    return Outputs(
        csv={"similarity": comparison_csv(facts, energy, lists), "gains": gains_csv(facts, record.values)},
        markdown={"similarity": [comparison_markdown(facts, energy, title, lists)]},
        figures={"similarity": lambda: gains_figure(facts, record.values)},
    )


def _rounds(run: Sequence[Fact]) -> int:
    return sum(fact.rounds for fact in task_stages(run))


KIND = Kind("similarity", 3, 90, plan, outputs)
