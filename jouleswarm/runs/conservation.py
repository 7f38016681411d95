"""Whether what the broker delivered is what clients received, and what faults have cost: a run's bytes held together.

For each client and topic: what the client acknowledged <= what it received <= what the broker wrote to it, in messages
and in payload bytes. Without faults all three are equal, at QoS 1; with faults the difference was written to
connections that broke.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from jouleswarm.common.meter.meter import MeterRow
from jouleswarm.runs.traffic import DATA_CENTER, is_party


@dataclass(frozen=True)
class Balance:
    """One client's messages on one topic, (messages, payload bytes)."""

    client: str
    topic: str
    delivered: tuple[int, int] = (0, 0)
    acknowledged: tuple[int, int] = (0, 0)
    received: tuple[int, int] = (0, 0)
    repeated: tuple[int, int] = (0, 0)

    @property
    def holds(self) -> bool:
        """Whether nothing was received that was not delivered, and nothing acknowledged that was not received.

        A second process of the same name hears the name's own presence and claim before it is refused, and its counts
        go with it: there only the first holds.
        """
        number = "0" if self.client == DATA_CENTER else self.client.removeprefix("agent-")
        own = self.topic.endswith("/claim") or self.topic.endswith(f"/{number}/presence")
        return (own or _within(self.acknowledged, self.received)) and _within(self.received, self.delivered)

    @property
    def lost(self) -> tuple[int, int]:
        """What was written to connections that broke before it was received."""
        return self.delivered[0] - self.received[0], self.delivered[1] - self.received[1]


@dataclass(frozen=True)
class Conservation:
    """A run's bytes, held together."""

    broken: tuple[Balance, ...]
    """Where the inequality does not hold: a defect of the counting."""
    lost: tuple[int, int]
    """(messages, payload bytes) delivered and not received."""
    repeated: tuple[int, int]
    """(messages, payload bytes) received that had come before: retransmissions. They are paid for like the others."""


def conservation(meter_rows: Sequence[MeterRow]) -> Conservation | None:
    """The balance of a run; None where only one side has counted."""
    if {row.side for row in meter_rows} != {"broker", "client"}:
        return None
    found = balances(meter_rows)
    return Conservation(
        tuple(each for each in found if not each.holds),
        _sum(each.lost for each in found if each.holds),
        _sum(each.repeated for each in found),
    )


def balances(meter_rows: Sequence[MeterRow]) -> list[Balance]:
    """One for each client of the deployment and topic, in a stable order; onlookers' are left out."""
    names = {("broker", "out"): "delivered", ("broker", "acked"): "acknowledged", ("client", "in"): "received"}
    told = {row.client for row in meter_rows if row.side == "client"}  # of others nothing is known
    parts: dict[tuple[str, str], dict[str, tuple[int, int]]] = {}
    for row in meter_rows:
        name = names.get((row.side, row.direction)) or ("repeated" if row.direction == "repeated" else None)
        if name is not None and row.client in told and is_party(row.client):
            parts.setdefault((row.client, row.topic), {})[name] = row.messages, row.payload_bytes
    return [Balance(client, topic, **counts) for (client, topic), counts in sorted(parts.items())]


def _within(part: tuple[int, int], whole: tuple[int, int]) -> bool:
    """Whether a part is neither more messages than the whole nor more bytes."""
    return all(less <= more for less, more in zip(part, whole, strict=True))


def _sum(pairs: Iterable[tuple[int, int]]) -> tuple[int, int]:
    held = list(pairs)
    return sum(messages for messages, _ in held), sum(size for _, size in held)
