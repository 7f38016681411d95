"""The recorder: hears what the processes report over the bus and writes the run directory."""

from __future__ import annotations

import logging
import time
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Literal

from jouleswarm.common.bus.agreement import proclamation
from jouleswarm.common.bus.bus import Bus, Message
from jouleswarm.common.bus.listener import Listener
from jouleswarm.common.bus.reporter import MAX_REPORT_BYTES, MeterReport, Telemetry
from jouleswarm.common.errors import BrokerUnreachableError, RunError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import Acknowledgement, Presence, decode_json, encode_json
from jouleswarm.common.wire.names import client_of, clients_of
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.common.wire.saved_models import check_model
from jouleswarm.fleet.admission import check_report, check_row, learned_name, snapshot_name
from jouleswarm.fleet.attendance import Attendance
from jouleswarm.fleet.broker_counters import CLIENTS, BrokerCounters
from jouleswarm.fleet.handed_in import HandedIn
from jouleswarm.fleet.spent import Spent
from jouleswarm.runs.directory import RunDirectory
from jouleswarm.runs.summary import summarise
from jouleswarm.runs.traffic import DATA_CENTER

log = logging.getLogger("jouleswarm.recorder")

CLIENT = topics.RECORDER
Status = Literal["complete", "interrupted", "failed"]
_PROGRESS_EVERY_S = 0.5
_FAREWELL_S = 5.0


