"""Unread messages are held down to a budget of bytes."""

from jouleswarm.common.bus.bus import Message
from jouleswarm.common.bus.inbox import BUDGET_BYTES, GROWS_FOR_S, Inbox

HALF = Message("a", memoryview(bytes(BUDGET_BYTES // 2)))


def test_messages_come_out_in_the_order_they_went_in() -> None:
    inbox = Inbox()
    for number in range(3):
        inbox.put(Message("a", bytes([number])))
    assert [inbox.take().payload[0] for _ in range(len(inbox))] == [0, 1, 2]


def test_there_is_room_until_the_budget_is_used_and_again_when_something_was_read() -> None:
    inbox = Inbox()
    rooms = []
    for _ in range(2):
        rooms.append(inbox.has_room(0))
        inbox.put(HALF)
    assert (rooms, inbox.has_room(0)) == ([True, True], False)
    inbox.take()
    assert inbox.has_room(0)


def test_one_message_has_room_however_large() -> None:
    inbox = Inbox()
    assert inbox.has_room(0)
    inbox.put(Message("a", memoryview(bytes(2 * BUDGET_BYTES + 1))))
    assert not inbox.has_room(10 * GROWS_FOR_S)


def test_the_budget_grows_to_its_double_while_nobody_reads_and_no_further() -> None:
    inbox = Inbox()
    for _ in range(2):
        inbox.put(HALF)
    assert not inbox.has_room(1000)  # full from here on
    assert inbox.has_room(1000 + GROWS_FOR_S / 4)
    inbox.put(HALF)  # 1.5 budgets and the overhead of three messages
    assert not inbox.has_room(1000 + GROWS_FOR_S / 2)
    assert inbox.has_room(1000 + GROWS_FOR_S)
    inbox.put(HALF)
    assert not inbox.has_room(1000 + 100 * GROWS_FOR_S)


def test_empty_messages_use_the_budget_too() -> None:
    inbox, empty = Inbox(), Message("a", b"")
    while inbox.has_room(0):
        inbox.put(empty)
    assert len(inbox) == -(-BUDGET_BYTES // 513)  # 512 for the objects and a topic of one letter
