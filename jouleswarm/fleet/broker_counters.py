"""What the broker has counted of one run, from the run's beginning: its totals go back to the broker's own birth."""

from __future__ import annotations

import logging
import secrets
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from jouleswarm.common.bus.bus import Message
from jouleswarm.common.bus.listener import Listener
from jouleswarm.common.errors import RunError
from jouleswarm.common.meter.meter import MeterRow
from jouleswarm.common.scenario.sections import Bus as BusSettings
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.broker_counters import PIECE_BYTES, BrokerLimits, CountersPiece, CountersRequest
from jouleswarm.common.wire.messages import Acknowledgement, decode_json, encode_json
from jouleswarm.fleet.baseline import BASELINE, keep_baseline, kept_baseline, since
from jouleswarm.runs.conservation import conservation

log = logging.getLogger("jouleswarm.recorder")

BROKERS = "the broker's counters, from the run's beginning"
CLIENTS = "the clients' own counters, for {why}"
NOT_OURS = "the broker is not JouleSwarm's and counts nothing for us"
COUNTS_NOTHING = "the broker was told to count nothing"
EARLIER = "the broker's counters, from its own beginning: the run had begun before its recorder came"
NO_ROOM = "it had no room to count {} messages under this run's name"
GONE = "some that it had at the run's beginning are gone, as of a broker that was started again without its state"


@dataclass(frozen=True)
class Answer:
    """The broker's counters of a run; no rows from one that counts nothing for us, and why."""

    rows: tuple[MeterRow, ...] = ()
    unmetered: int = 0
    """Messages that it had no room to count."""
    why_none: str = ""


class Counted(NamedTuple):
    """What the broker counted of a run, and whose counters feed its bill, in words."""

    rows: list[MeterRow]
    source: str


class BrokerCounters:
    """Asks the broker for a run's counters, as often as it takes."""

    def __init__(self, listener: Listener, run: str, settings: BusSettings) -> None:
        self._listener, self._bus, self._run, self._settings = listener, listener.bus, run, settings
        listener.handlers |= {"limits": self._take_limits, "ack": self._take_echo}
        self._echo_topic = topics.acknowledgement(run, topics.RECORDER)
        self._filters: list[str] = []
        self._pieces: dict[str, dict[int, CountersPiece]] = {}
        self._answer: Answer | None = None
        self._token, self._is_ours, self._has_echo = "", False, False
        self._baseline: list[MeterRow] = []

    def begin(self, folder: Path | None, patience_s: float) -> None:
        """Learn what the broker has counted under this run's name before; kept in `folder` for who goes on with it.

        Raises:
            RunError: as `fetch`, or what was kept is damaged.
        """
        kept = kept_baseline(folder / BASELINE) if folder is not None else None
        self._baseline = list(self.fetch(patience_s).rows) if kept is None else kept
        if folder is not None and kept is None:
            keep_baseline(folder / BASELINE, self._baseline)

    def end(self, patience_s: float, clients: Sequence[MeterRow]) -> Counted:
        """What the broker has counted since `begin`; `clients`: what the processes of the run have counted.

        Raises:
            RunError: as `fetch`.
        """
        told = self.fetch(patience_s)
        if told.why_none:
            return Counted([], CLIENTS.format(why=told.why_none))
        rows, any_gone = since(told.rows, self._baseline)
        if not fits(rows, clients):
            # Processes that were there before the recorder, or go on from a state of then, have counted longer than it.
            own, others = (
                [row for row in each if (row.client == topics.RECORDER) == is_own]
                for each, is_own in ((rows, True), (told.rows, False))
            )
            if fits(whole := [*others, *own], clients):
                return Counted(whole, EARLIER)
        said = [BROKERS, *([GONE] if any_gone else ()), *([NO_ROOM.format(told.unmetered)] if told.unmetered else ())]
        return Counted(rows, "; ".join(said))

    def fetch(self, patience_s: float) -> Answer:
        """What the broker has counted by now.

        A broker takes a client's messages in their order: one that has sent back what came after the question, and has
        told neither limits nor counters, knows no such questions.

        Raises:
            RunError: a broker that is ours has not answered for `patience_s`; 0 waits for ever.
        """
        begun, self._answer, self._has_echo = time.monotonic(), None, False

        def given_up() -> bool:
            limit_s = patience_s if self._is_ours else self._settings.connect_timeout_s
            return bool(limit_s) and time.monotonic() - begun > limit_s

        def ask_again() -> None:
            log.warning("no answer to the question for the broker's counters yet; asking again")
            self._ask()

        self._subscribe(topics.BROKER_LIMITS, self._echo_topic)
        self._ask()
        self._listener.until(lambda: self._is_known or given_up(), lambda: "the broker's counters", ask_again)
        self._bus.unsubscribe(*self._filters)
        self._filters.clear()
        self._pieces.clear()
        if self._answer is None and self._is_ours:
            raise RunError(f"the broker has not answered the question for its counters for {patience_s:g} s")
        return self._answer or Answer(why_none=NOT_OURS)

    @property
    def _is_known(self) -> bool:
        # The echo is waited for anyway: nothing of this may come later.
        return self._has_echo and (self._answer is not None or not self._is_ours)

    def _ask(self) -> None:
        self._token = secrets.token_hex(8)
        self._listener.handlers[self._token] = self._take
        self._subscribe(topics.broker_answer(self._token))
        self._bus.publish(topics.BROKER_METER_ASK, encode_json(CountersRequest(asked=self._token, run=self._run)))
        self._bus.publish(self._echo_topic, encode_json(Acknowledgement(topic=self._echo_topic, part=self._token)))

    def _subscribe(self, *filters: str) -> None:
        self._bus.subscribe(*filters)
        self._filters += filters

    def _take_limits(self, message: Message) -> None:
        decode_json(message.payload, BrokerLimits)
        self._is_ours = True

    def _take_echo(self, message: Message) -> None:
        told = decode_json(message.payload, Acknowledgement)
        self._has_echo = self._has_echo or told.part == self._token

    def _take(self, message: Message) -> None:
        """A piece of the answer to any of the questions; the first that is whole counts."""
        piece = decode_json(message.payload, CountersPiece, PIECE_BYTES)
        self._is_ours = True
        held = self._pieces.setdefault(message.topic, {})
        held[piece.piece] = piece
        if len(held) == piece.pieces:
            rows = tuple(row for _, each in sorted(held.items()) for row in each.rows)
            self._answer = Answer(rows, piece.unmetered) if piece.metering else Answer(why_none=COUNTS_NOTHING)


def fits(rows: Sequence[MeterRow], clients: Sequence[MeterRow]) -> bool:
    """Whether the broker's counters do not contradict the clients'."""
    found = conservation([*rows, *clients])
    return found is None or not found.broken
