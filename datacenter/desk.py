"""What every service of the data center does with the bus: listen, refuse what is not right, know who is where."""

from __future__ import annotations

import logging

from common import topics
from common.bus import Message
from common.listener import Listener
from common.payloads import Presence, decode_json
from common.scenario import Scenario

log = logging.getLogger("jouleswarm.datacenter")


class Desk:
    """One arm's or method's subscriptions, and how far each robot has come (see agents/agent.py)."""

    def __init__(self, listener: Listener, scenario: Scenario, run: str, arm: str) -> None:
        self._listener, self._bus, self._scenario, self._run, self._arm = listener, listener.bus, scenario, run, arm
        self._stages: dict[int, int] = dict.fromkeys(scenario.agents, -1)
        self.subscriptions = [topics.presence(run, scenario.task_of(agent), agent) for agent in scenario.agents]

    @property
    def refused(self) -> int:
        """Messages refused so far."""
        return self._listener.refused

    def listen(self) -> None:
        """Begin to hear."""
        self._listener.otherwise = self.take
        self._bus.subscribe(*self.subscriptions, qos=self._scenario.bus.qos)

    def leave(self) -> None:
        """Hear nothing more."""
        self._bus.unsubscribe(*self.subscriptions)

    def all_reached(self, stage: int) -> bool:
        """Whether every robot of the scenario has come as far as `stage`."""
        return all(reached >= stage for reached in self._stages.values())

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
            if presence.state == "gone":
                log.warning("robot %d is gone; waiting for it to come back", presence.agent)
            elif presence.agent in self._stages:
                self._stages[presence.agent] = presence.stage
