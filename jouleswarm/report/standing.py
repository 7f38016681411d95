"""Where a run stands, in words: its phase, its arms and its clusters, from what the recorder has heard."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.names import client_of
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.common.wire.types import RowPhase
from jouleswarm.energy.bill import Bill
from jouleswarm.energy.facts import STAGE, Counts, Facts, Phase
from jouleswarm.energy.prices import PriceList, price
from jouleswarm.report.arms import label, method_label
from jouleswarm.runs.traffic import DATA_CENTER

_WAIT = re.compile(r"(\S+) waits for (.*) (\(\d+ s\))")
_SILENT = "nothing heard of"
_NAMED = 3  # processes; more are counted


class Spent(Protocol):
    """What has been computed and moved by now."""

    counts: dict[tuple[str, Phase], Counts]
    """By arm and phase; each arm has the whole stage that it starts from."""


class Live(Protocol):
    """What is known of a run while it goes on; the recorder knows."""

    @property
    def elapsed_s(self) -> float:
        """Since the run began, seconds."""

    @property
    def newest(self) -> Mapping[tuple[str, int, int], RoundRow]:
        """(arm, task, agent) -> its newest row."""

    @property
    def received_bytes(self) -> Mapping[str, int]:
        """Link class -> payload bytes that have been received."""

    @property
    def spent(self) -> Spent:
        """Since the recorder began."""

    @property
    def stages(self) -> Mapping[str, int]:
        """Client -> how far it has come; who is missing has not come."""

    @property
    def waiting_for(self) -> Sequence[str]:
        """Clients that have not handed in their counts."""

    @property
    def waits(self) -> Sequence[str]:
        """What lasts, the longest first, a line each."""


class Cluster(NamedTuple):
    """Where a cluster stands in an arm: at its slowest robot."""

    task: int
    round: int
    reward: float | None
    """R."""
    learned: bool | None
    """None until all its robots are done with the arm."""


def phase(scenario: Scenario, live: Live) -> str:
    """What the run does now, and what it waits for: `MAML in the data center: round 38 of 90; ...`."""
    if _is_starting(scenario, live):
        return _starting(scenario, live)
    arm = next((arm for arm in scenario.arms if not is_over(scenario, live, arm.name)), None)
    if arm is None:
        total = len(_clients(scenario))
        return f"all arms are over; {total - len(live.waiting_for)} of {total} processes have handed in their counts"
    if arm.t0 and stage_round(live, arm.method) < scenario.meta.t0:
        return _stage(scenario, live, arm)
    name, known = label(scenario, arm), clusters(scenario, live, arm.name)
    if not known:
        return f"{name}: robots try {'the meta-model' if arm.t0 else 'what they start from'} before the first round"
    learned = sum(bool(cluster.learned) for cluster in known)
    return f"{name}: robots learn, {learned} of {len(scenario.clusters)} tasks learned"


def stage_round(live: Live, method: str) -> int:
    """Rounds that the data center has done of a method's stage."""
    newest = live.newest.items()
    rounds = (row.round for (arm, _, agent), row in newest if (arm, agent, row.phase) == (method, 0, RowPhase.ML))
    return max(rounds, default=0)


def clusters(scenario: Scenario, live: Live, arm: str) -> list[Cluster]:
    """The clusters that have begun to learn in an arm; a robot that is done does not hide one that is not."""
    found = []
    for task, agents in scenario.clusters.items():
        rows = _rows(scenario, live, arm, task)
        row = min(rows, key=lambda row: (row.learned is not None, bool(row.learned), row.round), default=None)
        if row is not None:
            over = len(rows) == len(agents) and all(each.learned is not None for each in rows)
            found.append(Cluster(task, row.round, row.cluster_reward, row.learned if over else None))
    return found


def is_over(scenario: Scenario, live: Live, arm: str) -> bool:
    """Whether all robots are done with an arm."""
    known = clusters(scenario, live, arm)
    return len(known) == len(scenario.clusters) and all(cluster.learned is not None for cluster in known)


def rounds_of(scenario: Scenario, live: Live, arm: str) -> int:
    """Rounds of all clusters so far, each at its farthest robot."""
    ends = (_rows(scenario, live, arm, task) for task in scenario.clusters)
    return sum(max((row.round for row in rows), default=0) for rows in ends)


