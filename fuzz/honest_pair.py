"""Two honest clients in a process of their own: numbered messages from one to the other, and how long each took."""

from __future__ import annotations

import multiprocessing
import statistics
import time
from multiprocessing.connection import Connection
from typing import Self

from jouleswarm.common.bus.mqtt import MqttBus

TOPIC = "jouleswarm/honest/fl/sl/1/1/weights"
EVERY_S = 0.02
GIVE_UP_S = 60.0
SIZE_BYTES = 2000


def content(number: int) -> bytes:
    """The message of this number: nothing in it can change unseen."""
    return number.to_bytes(8, "big") * (SIZE_BYTES // 8)


class HonestPair:
    """Context manager; exchanges messages until `finish`."""

    def __init__(self, url: str) -> None:
        self._pipe, theirs = multiprocessing.Pipe()
        self._process = multiprocessing.get_context("fork").Process(target=_exchange, args=(url, theirs), daemon=True)

    def __enter__(self) -> Self:
        self._process.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._process.is_alive():
            self._process.terminate()
        self._process.join()

    def wait_for(self, messages: int) -> None:
        """Returns once so many have arrived."""
        self._pipe.send(messages)
        self._pipe.recv()

    def finish(self) -> dict[str, float]:
        """Wait for what is under way; sent, lost and wrong messages, and seconds that they took."""
        self._pipe.send(None)
        figures: dict[str, float] = self._pipe.recv()
        self._process.join()
        return figures


def _exchange(url: str, pipe: Connection) -> None:
    publisher, subscriber = MqttBus.connect(url, "honest-p"), MqttBus.connect(url, "honest-s")
    subscriber.subscribe(TOPIC)
    sent_s: list[float] = []
    took_s: list[float] = []
    wrong, wanted, finishing, quiet_from_s = 0, 0, False, time.monotonic()
    while not finishing or (len(took_s) < len(sent_s) and time.monotonic() - quiet_from_s < GIVE_UP_S):
        if not finishing and (not sent_s or time.monotonic() - sent_s[-1] >= EVERY_S):
            sent_s.append(time.monotonic())
            publisher.publish(TOPIC, content(len(sent_s) - 1))
        message = subscriber.receive(EVERY_S)
        if message is not None:
            wrong += bytes(message.payload) != content(len(took_s))
            quiet_from_s = time.monotonic()
            took_s.append(quiet_from_s - sent_s[len(took_s)])
        if pipe.poll():
            wanted = pipe.recv()
            finishing = wanted is None
        if wanted and len(took_s) >= wanted:
            wanted = 0
            pipe.send("there")
    figures = {
        "sent": len(sent_s),
        "lost": len(sent_s) - len(took_s),
        "wrong": wrong,
        "median_s": statistics.median(took_s),
    }
    figures |= {"p99_s": statistics.quantiles(took_s, n=100)[-1], "max_s": max(took_s)}
    for bus in (publisher, subscriber):
        bus.close()
    pipe.send(figures)
