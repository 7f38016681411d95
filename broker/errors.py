"""Why a connection ends."""

from __future__ import annotations


class PeerGone(ConnectionError):
    """The connection has ended; its text says why."""


class MalformedPacket(Exception):
    """A packet that MQTT 3.1.1 does not allow. It costs its sender the connection, nobody else anything."""

    event = "refused_malformed"


class NotAccepted(MalformedPacket):
    """A CONNECT that is answered by a return code before its connection ends (MQTT 3.1.1, section 3.2.2.3)."""

    def __init__(self, code: int, text: str) -> None:
        super().__init__(text)
        self.code = code


class MessageTooLarge(MalformedPacket):
    """A packet over the size limit, known from its fixed header, before anything is allocated."""

    event = "refused_too_large"


class TlsFailed(MalformedPacket):
    """A connection that never came as far as MQTT."""

    event = "refused_tls"