def bill_so_far(scenario: Scenario, live: Live, arm: Arm, prices: PriceList) -> Bill | None:
    """What an arm has cost so far; None where that is known at the end only."""
    counts = live.spent.counts
    phases: tuple[Phase, ...] = ("ml", "fl")
    parts = {(each, STAGE): counts[arm.name, each] for each in phases if (arm.name, each) in counts}
    known = (row.beta for (name, _, _), row in live.newest.items() if name == arm.method and row.beta is not None)
    beta = next(known, None if any(part.gradients_query for part in parts.values()) else 1.0)
    facts = Facts(arm.name, arm.method, t0=0, parts=parts, beta=beta, exact=scenario.method(arm.method).exact)
    try:
        return price(prices, facts, scenario.energy)
    except ConfigurationError:  # told with the bill; a view never ends a run
        return None


def pays_for_stage(scenario: Scenario, arm: Arm) -> bool:
    """Whether a stage that several arms start from is booked here in a sum over all arms."""
    return [each.name for each in scenario.arms if each.method == arm.method][-1] == arm.name


def _rows(scenario: Scenario, live: Live, arm: str, task: int) -> list[RoundRow]:
    """The newest row of each robot of a cluster that has begun to learn."""
    rows = (live.newest.get((arm, task, agent)) for agent in scenario.cluster(task))
    return [row for row in rows if row is not None and row.phase == RowPhase.FL]


def _clients(scenario: Scenario) -> list[str]:
    return [client_of(agent) for agent in (*scenario.agents, *([0] if scenario.needs_datacenter else []))]


def _is_starting(scenario: Scenario, live: Live) -> bool:
    return not live.spent.counts and len(live.stages) < len(_clients(scenario))


def _starting(scenario: Scenario, live: Live) -> str:
    clients = _clients(scenario)
    missing = [client for client in clients if client not in live.stages]
    center = " and the data center" if scenario.needs_datacenter else ""
    named = f"; not yet: {', '.join(map(name_of, missing))}" if len(missing) <= _NAMED else ""
    robots = f"{len(scenario.agents)} robots{center}"
    return f"starting {robots}: {len(clients) - len(missing)} of {len(clients)} here{named}"


def _stage(scenario: Scenario, live: Live, arm: Arm) -> str:
    done, t0 = stage_round(live, arm.method), scenario.meta.t0
    training = [(task, agent) for task, agents in scenario.training_agents.items() for agent in agents]
    rows = [(agent, live.newest.get((arm.method, task, agent))) for task, agent in training]
    late = [client_of(agent) for agent, row in rows if row is None or row.round <= done]
    if not late:
        what = "the data center learns from it"
    elif len(late) <= _NAMED:
        what = f"waits for {', '.join(map(name_of, late))}"
    else:
        what = f"{len(training) - len(late)} of {len(training)} robots have sent it"
    name = method_label(scenario, arm.method)
    return f"{name} in the data center: {done} of {t0} rounds; experience of round {done + 1}: {what}"


def waits(scenario: Scenario, live: Live) -> list[str]:
    """What lasts, the longest first, with those who wait for the same in one line; who has not come yet is told with
    the phase."""
    told = live.waits
    if _is_starting(scenario, live):
        told = [wait for wait in told if not wait.startswith(_SILENT)]
    return together(told)


def together(waits: Sequence[str]) -> list[str]:
    """The recorder's lines, with those who wait for the same in one."""
    found: dict[str, list[tuple[str, str]]] = {}
    for wait in waits:
        client, what, lasts = found_in.groups() if (found_in := _WAIT.fullmatch(wait)) else ("", wait, "")
        found.setdefault(what, []).append((client, lasts))
    told = []
    for what, held in found.items():
        client, lasts = held[0]
        who = name_of(client) if len(held) == 1 else f"{len(held)} processes"
        verb = "waits" if len(held) == 1 else "wait"
        told.append(f"{who} {verb} for {what} {lasts}" if client else what)
    return told


def name_of(client: str) -> str:
    """`robot 3`, `data center`."""
    return "data center" if client == DATA_CENTER else f"robot {client.removeprefix('agent-')}"
