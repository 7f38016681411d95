"""Studies that vary one setting at a time: a list of points is all that a new one needs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.studies.beta import with_beta_1
from jouleswarm.studies.comparison import BASE, cheapest_note, comparison_csv, comparison_markdown
from jouleswarm.studies.comparison_figures import causes_figure, group_figure
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.jobs import Request, Variant, methods_setting
from jouleswarm.studies.kinds import Outputs, Plan
from jouleswarm.studies.record import Record


class Point(NamedTuple):
    """One value of one thing that is varied, and what it sets."""

    what: str
    value: str
    overrides: tuple[str, ...]


def pair_settings(request: Request) -> list[str]:
    """With meta-learning, to the t0 asked for, and without."""
    return [methods_setting(request.with_plain(request.meta_method)), f"meta.t0={request.t0}"]


def sweep(request: Request, points: Callable[[Scenario], list[Point]]) -> Plan:
    """A deployment a point and seed; points that come to the same scenario are run once.

    Args:
        request: what the user asked for.
        points: from the scenario as it is without any point, the points.
    """
    settings = pair_settings(request)
    base = request.scenario(settings)
    label_of: dict[str, str] = {base.model_dump_json(): BASE}
    overrides_of: dict[str, tuple[str, ...]] = {}
    groups: dict[str, dict[str, str]] = {}
    training: dict[str, tuple[int, ...]] = {}
    for point in points(base):
        scenario = request.scenario(settings, point.overrides)
        label = label_of.setdefault(scenario.model_dump_json(), f"{point.what}={point.value}")
        if scenario.meta.training_tasks != base.meta.training_tasks:
            training[label] = scenario.meta.training_tasks
        overrides_of.setdefault(label, () if label == BASE else point.overrides)
        groups.setdefault(point.what, {})[point.value] = label
    variants = [Variant(label, overrides) for label, overrides in overrides_of.items()]
    return Plan(request.jobs(variants, settings), settings, groups, training=training)


def sweep_outputs(title: str, facts: Sequence[Fact], record: Record) -> Outputs:
    """One table of all variants, one figure a thing that was varied."""
    made = comparison_outputs(title, facts, record)
    for what, variants in record.groups.items():
        made.figures[f"{record.study}_{what}"] = partial(group_figure, facts, record, what, variants)
    return made


def methods_outputs(title: str, facts: Sequence[Fact], record: Record) -> Outputs:
    """One table and one figure of methods side by side; what is cheapest without a stage before is told."""
    made = comparison_outputs(title, facts, record)
    (table,) = made.markdown[record.study]
    note = cheapest_note(facts, record.scenario.energy)
    made.markdown[record.study] = [table._replace(notes=(*table.notes, *note))]
    made.figures[record.study] = partial(causes_figure, facts, record.scenario)
    return made


def comparison_outputs(title: str, facts: Sequence[Fact], record: Record) -> Outputs:
    """One table of all variants and arms, for programs and for readers; no figure yet."""
    energy = record.scenario.energy
    lists = with_beta_1(record.lists, energy)
    return Outputs(
        csv={record.study: comparison_csv(facts, energy, lists, record.seen)},
        markdown={record.study: [comparison_markdown(facts, energy, title, lists, record.seen)]},
    )
