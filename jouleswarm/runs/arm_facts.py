"""The facts of a run's arm, all that price lists are given: made once from rows and counters. Pure; no prices."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product

from jouleswarm.common.meter.meter import MeterRow
from jouleswarm.common.meter.work import WorkRow
from jouleswarm.common.scenario.arms import method_of, snapshot_of
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.names import client_of
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.common.wire.topics import Link, agent_of, task_of
from jouleswarm.common.wire.types import RowPhase
from jouleswarm.energy.closed_form import RoundSizes
from jouleswarm.energy.facts import STAGE, Counts, Facts, Flow, Phase, UnknownFactError, Work
from jouleswarm.methods.graph import directed_links
from jouleswarm.runs.beta import measured_beta
from jouleswarm.runs.closed import closed_flows, closed_parts, closed_sent, closed_work
from jouleswarm.runs.facts import meta_counts, meta_rounds, stage_share, task_counts, task_results
from jouleswarm.runs.lost_work import motions_of
from jouleswarm.runs.traffic import DATA_CENTER, RECORDER, Measure, deliveries, metered_by, sent_rows

_PHASES: dict[str, Phase] = {RowPhase.ML: "ml", RowPhase.FL: "fl"}  # as rows and counters spell them


def arm_facts(
    scenario: Scenario,
    rows: Iterable[RoundRow],
    meter_rows: Sequence[MeterRow],
    arm: str,
    *,
    lost: Iterable[WorkRow] = (),
) -> Facts:
    """What an arm has done, what was done in vain too; its counts are of payload bytes."""
    method = method_of(arm)
    exact = scenario.method(method).exact
    rows = [row for row in rows if row.arm in (arm, method)]
    moved = [row for row in meter_rows if row.arm in (arm, method) and row.side == metered_by(meter_rows)]
    wasted = [row for row in lost if row.arm in (arm, method)]
    return Facts(
        arm=arm,
        method=method,
        t0=meta_rounds(rows, arm),
        parts=_parts(scenario, rows, moved, arm, "payload", wasted),
        rounds={result.task: result.rounds for result in task_results(scenario, rows, arm)},
        robots={task: len(cluster) for task, cluster in scenario.clusters.items()},
        links=links_of(scenario, method),
        training_robots=sum(len(agents) for agents in scenario.training_agents.values()),
        beta=measured_beta(rows, method, exact=exact),
        metered=bool(meter_rows),
        known_flows=tuple(_flows(rows, moved, arm)),
        known_work=tuple(_work(scenario, rows, wasted, arm)),
        known_sent=tuple(_sent(moved, arm)),
        exact=exact,
    )


def in_packets(
    facts: Facts,
    scenario: Scenario,
    rows: Sequence[RoundRow],
    meter_rows: Sequence[MeterRow],
    lost: Sequence[WorkRow] = (),
) -> Facts:
    """The same with counts of whole packets' bytes."""
    return replace(facts, parts=_parts(scenario, rows, meter_rows, facts.arm, "packet", lost))


def control_facts(facts: Facts, meter_rows: Sequence[MeterRow]) -> Facts:
    """An arm's control and telemetry, which are in no bill, as if they were its traffic: to robots down, else up."""
    flows = []
    for row in deliveries(meter_rows, facts.arm, Link.CONTROL):
        link = Link.UPLINK if row.client in (DATA_CENTER, RECORDER) else Link.DOWNLINK
        flows.append(Flow("fl", STAGE, link, "", row.client, row.messages, row.payload_bytes, row.packet_bytes))
    up, down = (sum(f.payload_bytes for f in flows if f.link == link) for link in (Link.UPLINK, Link.DOWNLINK))
    parts: dict[tuple[Phase, int], Counts] = {("fl", STAGE): Counts(uplink_bytes=up, downlink_bytes=down)}
    return replace(facts, t0=0, rounds={}, parts=parts, known_flows=tuple(flows), known_work=(), known_sent=())


def in_closed_form(facts: Facts, scenario: Scenario, rounds: Mapping[int, float], sizes: RoundSizes) -> Facts:
    """The same with counts from rounds alone, and with the work and the flows that they come to where that is known."""
    method, t0 = facts.method, facts.t0
    parts = closed_parts(scenario, method, t0, rounds, sizes)
    found = replace(facts, parts=parts, metered=True, known_flows=None, known_work=None, known_sent=None)
    try:
        return replace(
            found,
            known_flows=tuple(closed_flows(scenario, method, t0, rounds, sizes, parts)),
            known_work=tuple(closed_work(scenario, t0, rounds, sizes, parts)),
            known_sent=tuple(closed_sent(scenario, rounds, parts)),
        )
    except UnknownFactError:
        return found


