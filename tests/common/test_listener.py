"""A process's ear: what it does with messages, and when it asks again for what has not come."""

from __future__ import annotations

import threading
from collections.abc import Callable

import pytest

from jouleswarm.common.bus.bus import MemoryBus, MemoryHub, Message
from jouleswarm.common.bus.listener import Listener
from jouleswarm.common.errors import PayloadError
from jouleswarm.common.wire import topics

DEADLINE_S, PATIENT_S, IMPATIENT_S = 20.0, 60.0, 0.01


class Table:
    """A listener that asks on `ask` for what others answer on `got`."""

    def __init__(self, quiet_s: float = PATIENT_S) -> None:
        self.hub = MemoryHub()
        self.bus, self.others = self.hub.connect("agent-1"), self.hub.connect("others")
        self.bus.subscribe("#")
        self.others.subscribe("ask")
        self.listener = Listener(self.bus, quiet_s)
        self.got: list[str] = []
        self.listener.handlers["got"] = lambda message: self.got.append(message.topic)

    def ask(self) -> None:
        self.bus.publish("ask", b"")

    def wait(self, **options: bool) -> threading.Thread:
        thread = threading.Thread(
            target=lambda: self.listener.until(lambda: bool(self.got), lambda: "something", self.ask, **options),
            daemon=True,
        )
        thread.start()
        return thread

    def answer(self, thread: threading.Thread) -> None:
        self.others.publish("a/got", b"")
        thread.join(DEADLINE_S)
        assert not thread.is_alive()


def asked(bus: MemoryBus, times: int = 1) -> None:
    for _ in range(times):
        assert bus.receive(DEADLINE_S) is not None, "nothing was asked for"


def test_a_message_goes_to_the_handler_of_its_topics_last_level_or_to_who_takes_all_others() -> None:
    table, others = Table(), []
    table.listener.otherwise = lambda message: others.append(message.topic)
    for topic in ("a/b/got", "got", "a/got/b"):
        table.others.publish(topic, b"")
    table.listener.take_waiting()
    assert (table.got, others) == (["a/b/got", "got"], ["a/got/b"])


def test_without_a_message_take_next_says_so() -> None:
    table = Table()
    assert table.listener.take_next(0.001) is False
    table.others.publish("unknown", b"")
    assert table.listener.take_next(DEADLINE_S) is True


def test_what_a_handler_cannot_read_is_refused_and_counted() -> None:
    table = Table()

    def refuse(message: Message) -> None:
        raise PayloadError("garbage")

    table.listener.handlers["bad"] = refuse
    for topic in ("bad", "a/got", "b/bad"):
        table.others.publish(topic, b"")
    table.listener.take_waiting()
    assert (table.listener.refused, table.got) == (2, ["a/got"])


def test_a_defect_in_a_handler_is_not_hidden() -> None:
    table = Table()
    table.listener.handlers["got"] = lambda message: 1 // 0  # type: ignore[assignment,return-value]
    table.others.publish("got", b"")
    with pytest.raises(ZeroDivisionError):
        table.listener.take_waiting()


def test_what_holds_already_is_not_waited_for() -> None:
    table = Table()
    table.listener.until(lambda: True, lambda: "nothing", table.ask)
    assert table.others.receive(0.001) is None


def test_what_has_not_come_is_asked_for_after_each_quiet_spell() -> None:
    table = Table(IMPATIENT_S)
    waiting = table.wait()
    asked(table.others, 3)
    table.answer(waiting)


def test_who_is_patient_does_not_ask() -> None:
    table = Table()
    table.answer(table.wait())
    assert table.others.receive(0.001) is None


def test_what_was_sent_while_the_connection_was_lost_is_asked_for_at_once() -> None:
    table = Table()
    waiting = table.wait()

    def reconnect(message: Message) -> None:
        table.bus.connections += 1

    table.listener.handlers["back"] = reconnect
    for _ in range(2):  # each time, and once each time
        table.others.publish("back", b"")
        asked(table.others)
        assert table.others.receive(0.01) is None
    table.answer(waiting)


def test_who_comes_back_asks_at_once_but_first_takes_what_is_there() -> None:
    table = Table()
    waiting = table.wait(at_once=True)
    asked(table.others)
    assert table.others.receive(0.01) is None
    table.answer(waiting)

    lucky = Table()
    lucky.others.publish("a/got", b"")
    lucky.answer(lucky.wait(at_once=True))
    assert lucky.others.receive(0.001) is None


def test_a_message_that_had_come_before_is_booked_as_repeated() -> None:
    table, topic = Table(), topics.weights("r", "fl", 1, 2)
    table.others.publish(topic, b"123", qos=0)
    message = table.bus.receive(0)
    assert message is not None
    counted: Callable[[str], list[tuple[int, int, int]]] = lambda direction: [  # noqa: E731
        (row.messages, row.payload_bytes, row.packet_bytes)
        for row in table.bus.meter.rows()
        if (row.direction, row.topic, row.client) == (direction, topic, "agent-1")
    ]
    assert counted("repeated") == []
    table.listener.repeated(message, 0)
    assert counted("repeated") == [(1, 3, counted("in")[0][2])]
    table.listener.repeated(message, 1)
    # at QoS 1 a packet has two bytes more
    assert counted("repeated") == [(2, 6, 2 * counted("in")[0][2] + 2)]
