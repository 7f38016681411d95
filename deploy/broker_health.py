"""Health check of a broker container: connect as an MQTT client would, and be let in.

Standard library only: it runs every few seconds beside the broker and has to cost next to nothing.
"""

from __future__ import annotations

import socket
import sys

# MQTT 3.1.1, sections 3.1, 3.2 and 3.14: CONNECT (clean session, keepalive 60 s, no client id), CONNACK, DISCONNECT.
CONNECT = b"\x10\x0c" + b"\x00\x04MQTT" + b"\x04" + b"\x02" + b"\x00\x3c" + b"\x00\x00"
ACCEPTED = b"\x20\x02\x00\x00"
DISCONNECT = b"\xe0\x00"
TIMEOUT_S = 3.0


def check(host: str, port: int) -> str | None:
    """What is wrong with the broker, or None."""
    try:
        with socket.create_connection((host, port), TIMEOUT_S) as connection:
            connection.sendall(CONNECT)
            answer = connection.recv(len(ACCEPTED), socket.MSG_WAITALL)
            connection.sendall(DISCONNECT)
    except OSError as error:
        return f"no broker at {host}:{port}: {error}"
    return None if answer == ACCEPTED else f"CONNECT was answered by {answer.hex(' ')}, expected {ACCEPTED.hex(' ')}"


if __name__ == "__main__":
    sys.exit(check("127.0.0.1", 1883))
