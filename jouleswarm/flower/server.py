"""The server's part: every message of its grid is counted, into a run directory that `jouleswarm bill` prices."""

from __future__ import annotations

import atexit
import logging
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from flwr.app import Message

from jouleswarm.common.errors import ConfigurationError, PayloadError, RunError
from jouleswarm.common.meter.counts_file import check_word
from jouleswarm.flower.client import RECORD, read_record
from jouleswarm.flower.directory import Directory
from jouleswarm.flower.sizes import Sizes, size_of

log = logging.getLogger("flwr")

_Row = tuple[object, ...]


def metered(of: Any, out: str | Path = "runs", arm: str | None = None) -> Any:
    """A strategy whose run is metered; or a grid, for an app that has no strategy or calls the grid itself.

    The run directory is `flower-` and Flower's number of the run.

    Args:
        of: the strategy that is started, outermost if there are several; or the grid.
        out: where the run directory is made, by the ServerApp's process.
        arm: what is compared; default: the strategy's name.

    Raises:
        ConfigurationError: it is neither.
    """
    if hasattr(of, "send_and_receive"):
        grid = MeteredGrid(of, Path(out), arm or "")
        atexit.register(grid.end)  # nobody tells when it has moved its last message
        return grid
    if hasattr(of, "start"):
        return MeteredStrategy(of, Path(out), type(of).__name__ if arm is None else arm)
    raise ConfigurationError(f"metered: got {type(of).__name__}, expected a strategy or a grid")


class MeteredStrategy:
    """A strategy that runs on a metered grid; else the one inside."""

    def __init__(self, inner: Any, out: Path, arm: str) -> None:
        self._inner, self._out, self._arm = inner, out, arm

    def start(self, grid: Any, *positional: Any, **named: Any) -> Any:
        """As `Strategy.start`."""
        over = MeteredGrid(grid, self._out, self._arm)
        result = self._inner.start(over, *positional, **named)
        over.end()
        return result

    def __getattr__(self, name: str) -> Any:
        if name in ("configure_train", "configure_evaluate"):  # nothing would be counted
            raise ConfigurationError(f"metered: {name} is called from outside, expected metered(...) outermost")
        return getattr(self.__dict__["_inner"], name)


class MeteredGrid:
    """A grid whose messages are counted by client and round; else the one inside.

    Counts are written when an exchange ends, after clients have said in their replies who they are.
    """

    def __init__(self, inner: Any, out: Path, arm: str) -> None:
        """
        Raises:
            ConfigurationError: the directory cannot be written.
        """
        check_word(arm or "arm")
        self._inner, self._arm = inner, arm
        self._directory = Directory(out, str(inner.run.run_id))
        self._names: dict[int, str] = {}
        self._asked: dict[str, tuple[str, str]] = {}  # id of a message -> what it asks for, and in which round
        self._rows: dict[int, list[_Row]] = {}
        log.info("jouleswarm: what this run costs goes to %s", self._directory.path)
        atexit.register(self.flush)

    def send_and_receive(self, messages: Iterable[Message], *, timeout: float | None = None) -> Iterable[Message]:
        """As the grid inside."""
        messages = list(messages)
        replies = list(self._inner.send_and_receive(messages, timeout=timeout))
        self._sent(messages)
        self._received(replies)
        self.flush()
        return replies

    def push_messages(self, messages: Iterable[Message]) -> Iterable[str]:
        """As the grid inside."""
        messages = list(messages)
        ids: Iterable[str] = self._inner.push_messages(messages)
        self._sent(messages)
        return ids

    def pull_messages(self, message_ids: Iterable[str]) -> Iterable[Message]:
        """As the grid inside."""
        replies = list(self._inner.pull_messages(message_ids))
        self._received(replies)
        return replies

    def __getattr__(self, name: str) -> Any:
        return getattr(self.__dict__["_inner"], name)

    def flush(self) -> None:
        """Write what is held; who has never said who it is goes by its node's number. What cannot be written stays for
        the next time, with a warning: the run is worth more than its counts."""
        named = ((self._names.get(node, f"node-{node}"), rows) for node, rows in self._rows.items())
        try:
            self._directory.add([(self._arm, "fl", "", name, "", *row) for name, rows in named for row in rows])
        except OSError as error:
            log.warning("jouleswarm: %s cannot be written (%s), tried again later", error.filename, error.strerror)
        else:
            self._rows = {}

    def end(self) -> None:
        """Write what is held, and that this is all."""
        self.flush()
        try:
            self._directory.end()
        except RunError as error:
            log.warning("jouleswarm: %s", error)

    def _sent(self, messages: list[Message]) -> None:
        for message in messages:  # after it went out, when it has its number
            of = message.metadata.message_type, _round(message)
            self._asked[message.metadata.message_id] = of
            self._count(message.metadata.dst_node_id, "downlink", "sent", size_of(message), of)

    def _received(self, replies: list[Message]) -> None:
        for reply in replies:
            of = self._asked.pop(reply.metadata.reply_to_message_id, ("", ""))
            record = reply.content.pop(RECORD, None) if reply.has_content() else None
            node = reply.metadata.src_node_id
            self._count(node, "uplink", "received", size_of(reply), of)
            if record is not None:
                try:
                    name, told = read_record(record)
                except PayloadError as error:
                    log.warning("jouleswarm: node %s: %s", node, error)
                    continue
                self._names |= {node: name} if name else {}
                self._rows[node] += [(what, value, "", *of, how) for what, value, how in told]

    def _count(self, node: int, link: str, end: str, sizes: Sizes, of: tuple[str, str]) -> None:
        told = {"bytes": sizes.message, "messages": 1, "array_bytes": sizes.arrays}
        rows = [(f"{link}_{what}", value, end, *of, "") for what, value in told.items() if value]
        self._rows.setdefault(node, []).extend(rows)


def _round(message: Message) -> str:
    """As its group or its configuration says; "" where neither does."""
    records = message.content.config_records.values() if message.has_content() else ()
    told = next((str(each["server-round"]) for each in records if "server-round" in each), "")
    return next((each for each in (message.metadata.group_id, told) if each.isdecimal()), "")
