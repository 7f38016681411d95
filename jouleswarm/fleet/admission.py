"""What a run's messages can be about: the recorder believes no message that this run's processes cannot have sent."""

from __future__ import annotations

from collections.abc import Sequence

from jouleswarm.common.bus.reporter import MeterReport
from jouleswarm.common.errors import PayloadError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import Presence
from jouleswarm.common.wire.names import client_of
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.common.wire.types import RowPhase


def check_presence(presence: Presence, topic: str, scenario: Scenario, run: str) -> None:
    """Hold a presence against the topic that it came on; a made-up death would end the run.

    Raises:
        PayloadError: it is of another process, or of none of this run.
    """
    agent = presence.agent
    if agent not in (0, *scenario.agents):
        raise PayloadError(f"presence of robot {agent}, expected one of the scenario's")
    if topic != topics.presence(run, scenario.task_of(agent) if agent else 0, agent):
        raise PayloadError(f"presence of robot {agent}, expected the topic's")


def check_row(row: RoundRow, client: str, scenario: Scenario) -> None:
    """Hold a row against the scenario and its sender.

    Raises:
        PayloadError: no process of this run called `client` has such a row.
    """
    last = max(scenario.federation.max_rounds, scenario.meta.t0)
    known = row.arm in scenario.arm_names and row.agent in (0, *scenario.clusters.get(row.task, ()))
    first = 0 if row.phase == RowPhase.FL and row.agent else 1
    if not known or not first <= row.round <= last or client != client_of(row.agent):
        raise PayloadError(
            f"row of {client}: robot {row.agent}, arm {row.arm}, task {row.task}, round {row.round}; "
            f"expected its own, of this scenario, and rounds up to {last}"
        )


def check_report(report: MeterReport, client: str, expected: Sequence[str], scenario: Scenario) -> None:
    """Hold final counters and rows against their sender.

    Raises:
        PayloadError: they are not those of one of the `expected` clients, on its own topic.
    """
    if report.client != client or client not in expected:
        raise PayloadError(f"counters of {report.client} on the topic of {client}, expected one of {expected}")
    whose = {("client", report.client), *((row.side, row.client) for row in report.rows)}
    whose |= {("client", row.client) for row in report.work} | {("client", row.client) for row in report.joules}
    if len(whose) > 1:
        raise PayloadError(f"counters of {sorted(whose)} on the topic of {client}, expected its own")
    for row in report.rounds:
        check_row(row, client, scenario)


def learned_name(arm: str, task: str, scenario: Scenario) -> str:
    """File name for a task's learned model.

    Raises:
        PayloadError: no such arm or task.
    """
    if arm not in scenario.arm_names or task not in map(str, scenario.clusters):
        raise PayloadError(f"model of arm {arm[:40]!r}, task {task[:40]!r}, expected those of the scenario")
    return f"{arm}-task{task}"


def snapshot_name(method: str, round_: str, scenario: Scenario) -> str:
    """File name for the meta-model of a round.

    Raises:
        PayloadError: no such method or round.
    """
    rounds = {str(each) for each in range(1, scenario.meta.t0 + 1)}
    if method not in scenario.meta_methods or round_ not in rounds:
        raise PayloadError(
            f"meta-model of {method[:40]!r}, round {round_[:40]!r}, expected rounds up to {scenario.meta.t0}"
        )
    return f"{method}-meta-t{int(round_):04d}"
