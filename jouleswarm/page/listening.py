"""A deployment elsewhere, as it is heard on its bus: an onlooker, who says nothing."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Self

from jouleswarm.common.bus.bus import Bus, Message
from jouleswarm.common.bus.credentials import credentials_of
from jouleswarm.common.bus.listener import Listener
from jouleswarm.common.bus.mqtt import MqttBus
from jouleswarm.common.bus.reporter import Telemetry
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import Presence, decode_json
from jouleswarm.common.wire.names import client_of
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.fleet.admission import check_presence, check_row
from jouleswarm.page.milestones import milestones
from jouleswarm.page.model import Shown, shown
from jouleswarm.runs.events import Event
from jouleswarm.runs.metering import RowTime
from jouleswarm.runs.run import Run

_CLIENT = "page"
_AT_ONCE_S = 0.3  # that is taken before something is shown
_KEPT_EVENTS = 1000


class Deployment:
    """What a run's processes have told since the page came. Bytes and joules are those of the rounds' closed form,
    which needs the newest row of each robot and no others."""

    def __init__(self, bus: Bus, scenario: Scenario, run: str) -> None:
        self.title, self.where = run, ""
        self._scenario, self._run, self._began_s = scenario, run, time.time()
        self._rows: dict[object, RoundRow] = {}
        self._times: list[RowTime] = []
        self._events: list[Event] = []
        self._gone: set[str] = set()
        self._found: Shown | None = None
        self._listener = Listener(bus, scenario.bus.resend_after_s)
        self._listener.handlers |= {"round": self._take_row, "presence": self._take_presence}
        bus.subscribe(topics.telemetry(run, "+", "+"), topics.presence(run, "+", "+"))

    @classmethod
    def connect(cls, url: str, scenario: Scenario, run: str, keys: Path | None) -> Self:
        """Listen on the broker at `url`; `keys`: a folder with the recorder's, whose rights are enough.

        Raises:
            ConfigurationError: the broker refuses it, or the URL is none.
            BrokerUnreachableError: no broker answers.
        """
        timeout_s = scenario.bus.connect_timeout_s
        credentials = credentials_of(keys, topics.RECORDER)
        return cls(
            MqttBus.connect(url, _CLIENT, credentials=credentials, connect_timeout_s=timeout_s),
            scenario,
            topics.run_name(run),
        )

    def look(self) -> Shown | None:
        """Take what has come."""
        until_s, is_new = time.monotonic() + _AT_ONCE_S, self._found is None
        while time.monotonic() < until_s and self._listener.take_next(0):
            is_new = True
        if is_new:
            self._found = self._show()
        return self._found

    def _show(self) -> Shown:
        rows = list(self._rows.values())
        run = Run(Path(self._run), {"run": self._run}, self._scenario, rows, [], [], None, [])
        events = sorted([*self._events, *milestones(run, self._times)], key=lambda event: event.time_s)
        return shown(run, "listening", time.time() - self._began_s, events)

    def _take_row(self, message: Message) -> None:
        row = decode_json(message.payload, Telemetry).row
        check_row(row, message.topic.split("/")[-2], self._scenario)
        self._rows[row.sort_key()] = row
        told = row.model_dump(include={"phase", "arm", "task", "agent", "round"})
        self._times.append(RowTime(time_s=time.time(), **told))

    def _take_presence(self, message: Message) -> None:
        if not message.payload:
            return
        presence = decode_json(message.payload, Presence)
        check_presence(presence, message.topic, self._scenario, self._run)
        client = client_of(presence.agent)
        if presence.state == "gone" and client not in self._gone:
            self._gone.add(client)
            self._happened(f"{client} is gone: its connection broke off")
        elif presence.state == "here" and client in self._gone:
            self._gone.discard(client)
            self._happened(f"{client} is back")

    def _happened(self, text: str) -> None:
        self._events = [*self._events[-_KEPT_EVENTS:], Event(time_s=time.time(), text=text)]
