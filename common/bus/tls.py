"""TLS on both sides of the bus: sockets that behave as plain non-blocking ones do, and what a failure means."""

from __future__ import annotations

import ssl
from collections.abc import Iterable, Iterator
from typing import Any

RECORD_BYTES = 16 * 1024  # the most that one record holds (RFC 8446, section 5.1)
TURN_BYTES = 1024 * 1024


class TlsSocket(ssl.SSLSocket):
    """`ssl.SSLSocket` with `recv_into` and `sendmsg` as a plain non-blocking socket has them.

    What would have to wait raises BlockingIOError. Bytes are those of the stream inside TLS. After a wait for
    room, the next `sendmsg` must begin with the same bytes, and hold no less of them than the one before.
    """

    def recv_into(self, buffer: Any, nbytes: int | None = None, flags: int = 0) -> int:
        """Fill `buffer` with what there is; 0 at the end of the stream.

        Stops after `TURN_BYTES` when no decrypted bytes are left inside, so that the socket tells of the rest.
        """
        view, got = memoryview(buffer), 0
        while got < len(view):
            try:
                count = super().recv_into(view[got:])
            except (ssl.SSLWantReadError, ssl.SSLWantWriteError):
                if got:
                    break
                raise BlockingIOError from None
            got += count
            if count == 0 or (got >= TURN_BYTES and not self.pending()):
                break
        return got

    def sendmsg(self, buffers: Iterable[Any], *_: Any) -> int:  # type: ignore[override]
        """Write buffers one after the other, small ones joined; returns how many bytes were taken."""
        sent = 0
        for record in records(buffers):
            try:
                count = self.send(record)
            except (ssl.SSLWantReadError, ssl.SSLWantWriteError):
                if sent:
                    break
                raise BlockingIOError from None
            sent += count
            if count < len(record):
                break
        return sent


def records(buffers: Iterable[Any]) -> Iterator[memoryview | bytes]:
    """The stream of `buffers` in pieces of `RECORD_BYTES`, the last one shorter; long buffers are not copied."""
    joined = bytearray()
    for buffer in buffers:
        view = memoryview(buffer)
        while view:
            if not joined and len(view) >= RECORD_BYTES:
                yield view[:RECORD_BYTES]
                view = view[RECORD_BYTES:]
                continue
            part = view[: RECORD_BYTES - len(joined)]
            joined += part
            view = view[len(part) :]
            if len(joined) == RECORD_BYTES:
                yield bytes(joined)
                joined.clear()
    if joined:
        yield bytes(joined)
