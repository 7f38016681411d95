"""One application message on its way through the broker, shared by all that receive it."""

from __future__ import annotations

from jouleswarm.broker.limits import OVERHEAD_BYTES, Budget
from jouleswarm.common.wire.mqtt import publish_head


class Publication:
    """Topic, payload and QoS as published. Its budget is given back when the last holder lets go."""

    __slots__ = ("_budget", "_cost_bytes", "_holders", "_topic_bytes", "payload", "qos", "topic")

    def __init__(
        self, topic: str, payload: memoryview, qos: int, budget: Budget | None = None, cost_bytes: int = 0
    ) -> None:
        self.topic = topic
        self.payload = payload
        self.qos = qos
        self._topic_bytes = topic.encode()
        self._budget = budget
        self._cost_bytes = cost_bytes
        self._holders = 1

    def hold(self) -> None:
        """One more receiver keeps the payload in memory."""
        self._holders += 1
        if self._budget is not None:
            self._budget.charge(OVERHEAD_BYTES)

    def drop(self) -> None:
        """A receiver (or the publisher's reader) is done with it."""
        self._holders -= 1
        if self._budget is None:
            return
        if self._holders == 0:
            self._budget.release(self._cost_bytes)
            self._cost_bytes = OVERHEAD_BYTES  # a persistent session may hold it again, to send it a second time
        else:
            self._budget.release(OVERHEAD_BYTES)

    def header(self, qos: int, packet_id: int, *, dup: bool, retain: bool) -> bytes:
        """Everything of the PUBLISH packet before the payload (MQTT 3.1.1, section 3.3); QoS 0 has no identifier."""
        return publish_head(self._topic_bytes, len(self.payload), qos, packet_id, dup=dup, retain=retain)
