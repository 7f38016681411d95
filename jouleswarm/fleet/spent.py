"""What a run has computed and moved by now, arm by arm, as its processes tell it with each row.

Gradients are exact. Bytes are told as sums over all arms, so what came to a process between two rows is booked where
the second row is; the summary at the end has the broker's own count of each arm.
"""

from __future__ import annotations

from collections.abc import Mapping

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.names import client_of
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.common.wire.topics import Link
from jouleswarm.common.wire.types import RowPhase
from jouleswarm.energy.bill import Cost
from jouleswarm.energy.facts import STAGE, Counts, Facts, Phase
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import price
from jouleswarm.runs.arm_facts import links_of
from jouleswarm.runs.facts import gradient_counts


class Spent:
    """Counts by arm and phase; each arm is charged for the whole stage that it starts from, as in its bill."""

    def __init__(self, scenario: Scenario, *, resumed: bool) -> None:
        """`resumed`: what processes received before they are first heard of is not of this recorder's time."""
        self._scenario, self._resumed = scenario, resumed
        self._received: dict[str, Mapping[Link, int]] = {}
        self._rounds: dict[tuple[str, str, int, int], int] = {}
        self._sent_share = {arm.name: _sent_shares(scenario, arm.method) for arm in scenario.arms}
        kinds = {arm.name: scenario.method(arm.method) for arm in scenario.arms}
        self._exact = {name for name, kind in kinds.items() if kind.exact}
        self._gets_a_model = {
            name for name, kind in kinds.items() if kind.stage is not None and kind.partners != "datacenter"
        }
        """Arms in which all that comes down is the model that their stage has made."""
        self.counts: dict[tuple[str, Phase], Counts] = {}

    @property
    def received(self) -> dict[str, int]:
        """Payload bytes that all processes have received so far, by link class."""
        return {link.value: sum(each.get(link, 0) for each in self._received.values()) for link in Link}

    def take(self, row: RoundRow, received: Mapping[Link, int]) -> None:
        """Book a new row; `received`: payload bytes that its sender has received by then, by link class."""
        client, key = client_of(row.agent), (row.arm, row.phase, row.task, row.agent)
        before = self._received.get(client, received if self._resumed else {})
        self._received[client] = received
        up, down, across = (
            max(0, received.get(link, 0) - before.get(link, 0)) for link in (Link.UPLINK, Link.DOWNLINK, Link.SIDELINK)
        )
        # Through a base station a message goes up once, however many neighbours it has.
        sent = across * self._sent_share.get(row.arm, {}).get(row.task, 1.0)
        counts = Counts(uplink_bytes=up, sidelink_bytes=across, sidelink_sent_bytes=sent)
        if row.round > self._rounds.get(key, -1):  # one that was killed may tell a row again
            self._rounds[key] = row.round
            counts += gradient_counts([row])
            counts += Counts(motions=row.motions or 0, evaluation_motions=row.evaluation_motions or 0)
        phase: Phase = "ml" if row.phase == RowPhase.ML else "fl"
        self._add(row, phase, counts)
        self._add(row, "ml" if row.arm in self._gets_a_model else phase, Counts(downlink_bytes=down))

    def cost(self, arm: str, phase: Phase) -> Cost | None:
        """Joules by cause at the scenario's literal prices; None where they need what only the end tells."""
        counts = self.counts.get((arm, phase), Counts())
        beta, exact = None if counts.gradients_query else 1.0, arm in self._exact
        facts = Facts(arm, "", t0=0, parts={(phase, STAGE): counts}, beta=beta, exact=exact)
        try:
            bill = price(literal, facts, self._scenario.energy)
        except ConfigurationError:  # told with the bill; who looks on never ends a run
            return None
        return None if bill is None else bill.ml + bill.fl

    def _add(self, row: RoundRow, phase: Phase, counts: Counts) -> None:
        for arm in self._charged(row):
            self.counts[arm, phase] = self.counts.get((arm, phase), Counts()) + counts

    def _charged(self, row: RoundRow) -> list[str]:
        """Arms that pay for a row: those that start from the stage that it is of, or its own."""
        if row.phase != RowPhase.ML:
            return [row.arm]
        return [arm.name for arm in self._scenario.arms if arm.method == row.arm and row.round <= arm.t0]


def _sent_shares(scenario: Scenario, method: str) -> dict[int, float]:
    """Task -> messages sent over those received."""
    links = links_of(scenario, method)
    return {task: len(scenario.cluster(task)) / count if count else 1.0 for task, count in links.items()}