def links_of(scenario: Scenario, method: str) -> dict[int, int]:
    """Task -> directed links between neighbours that a method's rounds send over."""
    linked = scenario.method(method).partners == "neighbours"
    return {task: directed_links(scenario, task) if linked else 0 for task in scenario.clusters}


def _parts(
    scenario: Scenario,
    rows: Sequence[RoundRow],
    meter_rows: Sequence[MeterRow],
    arm: str,
    measure: Measure,
    lost: Sequence[WorkRow],
) -> dict[tuple[Phase, int], Counts]:
    parts: dict[tuple[Phase, int], Counts] = {}
    if scenario.method(method_of(arm)).stage is not None:
        parts["ml", STAGE] = meta_counts(rows, meter_rows, arm, measure=measure, lost=lost)
    for task in scenario.clusters:
        parts["fl", task] = task_counts(rows, meter_rows, arm, task=task, measure=measure, lost=lost)
    return parts


def _flows(rows: Sequence[RoundRow], meter_rows: Sequence[MeterRow], arm: str) -> Iterator[Flow]:
    """What was delivered; what carried a shared phase ml up was booked under the method's own name."""
    method, share = method_of(arm), stage_share(rows, arm)
    for link, (told, phase) in product((Link.UPLINK, Link.DOWNLINK, Link.SIDELINK), _PHASES.items()):
        is_shared = (link, phase) == (Link.UPLINK, "ml")
        found: dict[tuple[int, str, str], list[float]] = {}
        for row in deliveries(meter_rows, method if is_shared else arm, link, phase=told):
            task = STAGE if (link, phase) == (Link.DOWNLINK, "ml") else _number(task_of(row.topic))
            sender = DATA_CENTER if link == Link.DOWNLINK else client_of(_number(agent_of(row.topic)))
            sums = found.setdefault((task, sender, row.client), [0, 0, 0])
            for place, count in enumerate((row.messages, row.payload_bytes, row.packet_bytes)):
                sums[place] += count * share if is_shared else count
        for (task, sender, receiver), (messages, payload, packet) in found.items():
            yield Flow(phase, task, link, sender, receiver, messages, payload, packet)


def _number(level: str) -> int:
    """An id; 0 for what is none: whoever is on the bus can write on any topic."""
    return int(level) if level.isdecimal() else 0


def _sent(meter_rows: Sequence[MeterRow], arm: str) -> Iterator[Flow]:
    """What robots sent over sidelinks, each message once."""
    found: dict[tuple[int, str], list[int]] = {}
    for row in sent_rows(meter_rows, arm):
        sums = found.setdefault((_number(task_of(row.topic)), row.client), [0, 0, 0])
        for place, count in enumerate((row.messages, row.payload_bytes, row.packet_bytes)):
            sums[place] += count
    for (task, sender), sums in found.items():
        yield Flow("fl", task, Link.SIDELINK, sender, "", *sums)


def _work(scenario: Scenario, rows: Sequence[RoundRow], lost: Sequence[WorkRow], arm: str) -> Iterator[Work]:
    """What processes have computed, by phase and task; of a shared phase ml the rounds up to the arm's own."""
    method, snapshot, share = method_of(arm), snapshot_of(arm), stage_share(rows, arm)
    found: dict[tuple[Phase, int, str], list[float]] = {}  # in the order of the fields of `Work`
    for row in rows:
        behind = (row.phase, row.arm) == (RowPhase.ML, method) and (snapshot is None or row.round <= snapshot)
        if behind or (row.phase, row.arm) == (RowPhase.FL, arm):
            sums = found.setdefault((_PHASES[row.phase], row.task, client_of(row.agent)), [0] * 6)
            exact = row.gradients_query or 0
            acted = motions_of(scenario, row), row.evaluation_motions or 0
            for place, done in enumerate((row.gradients - exact, exact, row.seconds, row.round > 0, *acted)):
                sums[place] += done
    for wasted in lost:
        if (wasted.phase, wasted.arm) in ((RowPhase.ML, method), (RowPhase.FL, arm)):
            sums = found.setdefault((_PHASES[wasted.phase], wasted.task, wasted.client), [0] * 6)
            part = share if wasted.phase == RowPhase.ML else 1.0
            sums[0] += part * wasted.gradients
            sums[1] += part * wasted.gradients_query
            sums[4] += part * wasted.motions
            sums[5] += part * wasted.evaluation_motions
    for (phase, task, client), spent in found.items():
        yield Work(phase, task, _number(client.removeprefix("agent-")), *spent)
