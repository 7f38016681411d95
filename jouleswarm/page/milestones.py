"""What happened in a run, from its rows: stages that ended, clusters that learned or gave up. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.common.wire.types import RowPhase
from jouleswarm.report.arms import labels, method_label
from jouleswarm.runs.events import Event
from jouleswarm.runs.metering import RowTime
from jouleswarm.runs.run import Run


def milestones(run: Run, times: Sequence[RowTime]) -> list[Event]:
    """In the order of time."""
    first: dict[tuple[object, ...], float] = {}
    for each in times:  # a row that was told again was there already
        first.setdefault((each.phase, each.arm, each.task, each.agent, each.round), each.time_s)
    found = [*_stages(run, first), *_clusters(run, first)]
    return sorted(found, key=lambda event: event.time_s)


def _stages(run: Run, times: Mapping[tuple[object, ...], float]) -> Iterator[Event]:
    for method in run.scenario.meta_methods:
        t0 = run.scenario.meta.t0
        done = [at for key, at in times.items() if key[:2] == (RowPhase.ML, method) and key[3:] == (0, t0)]
        if len(done) == len(run.scenario.training_agents):
            label = method_label(run.scenario, method)
            yield Event(time_s=max(done), text=f"{label}: {t0} rounds of meta-learning done, the model goes down")


def _clusters(run: Run, times: Mapping[tuple[object, ...], float]) -> Iterator[Event]:
    named = labels(run.scenario)
    ends: dict[tuple[str, int], list[RoundRow]] = {}
    for row in run.rows:
        if row.phase == RowPhase.FL and row.agent and row.learned is not None:
            ends.setdefault((row.arm, row.task), []).append(row)
    for (arm, task), rows in ends.items():
        at = [times.get((row.phase, arm, task, row.agent, row.round)) for row in rows]
        known = [each for each in at if each is not None]
        if known and len(rows) == len(run.scenario.cluster(task)):
            how = "learned" if all(row.learned for row in rows) else "not learned"
            rounds = max(row.round for row in rows)
            yield Event(time_s=max(known), text=f"{named[arm]}: task {task} {how} after {rounds} rounds")
