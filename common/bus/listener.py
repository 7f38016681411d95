"""A process's ear: sorts what comes from the bus to who knows what to do with it, and waits for what must come."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence

from jouleswarm.common.bus.bus import Bus, Message
from jouleswarm.common.bus.patience import Patience
from jouleswarm.common.errors import PayloadError
from jouleswarm.common.wire.names import clients_of

log = logging.getLogger("jouleswarm.bus")

Take = Callable[[Message], None]


class Listener:
    """Takes the messages of a bus. One thread. A message that is not what its topic promises is refused and counted."""

    def __init__(self, bus: Bus, quiet_s: float, patience: Patience | None = None) -> None:
        """`quiet_s`: after so long without what is waited for it is asked for again; `patience`: gives it up."""
        self.bus, self._quiet_s, self.patience = bus, quiet_s, patience
        self.handlers: dict[str, Take] = {} if patience is None else {"wait": patience.take}
        """What is done with a message, by the last level of its topic."""
        self.otherwise: Take = lambda message: None
        """What is done with all others."""
        self.refused = 0

    def take_next(self, timeout_s: float) -> bool:
        """Take one message; False if none comes within `timeout_s`."""
        energy = self.bus.meter.energy
        with energy.during("idle"):
            message = self.bus.receive(timeout_s)
        if message is None:
            return False
        try:
            with energy.during("communication"):
                self.handlers.get(message.topic.rsplit("/", 1)[-1], self.otherwise)(message)
        except PayloadError as error:
            self.refuse(f"a message on {message.topic}", error)
        return True

    def refuse(self, what: str, error: PayloadError) -> None:
        """Count something that cannot be used, and go on."""
        self.refused += 1
        log.warning("refused %s: %s", what, error)

    def take_waiting(self) -> None:
        """Take all that has come."""
        while self.take_next(0):
            pass

    def repeated(self, message: Message, qos: int) -> None:
        """Book a message that had come before: sent again because somebody or something failed."""
        self.bus.meter.publish(self.bus.client, message.topic, "repeated", len(message.payload), qos)

    def until_none_is(
        self,
        missing: Callable[[], Sequence[int]],
        what: str,
        ask: Callable[[int], None] = lambda robot: None,
        *,
        at_once: bool = False,
    ) -> None:
        """Take messages until no robot is `missing`, and `ask` each that is again; `what`: of them, with {}."""

        def ask_again() -> None:
            for robot in missing():
                ask(robot)

        self.until(
            lambda: not missing(),
            lambda: what.format(list(missing())),
            ask_again,
            at_once=at_once,
            whom=lambda: clients_of(missing()),
        )

    def until(
        self,
        condition: Callable[[], bool],
        what: Callable[[], str],
        ask_again: Callable[[], None] | None = None,
        *,
        at_once: bool = False,
        whom: Callable[[], Sequence[str]] = tuple,
    ) -> None:
        """Take messages until `condition` holds; `whom`: the clients that it takes for that.

        After each quiet spell say what is missing and ask for it; at once where the connection was lost meanwhile, for
        what was sent then has not come, or with `at_once`.

        Raises:
            RunError: nothing has come of it for too long (see common/bus/patience.py).
        """
        if self.patience is not None:
            self.patience.begin()
        quiet_from, connections = time.monotonic(), self.bus.connections - at_once
        while not condition():
            # At least once a second, for conditions that hold by the clock.
            self.take_next(min(1.0, self._quiet_s) if connections == self.bus.connections else 0)
            if condition():
                break
            lost = connections != self.bus.connections
            if lost or time.monotonic() - quiet_from >= self._quiet_s:
                log.info("waiting for %s", what())
                if ask_again is not None:
                    ask_again()
                if self.patience is not None:
                    self.patience.ask(whom(), what())
                quiet_from, connections = time.monotonic(), self.bus.connections
        if self.patience is not None:
            self.patience.end()
