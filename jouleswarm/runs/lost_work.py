"""What faults have cost in computing: gradients and motions that were done and are in no row. Pure."""

from __future__ import annotations

from collections.abc import Iterable

from jouleswarm.common.meter.work import WorkRow
from jouleswarm.common.scenario.arms import method_of
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.names import client_of
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.common.wire.types import RowPhase
from jouleswarm.energy.facts import Counts

_COUNTS = ("gradients", "gradients_query", "motions", "evaluation_motions")


def lost_work(scenario: Scenario, rows: Iterable[RoundRow], work_rows: Iterable[WorkRow]) -> list[WorkRow]:
    """By process and place what it has done and not kept; nothing where nothing had to be done twice.

    After a power failure the newest counts of work may be missing: what rows tell was done, whatever the counters say.
    """
    kept: dict[tuple[str, str, str, int], list[int]] = {}
    for row in rows:
        counts = kept.setdefault((client_of(row.agent), row.phase, row.arm, row.task), [0, 0, 0, 0])
        query = row.gradients_query or 0
        told = (row.gradients - query, query, motions_of(scenario, row), row.evaluation_motions or 0)
        for index, count in enumerate(told):
            counts[index] += count
    found = []
    for done in work_rows:
        was = kept.get((done.client, done.phase, done.arm, done.task), [0, 0, 0, 0])
        left = {name: max(0, getattr(done, name) - count) for name, count in zip(_COUNTS, was, strict=True)}
        if any(left.values()):
            found.append(done.model_copy(update=left))
    return found


def motions_of(scenario: Scenario, row: RoundRow) -> int:
    """Transitions made in a row's round to learn from: |E_ik| in rows from before they were told."""
    if row.motions is not None or row.agent not in scenario.agents:
        return row.motions or 0
    return scenario.motions(row.agent)


def lost_counts(lost: Iterable[WorkRow], share: float = 1.0) -> Counts:
    """Lost gradients as what is priced; `share` of them."""
    held = list(lost)
    if not held:
        return Counts()
    center = [row for row in held if row.client == client_of(0)]
    return Counts(
        gradients_support=share * sum(row.gradients for row in center),
        gradients_query=share * sum(row.gradients_query for row in center),
        gradients_robots=share * sum(row.gradients for row in held if row.client != client_of(0)),
    )


def lost_motions(lost: Iterable[WorkRow], arm: str) -> int:
    """Motions that robots made for nothing in an arm, or in the meta-learning before it; the model prices none."""
    return sum(row.motions for row in lost if row.arm == arm or (row.phase, row.arm) == (RowPhase.ML, method_of(arm)))
