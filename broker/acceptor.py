"""Takes the broker's connections."""

from __future__ import annotations

import asyncio
import logging
import socket
import ssl

from jouleswarm.broker.connection import Connection
from jouleswarm.broker.core import SwarmBroker

logger = logging.getLogger("broker")

ACCEPT_PAUSE_S = 0.5


class Acceptor:
    """Takes connections from the listening socket and gives each a task."""

    def __init__(self, listener: socket.socket, broker: SwarmBroker, tls: ssl.SSLContext | None = None) -> None:
        self._listener, self._broker, self._tls = listener, broker, tls
        self._loop = asyncio.get_running_loop()
        self._tasks: set[asyncio.Task[None]] = set()
        self._resume()

    def _resume(self) -> None:
        self._loop.add_reader(self._listener, self._accept)

    def _accept(self) -> None:
        try:
            sock, _ = self._listener.accept()
        except (BlockingIOError, ConnectionAbortedError):
            return
        except OSError as error:
            # Out of file descriptors: the listening socket stays readable, so wait a little.
            logger.error("cannot accept connections for now: %s", error.strerror)
            self._loop.remove_reader(self._listener)
            self._loop.call_later(ACCEPT_PAUSE_S, self._resume)
            return
        broker = self._broker
        if len(self._tasks) >= broker.limits.connections:
            text = f"connection refused: {len(self._tasks)} are open, the limit"
            broker.meter.refused("refused_connections", text)
            logger.warning("%s", text)
            sock.close()
            return
        try:
            if self._tls is not None:
                sock = self._tls.wrap_socket(sock, server_side=True, do_handshake_on_connect=False)
            connection = Connection(sock, broker.limits, broker.budget, broker.turns)
        except OSError:  # gone already
            sock.close()
            return
        task = asyncio.create_task(broker.serve(connection))
        self._tasks.add(task)
        task.add_done_callback(self._ended)

    def _ended(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            self._broker.meter.event("internal_errors")
            logger.error("a connection ended by an error in the broker", exc_info=error)

    async def close(self) -> None:
        """Stop accepting and end all connections."""
        self._loop.remove_reader(self._listener)
        tasks = tuple(self._tasks)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
