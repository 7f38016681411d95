"""The broker's log: short lines, written by a thread of its own.

Whoever started the broker may read its stderr late or never, and a pipe that is full makes who writes to it wait. That
must not be the event loop, and no client may choose how long a line is.
"""

from __future__ import annotations

import contextlib
import logging
import os
import queue
import sys
import threading
from collections.abc import Iterator

from jouleswarm.broker.refusals import shortened

WAITING_LINES = 1000
LEAVE_S = 1.0


class _Lines(logging.Handler):
    """Hands lines to a thread; what would wait longer than `WAITING_LINES` lines is lost, and counted in a line."""

    def __init__(self, descriptor: int) -> None:
        super().__init__()
        self.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
        self._descriptor, self._lost = descriptor, 0
        self._waiting: queue.Queue[logging.LogRecord | None] = queue.Queue(WAITING_LINES)
        self._thread = threading.Thread(target=self._write, name="log", daemon=True)
        self._thread.start()

    def emit(self, record: logging.LogRecord) -> None:
        record.msg, record.args = shortened(record.getMessage()), None
        try:
            self._waiting.put_nowait(record)
        except queue.Full:
            self._lost += 1

    def close(self) -> None:
        """Have what waits written, unless nobody reads it."""
        with contextlib.suppress(queue.Full):
            self._waiting.put(None, timeout=LEAVE_S)
            self._thread.join(LEAVE_S)
        super().close()

    def _write(self) -> None:
        while (record := self._waiting.get()) is not None:
            self._tell(record)
            if self._lost:
                lost, self._lost = self._lost, 0
                text = f"{lost} lines were lost: nobody has read this log for too long"
                self._tell(logging.makeLogRecord({"name": "broker", "levelname": "WARNING", "msg": text}))

    def _tell(self, record: logging.LogRecord) -> None:
        # Past Python's own buffer: a thread that stands in a write there keeps the process from ending.
        line = memoryview(f"{self.format(record)}\n".encode(errors="replace"))
        with contextlib.suppress(OSError):  # closed, or a disk that is full: the broker goes on without a log
            while line:
                line = line[os.write(self._descriptor, line) :]


@contextlib.contextmanager
def background_log(level: int) -> Iterator[None]:
    """Log to stderr while the context lasts."""
    lines, root = _Lines(sys.stderr.fileno()), logging.getLogger()
    root.addHandler(lines)
    root.setLevel(level)
    for name in ("amqtt", "transitions"):
        logging.getLogger(name).setLevel(max(level, logging.WARNING))
    try:
        yield
    finally:
        root.removeHandler(lines)
        lines.close()
