"""How large a message one broker takes: what it has told, and what it must be if it tells nothing."""

from __future__ import annotations

import logging

from pydantic import ValidationError

from jouleswarm.common.bus.address import BrokerAddress
from jouleswarm.common.bus.suspects import CONNECTIONS
from jouleswarm.common.errors import MessageTooLargeError
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.broker_counters import BrokerLimits
from jouleswarm.common.wire.mqtt import MAX_LENGTH, publish_body_bytes

logger = logging.getLogger("bus")


class SizeLimit:
    """The limit of the broker at `address`."""

    def __init__(self, address: BrokerAddress) -> None:
        self._address = address
        self.told_bytes: int | None = None
        """Of a PUBLISH packet's remaining length, as the broker has told it on this connection."""

    def learn(self, payload: memoryview) -> None:
        """Take a message on `topics.BROKER_LIMITS`."""
        try:
            self.told_bytes = BrokerLimits.model_validate_json(bytes(payload)).message_bytes
        except ValidationError as error:
            logger.warning("ignored a message on %s: %s", topics.BROKER_LIMITS, error.errors()[0]["msg"])

    def check(self, topic: str, payload_bytes: int, qos: int) -> None:
        """Whether the broker takes a message, as far as it has told.

        Raises:
            MessageTooLargeError: it does not.
        """
        size_bytes, limit_bytes = publish_body_bytes(topic, payload_bytes, qos), self.told_bytes or MAX_LENGTH
        if size_bytes > limit_bytes:
            raise MessageTooLargeError(
                f"message of {size_bytes} bytes on {topic}: broker {self._address} takes at most {limit_bytes}; "
                "raise its limit (--max-message-mb), or make what is sent smaller (network, federation.codec)"
            )

    def not_taken(self, topic: str, packet_bytes: int) -> None:
        """A message has ended so many connections that the broker does not take it.

        Raises:
            MessageTooLargeError: always.
        """
        raise MessageTooLargeError(
            f"message of {packet_bytes} bytes on {topic}: broker {self._address} closed the connection {CONNECTIONS} "
            "times in a row while this was sent or before it was acknowledged: its limit may be below, or it refuses "
            "this for another reason (see its log)"
        )
