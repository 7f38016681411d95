"""What every service of the data center does with the bus: listen, refuse what is not right, know who is where."""

from __future__ import annotations

import logging
import time

from jouleswarm.common.bus.bus import Message
from jouleswarm.common.bus.listener import Listener
from jouleswarm.common.errors import PayloadError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import Presence, Wait, decode_json

log = logging.getLogger("jouleswarm.datacenter")


class Desk:
    """One arm's or method's subscriptions, and how far each robot has come (see agents/robot.py)."""

    def __init__(self, listener: Listener, scenario: Scenario, run: str, arm: str) -> None:
        self._listener, self._bus, self._scenario, self._run, self._arm = listener, listener.bus, scenario, run, arm
        self._stages: dict[int, int] = dict.fromkeys(scenario.agents, -1)
        self._gone: dict[int, float] = {}
        self.subscriptions = [topics.presence(run, scenario.task_of(agent), agent) for agent in scenario.agents]

    @property
    def refused(self) -> int:
        """Messages refused so far."""
        return self._listener.refused

    def listen(self) -> None:
        """Begin to hear."""
        self._listener.otherwise = self.take
        if self._listener.patience is not None:
            self._listener.patience.place, self._listener.patience.told = self.place, self.told
        self._bus.subscribe(*self.subscriptions, qos=self._scenario.bus.qos)

    def behind(self, stage: int) -> list[int]:
        """Robots that have not come as far as `stage`, but those that are left out."""
        return [each for each, reached in self._stages.items() if reached < stage and not self.is_left_out(each)]

    def place(self, client: str) -> tuple[int, int]:
        """Stage and round that the data center has come to, for who asks (see common/bus/patience.py)."""
        return 0, 0

    def told(self, wait: Wait) -> None:
        """The answer of a robot that is waited for.

        Raises:
            RunError: it is further than it can be with this data center.
        """

    def leave(self) -> None:
        """Hear nothing more."""
        self._bus.unsubscribe(*self.subscriptions)

    def all_reached(self, stage: int) -> bool:
        """Whether every robot of the scenario, but those that are left out, has come as far as `stage`."""
        return not self.behind(stage)

    def is_left_out(self, agent: int) -> bool:
        """Whether a robot has been gone for so long that the others go on without it (federation.on_missing)."""
        settings, since_s = self._scenario.federation, self._gone.get(agent)
        if settings.on_missing == "wait" or since_s is None:
            return False
        return time.monotonic() - since_s >= settings.missing_after_s

    def repeated(self, message: Message) -> None:
        """Book a message that had come before."""
        self._listener.repeated(message, self._scenario.bus.qos)

    def take(self, message: Message) -> None:
        """Sort one message into place: here a robot's presence.

        Raises:
            PayloadError: it cannot be read.
        """
        if message.topic.endswith("/presence") and message.payload:
            presence = decode_json(message.payload, Presence)
            if presence.agent != int(message.topic.split("/")[5]):
                raise PayloadError(f"presence of robot {presence.agent}, expected the topic's")
            if presence.state == "gone":
                log.warning("robot %d is gone; waiting for it to come back", presence.agent)
                self._gone.setdefault(presence.agent, time.monotonic())
            elif presence.agent in self._stages:
                self._stages[presence.agent] = max(self._stages[presence.agent], presence.stage)
                self._gone.pop(presence.agent, None)
