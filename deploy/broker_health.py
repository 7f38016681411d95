"""Health check of a broker container: connect as an MQTT client would, and be let in.

With JOULESWARM_KEYS, a folder of keys, over TLS as the client `health` of it; else without TLS and user.
Standard library only: it runs every few seconds beside the broker and has to cost next to nothing.
"""

from __future__ import annotations

import os
import socket
import sys

# MQTT 3.1.1, sections 3.2 and 3.14: CONNACK, DISCONNECT.
ACCEPTED = b"\x20\x02\x00\x00"
DISCONNECT = b"\xe0\x00"
CLIENT = "health"
TIMEOUT_S = 3.0


def check(host: str, port: int, keys: str | None = None) -> str | None:
    """What is wrong with the broker, or None."""
    try:
        with _connected(host, port, keys) as connection:
            connection.sendall(_connect(keys))
            answer = b""
            while len(answer) < len(ACCEPTED) and (part := connection.recv(len(ACCEPTED) - len(answer))):
                answer += part
            connection.sendall(DISCONNECT)
    except OSError as error:
        return f"no broker at {host}:{port}: {error}"
    return None if answer == ACCEPTED else f"CONNECT was answered by {answer.hex(' ')}, expected {ACCEPTED.hex(' ')}"


def _connected(host: str, port: int, keys: str | None) -> socket.socket:
    connection = socket.create_connection((host, port), TIMEOUT_S)
    if keys is None:
        return connection
    import ssl

    own = os.path.join(keys, CLIENT)
    context = ssl.create_default_context(cafile=os.path.join(own, "ca.crt"))
    context.load_cert_chain(os.path.join(own, "client.crt"), os.path.join(own, "client.key"))
    return context.wrap_socket(connection, server_hostname=host)


def _connect(keys: str | None) -> bytes:
    """CONNECT (section 3.1): clean session, keepalive 60 s; with keys also client id, user and password."""
    fields, flags = [b""], 0x02
    if keys is not None:
        with open(os.path.join(keys, CLIENT, "password"), "rb") as file:
            fields, flags = [CLIENT.encode(), CLIENT.encode(), file.read().strip()], 0xC2
    body = b"\x00\x04MQTT\x04" + bytes((flags,)) + b"\x00\x3c"
    body += b"".join(len(field).to_bytes(2, "big") + field for field in fields)
    return b"\x10" + bytes((len(body),)) + body  # below 128 bytes: a length of one byte


if __name__ == "__main__":
    folder = os.environ.get("JOULESWARM_KEYS") or None
    sys.exit(check("127.0.0.1", 1883 if folder is None else 8883, folder))
