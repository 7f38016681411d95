"""What every service of the data center does with the bus: listen, refuse what is not right, know who is where."""

from __future__ import annotations

import logging

from common import topics
from common.bus import Bus, Message
from common.errors import PayloadError
from common.payloads import Presence, decode_json
from common.scenario import Scenario

log = logging.getLogger("jouleswarm.datacenter")


class Desk:
    """One arm's or method's subscriptions, and how far each robot has come (see agents/agent.py)."""

    def __init__(self, bus: Bus, scenario: Scenario, run: str, arm: str) -> None:
        self._bus, self._scenario, self._run, self._arm = bus, scenario, run, arm
        self._stages: dict[int, int] = dict.fromkeys(scenario.agents, -1)
        self.refused = 0
        self.subscriptions = [topics.presence(run, scenario.task_of(agent), agent) for agent in scenario.agents]

    def listen(self) -> None:
        """Begin to hear."""
        self._bus.subscribe(*self.subscriptions, qos=self._scenario.bus.qos)

    def leave(self) -> None:
        """Hear nothing more."""
        self._bus.unsubscribe(*self.subscriptions)

    def all_reached(self, stage: int) -> bool:
        """Whether every robot of the scenario has come as far as `stage`."""
        return all(reached >= stage for reached in self._stages.values())

    def take_next(self, timeout_s: float) -> bool:
        """Take one message; one that is not what its topic promises is refused and counted. False after a timeout."""
        message = self._bus.receive(timeout_s)
        if message is None:
            return False
        try:
            self.take(message)
        except PayloadError as error:
            self.refused += 1
            log.warning("refused a message on %s: %s", message.topic, error)
        return True

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
            elif presence.agent in self._stages:
                self._stages[presence.agent] = presence.stage
