"""No wait without a name and an end: who is waited for is asked how it is, and one that stands still is given up.

A process that waits for another that learns, however long, is not stuck; one that waits for somebody who is gone is,
and so is everybody who waits for that one. So who is waited for is asked, and answers for how long nothing has come of
its own wait: 0 while it learns. A wait ends when that, or the silence of who does not answer, has lasted
`federation.give_up_after_s`; also where some wait for each other in a circle. Nobody's counters hold these messages.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence

from jouleswarm.common.bus.bus import Bus, Message
from jouleswarm.common.errors import RunError
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import MAX_TOLD, Wait, decode_json, encode_json


def _nowhere(client: str) -> tuple[int, int]:
    return 0, 0


def left_behind(who: str, there: str, me: str, here: str, run: str) -> RunError:
    """Somebody is further than it can be with this process."""
    return RunError(
        f"{who} is {there} already, and {me} comes with {here}: its state is lost or of another time; give it the "
        f"--state folder that it had in run {run}, or start all with an empty one"
    )


class Patience:
    """What a process knows of those that it waits for, and tells those that wait for it."""

    def __init__(self, bus: Bus, run: str, give_up_after_s: float) -> None:
        """`give_up_after_s`: 0 for never."""
        self._bus, self._run, self._limit_s = bus, run, give_up_after_s or math.inf
        self.place: Callable[[str], tuple[int, int]] = _nowhere
        """Stage and round that this process has come to, as it concerns a client."""
        self.told: Callable[[Wait], None] = lambda wait: None
        """What is done with the word of one that is waited for."""
        self._whom: Sequence[str] = ()
        self._what, self._from_s = "", 0.0
        self._heard: dict[str, float] = {}
        self._waits: dict[str, str] = {}
        bus.subscribe(topics.wait(run, bus.client))

    def begin(self) -> None:
        """From now on something is waited for."""
        self._whom, self._from_s = (), time.monotonic()
        self._heard, self._waits = {}, {}

    def end(self) -> None:
        """It has come."""
        self._what, self._whom = "", ()

    def heard(self, client: str, ago_s: float = 0.0) -> None:
        """A client did something so long ago."""
        self._heard[client] = max(self._heard.get(client, self._from_s), time.monotonic() - ago_s)

    def silent_s(self, client: str) -> float:
        """For how long nothing has been heard of a client since it is waited for."""
        return time.monotonic() - self._heard.get(client, self._from_s)

    def ask(self, whom: Sequence[str], what: str) -> None:
        """`what` has not come for a while: say so to the recorder, and ask those who are to send it.

        Raises:
            RunError: one of them has been silent, or stuck itself, for too long.
        """
        self._whom, self._what = whom, what
        for client in whom:
            self._say(client, asks=True)
        if topics.RECORDER not in (*whom, self._bus.client):
            self._say(topics.RECORDER, asks=False)
        if self._quiet_s() >= self._limit_s:
            raise RunError(self._gave_up())

    def take(self, message: Message) -> None:
        """Another process asks, or tells.

        Raises:
            PayloadError: it cannot be read.
        """
        wait = decode_json(message.payload, Wait)
        if wait.asks:
            self._say(wait.client, asks=False)
        elif wait.client in self._whom:
            self.heard(wait.client, wait.quiet_s)
            self._waits[wait.client] = wait.what
            self.told(wait)

    def _quiet_s(self) -> float:
        """For how long nothing has come of the wait."""
        if not self._what:
            return 0.0
        return max((self.silent_s(client) for client in self._whom), default=time.monotonic() - self._from_s)

    def _say(self, client: str, *, asks: bool) -> None:
        stage, round_ = self.place(client)
        wait = Wait(
            client=self._bus.client,
            asks=asks,
            what=self._what[:MAX_TOLD],
            quiet_s=round(self._quiet_s(), 3),
            stage=stage,
            round=round_,
        )
        self._bus.publish(topics.wait(self._run, client), encode_json(wait))

    def _gave_up(self) -> str:
        limit = f"{self._limit_s:g} s of federation.give_up_after_s"
        if not self._whom:
            return f"gave up waiting for {self._what}: nothing came within the {limit}; start the run again"
        slowest = max(self._whom, key=self.silent_s)
        waits = self._waits.get(slowest)
        why = f"{slowest} waits for {waits}" if waits else f"{slowest} was not heard of"
        return f"gave up waiting for {self._what}: {why} within the {limit}; start it (again), or all to go on"