class Recorder:
    """Writes down a run from its beginning to the last process's byte counters."""

    def __init__(
        self, bus: Bus, scenario: Scenario, run: str, directory: RunDirectory, state: Path | None = None
    ) -> None:
        """`state`: folder with a folder of each process's counters, for those that hand in none."""
        self._state = state
        self._bus, self._scenario, self._run, self._directory = bus, scenario, run, directory
        self.run = run
        self._progress_at = 0.0
        self._reports = HandedIn()
        self._processors: dict[str, str] = {}
        self._attendance = Attendance(bus, scenario, run)
        self._listener = Listener(bus, scenario.bus.resend_after_s)
        self._listener.handlers |= {
            "round": self._take_row,
            "learned": self._take_learned,
            "snapshot": self._take_snapshot,
            "presence": self._take_presence,
            "wait": self._attendance.take_wait,
        }
        self._listener.otherwise = self._take_report
        self._filters = [
            topics.telemetry(run, "+", "+"),
            topics.learned(run, "+", "+"),
            topics.snapshot(run, "+", "+"),
            topics.meter_report(run, "+"),
            topics.presence(run, "+", "+"),
        ]
        self.newest = {(row.arm, row.task, row.agent): row for row in directory.rows}
        self.on_row: Callable[[RoundRow], None] = lambda row: None
        self.spent = Spent(scenario, resumed=bool(directory.rows))
        self._broker = BrokerCounters(self._listener, run, scenario.bus)
        self._broker.begin(state and state / CLIENT, scenario.federation.give_up_after_s)
        bus.subscribe(*self._filters)
        bus.publish(topics.scenario(run, CLIENT), proclamation(scenario), retain=True)
        bus.publish(topics.recorder(run), encode_json(Presence(agent=0)), retain=True)

    @property
    def refused(self) -> int:
        """Messages refused so far."""
        return self._listener.refused

    @property
    def waiting_for(self) -> list[str]:
        """Processes that have not handed in their counters yet, or are back since."""
        whole, there = self._reports.whole, self._attendance
        left = [client for client in self._clients if client not in whole or there.is_again(client)]
        return [] if all(there.is_left_out(client) for client in left) else left

    @property
    def stages(self) -> dict[str, int]:
        """How far each process has come (see agents/agent.py); 2 * arms + 1: done."""
        return self._attendance.stages

    @property
    def waits(self) -> list[str]:
        """Who waits for what, and for how long nothing has come of it, the longest first: what lasts, in words."""
        return self._attendance.waits(self.waiting_for)

    @property
    def robots(self) -> Counter[str]:
        """How many robots are awaited, here, gone and done."""
        whole, there = self._reports.whole, self._attendance
        return Counter(there.state(client, whole) for client in clients_of(self._scenario.agents))

    @property
    def received_bytes(self) -> dict[str, int]:
        """Payload bytes that all clients have received so far, by link class."""
        return self.spent.received

    @property
    def rows(self) -> list[RoundRow]:
        """Rows so far."""
        return self._directory.rows

    @property
    def elapsed_s(self) -> float:
        """Seconds since the recorder began to listen."""
        return self._attendance.elapsed_s

    def pump(self, timeout_s: float) -> None:
        """Take what comes within `timeout_s`; a message that cannot be read is left out with a warning."""
        until = time.monotonic() + timeout_s
        while (left_s := until - time.monotonic()) > 0 and self._listener.take_next(left_s):
            pass

    def check(self, *, restarted: bool = False) -> None:
        """Notice a process that died and has not come back; `restarted`: somebody else sees to it that it does.

        Raises:
            RunError: one has been gone for longer than a lost connection may take to be won back, or nothing has been
                heard of it for too long (federation.give_up_after_s).
        """
        self._attendance.check(self.waiting_for, self._reports.whole, restarted=restarted)

    @property
    def _clients(self) -> list[str]:
        """All processes that are to hand in counters."""
        return clients_of([*self._scenario.agents, *([0] if self._scenario.needs_datacenter else [])])

    def close(self, status: Status) -> None:
        """Fetch the broker's counters, write meter and summary, and tell the processes that stay for it.

        Raises:
            RunError: the broker has not answered, or rows were lost; all the same everything is written, as of a run
                that failed.
            BrokerUnreachableError: it is gone; the same.
        """
        settings = self._scenario
        failed: RunError | BrokerUnreachableError | None = None
        if status != "complete":
            self._bus.publish(topics.recorder(self._run), b"", retain=True)
        for whose in (CLIENT, topics.SHARED):
            self._bus.publish(topics.scenario(self._run, whose), b"", retain=True)
        # Nothing but the broker's answer is heard from here on, so that both sides' counts stand still.
        self._bus.unsubscribe(*self._filters)
        patience_s = settings.federation.give_up_after_s if status == "complete" else settings.bus.connect_timeout_s
        told = self._reports.final(self._clients, self._state)
        try:
            rows, source = self._broker.end(patience_s, told.rows)
        except (RunError, BrokerUnreachableError) as error:
            rows, source = [], CLIENTS.format(why=error)
            status, failed = "failed" if status == "complete" else status, error
        if (lost := self._directory.lost_rows()) and status == "complete":
            status, failed = "failed", RunError(f"{lost}; the run is not complete")
        if failed is not None:
            self._bus.publish(topics.recorder(self._run), b"", retain=True)
        meter = [*rows, *told.rows, *self._bus.meter.rows()]
        self._directory.meter(meter)
        self._directory.work(told.work)
        self._directory.joules(told.joules)
        results = partial(summarise, settings, self._directory.rows, meter, status=status, source=source)
        self._directory.summary(results(work_rows=told.work, joules_rows=told.joules))
        self._attendance.forget_done()
        if status == "complete":
            self._see_off()
        self._bus.close()
        if failed is not None:
            raise failed

    def _see_off(self) -> None:
        """Tell who stayed that the run is recorded, and see them go; remove what those left who went before."""
        word, present = topics.recorder(self._run), topics.presence(self._run, "+", "+")
        self._bus.publish(word, encode_json(Presence(agent=0, state="done")), retain=True)
        self._bus.subscribe(present)
        until = time.monotonic() + _FAREWELL_S
        while self._attendance.has_anybody and (left_s := until - time.monotonic()) > 0:
            self._listener.take_next(left_s)
            self._attendance.forget_done()
        if not self._attendance.has_anybody:  # else who comes late finds it
            self._bus.publish(word, b"", retain=True)

    def _take_report(self, message: Message) -> None:
        report = decode_json(message.payload, MeterReport, MAX_REPORT_BYTES)
        check_report(report, message.topic.rsplit("/", 1)[-1], self._clients, self._scenario)
        if (rounds := self._reports.take(report)) is not None:
            self._directory.complete(rounds)
            self._attendance.is_through(report.client)
        self._attendance.is_back(report.client)
        self._acknowledge(message.topic, report.client, report.part)

    def _acknowledge(self, topic: str, client: str, part: str = "") -> None:
        """Tell a client that what it published on `topic` is written down."""
        told = Acknowledgement(topic=topic, part=part)
        self._bus.publish(topics.acknowledgement(self._run, client), encode_json(told))

    def _take_learned(self, message: Message) -> None:
        task = message.topic.split("/")[-2]
        self._keep_model(message, learned_name(topics.arm_of(message.topic), task, self._scenario))
        for agent in self._scenario.cluster(int(task)):  # the first of them, or the first that is left
            self._acknowledge(message.topic, client_of(agent))

    def _take_snapshot(self, message: Message) -> None:
        round_ = message.topic.split("/")[-2]
        self._keep_model(message, snapshot_name(topics.arm_of(message.topic), round_, self._scenario))
        self._acknowledge(message.topic, DATA_CENTER)

    def _keep_model(self, message: Message, name: str) -> None:
        check_model(message.payload)
        self._directory.weights(name, message.payload)

    def _take_presence(self, message: Message) -> None:
        if (presence := self._attendance.take_presence(message, self._reports.whole)) is None:
            return
        if presence.processor is not None:
            self._note_processor(client_of(presence.agent), presence.processor)

    def _note_processor(self, client: str, processor: str) -> None:
        if self._processors.get(client) == processor:
            return
        if self._processors and processor not in self._processors.values():
            told = "%s computes on %s, others on %s: weights may be others than on one alone"
            log.warning(told, client, processor, next(iter(self._processors.values())))
        self._processors[client] = processor
        self._directory.computed_on(client, processor)

    def _take_row(self, message: Message) -> None:
        telemetry, client = decode_json(message.payload, Telemetry), message.topic.split("/")[-2]
        row = telemetry.row
        check_row(row, client, self._scenario)
        self._directory.round(row, time.time())
        self.newest[row.arm, row.task, row.agent] = row
        self.on_row(row)
        self.spent.take(row, telemetry.received)
        self._attendance.is_back(client)
        if self.elapsed_s - self._progress_at >= _PROGRESS_EVERY_S:
            self._progress_at = self.elapsed_s
            self._directory.progress({"time_s": round(self.elapsed_s, 3), "bytes": self.received_bytes})
