"""Who of a run's processes is there, who is gone, and who waits for what, as the recorder hears of it."""

from __future__ import annotations

import time
from collections.abc import Collection

from jouleswarm.common.bus.bus import Bus, Message
from jouleswarm.common.bus.patience import Patience
from jouleswarm.common.errors import RunError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.messages import Presence, Wait, decode_json
from jouleswarm.common.wire.names import client_of
from jouleswarm.fleet.admission import check_presence

_FORGOTTEN_AFTER = 3  # times bus.resend_after_s, after which a wait that is not told again is over


class Attendance:
    """By the plain name of each client."""

    def __init__(self, bus: Bus, scenario: Scenario, run: str) -> None:
        self._bus, self._scenario, self._run = bus, scenario, run
        self._begun = self._asked_s = time.monotonic()
        self._gone: dict[str, float] = {}
        self._again: set[str] = set()
        self._present: dict[str, Presence] = {}
        self._waits: dict[str, tuple[float, Wait]] = {}
        self.stages: dict[str, int] = {}
        """How far each process has come."""
        self._patience = Patience(bus, run, scenario.federation.give_up_after_s)
        self._patience.begin()

    @property
    def elapsed_s(self) -> float:
        """Seconds since the recorder began to listen."""
        return time.monotonic() - self._begun

    @property
    def has_anybody(self) -> bool:
        """Whether any process's presence stands on the broker."""
        return bool(self._present)

    def is_again(self, client: str) -> bool:
        """Whether it has handed in all, and was killed and has come back since: what it counts now is to come."""
        return client in self._again

    def is_left_out(self, client: str) -> bool:
        """Whether a process is gone for good and the others go on without it (federation.on_missing)."""
        settings, since_s = self._scenario.federation, self._gone.get(client)
        if settings.on_missing == "wait" or since_s is None:
            return False
        return self.elapsed_s - since_s > settings.missing_after_s

    def state(self, client: str, has_all_of: Collection[str]) -> str:
        """`awaited`, `here`, `gone`, or `done`: it has handed in all."""
        if client in has_all_of and client not in self._again:
            return "done"
        if client in self._gone:
            return "gone"
        return "here" if client in self.stages else "awaited"

    def is_back(self, client: str) -> None:
        """It has said something: it is there, and has got on."""
        self._gone.pop(client, None)
        self._patience.heard(client)
        self._waits.pop(client, None)

    def is_through(self, client: str) -> None:
        """It has handed in all."""
        self._again.discard(client)

    def waits(self, waiting_for: Collection[str]) -> list[str]:
        """Who waits for what, and for how long nothing has come of it, the longest first: what lasts, in words."""
        now_s, after_s = time.monotonic(), self._scenario.bus.resend_after_s
        told = {
            client: (now_s - at_s + wait.quiet_s, f"{client} waits for {wait.what}")
            for client, (at_s, wait) in self._waits.items()
            if now_s - at_s < _FORGOTTEN_AFTER * after_s
        }
        silent = [
            (self._patience.silent_s(client), f"nothing heard of {client}")
            for client in self._silent(waiting_for)
            if client not in told
        ]
        return [f"{what} ({quiet_s:.0f} s)" for quiet_s, what in sorted([*told.values(), *silent], reverse=True)]

    def check(self, waiting_for: Collection[str], has_all_of: Collection[str], *, restarted: bool = False) -> None:
        """Notice a process that died and has not come back; one that has handed in all may.

        `restarted`: those who are gone are started again, elsewhere perhaps, however long that takes.

        Raises:
            RunError: one has been gone for longer than a lost connection may take to be won back, or nothing has been
                heard of it for too long (federation.give_up_after_s).
        """
        if time.monotonic() - self._asked_s >= self._scenario.bus.resend_after_s:
            self._asked_s = time.monotonic()
            if silent := self._silent(waiting_for):
                self._patience.ask(silent, ", ".join(silent))
            else:
                self._patience.end()
        if restarted or self._scenario.federation.on_missing == "proceed":
            return
        for client, since_s in self._gone.items():
            if client not in has_all_of and self.elapsed_s - since_s > self._scenario.bus.connect_timeout_s:
                raise RunError(f"{client} died, its connection broke off; see what it printed")

    def take_presence(self, message: Message, has_all_of: Collection[str]) -> Presence | None:
        """Note where a process stands; None where the message only clears what stood there.

        Raises:
            PayloadError: it is no presence of this run.
        """
        if not message.payload:
            self._present.pop(message.topic, None)
            return None
        presence = decode_json(message.payload, Presence)
        check_presence(presence, message.topic, self._scenario, self._run)
        self._present[message.topic] = presence
        client = client_of(presence.agent)
        if presence.state == "gone":
            self._gone.setdefault(client, self.elapsed_s)
            self._again.discard(client)
        else:
            self.is_back(client)
            self.stages[client] = max(self.stages.get(client, 0), presence.stage)
            if presence.stage == 0 and client in has_all_of:
                self._again.add(client)
        return presence

    def take_wait(self, message: Message) -> None:
        """Note what a process waits for."""
        wait = decode_json(message.payload, Wait)
        self._patience.take(message)
        if wait.what:
            self._waits[wait.client] = (time.monotonic(), wait)

    def forget_done(self) -> None:
        """Remove the presences of processes that have gone, for good."""
        for topic in [topic for topic, presence in self._present.items() if presence.state != "here"]:
            del self._present[topic]
            self._bus.publish(topic, b"", retain=True)

    def _silent(self, waiting_for: Collection[str]) -> list[str]:
        """Processes that are waited for, and have not been heard of for a while."""
        after_s = self._scenario.bus.resend_after_s
        waiting = (client for client in waiting_for if not self.is_left_out(client))
        return [client for client in waiting if self._patience.silent_s(client) >= after_s]
