"""What no client may make the broker hold, and how long one that reads nothing may hold the others up."""

from __future__ import annotations

import asyncio
import socket
import threading

import pytest

from jouleswarm.broker.holdings import Away, Retained
from jouleswarm.broker.limits import OVERHEAD_BYTES, REPLIES, Budget, Turns
from jouleswarm.broker.meter import BrokerMeter
from jouleswarm.broker.outbound import PacketWriter
from jouleswarm.broker.publication import Publication

MEGABYTE = 1024 * 1024


def test_retained_messages_over_the_limit_are_delivered_but_not_kept(start_broker, raw):
    broker = start_broker("--max-retained-mb", "1")
    publisher, live, late = raw(broker), raw(broker), raw(broker)
    publisher.connect("p")
    live.connect("live")
    live.subscribe("r/#", 0)
    for number in range(3):  # the third does not fit: 3 x 400 kB > 1 MiB
        publisher.publish(f"r/{number}", bytes(400_000), 1, retain=True)
    publisher.publish("r/1", b"new", 1, retain=True)  # a smaller one in its place always fits
    assert [len(live.read_publish()[3]) for _ in range(4)] == [400_000, 400_000, 400_000, 3]
    late.connect("late")
    late.subscribe("r/#", 0)
    assert [late.read_publish()[1] for _ in range(2)] == ["r/0", "r/1"]
    late.ping()
    broker.counted("refused_retained", 1)


def test_a_retained_message_that_does_not_fit_takes_the_one_that_is_out_of_date_with_it():
    retained = Retained(1000)
    assert retained.book("a", 400)  # 400 + 1 + 512
    assert not retained.book("a", 600)
    assert retained.held_bytes == 0
    assert retained.book("b", 480)
    assert not retained.book("c", 1)
    assert retained.book("b", 0)
    assert retained.held_bytes == 0


def test_a_client_over_its_number_of_filters_is_told_so(start_broker, raw):
    broker = start_broker("--max-subscriptions", "2")
    client = raw(broker)
    client.connect("c")
    assert [client.subscribe(each) for each in ("a", "b", "c", "a")] == [1, 1, 0x80, 1]
    client.send(0xA2, b"\x00\x02\x00\x01a")
    assert client.read() == (0xB0, b"\x00\x02")
    assert client.subscribe("c") == 1
    broker.counted("refused_subscriptions", 1)


def test_long_names_are_refused(broker, raw):
    client, other, third = raw(broker), raw(broker), raw(broker)
    client.connect("c")
    assert client.subscribe("t" * 1025) == 0x80
    client.publish("t" * 1024, b"", 1)
    client.send(0x30, b"\x04\x01" + b"t" * 1025)
    assert client.is_closed_by_broker()
    for each, (client_id, will) in zip((other, third), (("i" * 1025, None), ("i", ("w" * 1025, b""))), strict=True):
        with pytest.raises((AssertionError, ConnectionError)):
            each.connect(client_id, will=will)
    broker.counted("refused_malformed", 3)


@pytest.mark.parametrize("first", [0x82, 0xA2, 0x40])
def test_a_control_packet_needs_no_megabyte(broker, raw, first):
    client = raw(broker)
    client.connect("c")
    client.sock.sendall(bytes([first]) + b"\x81\x80\x10")  # 256 KiB + 1
    assert client.is_closed_by_broker()
    broker.counted("refused_too_large", 1)


def test_who_does_not_read_the_answers_to_its_packets_is_waited_for():
    async def scenario() -> None:
        ours, theirs = socket.socketpair()
        with ours, theirs:
            for sock in (ours, theirs):
                sock.setblocking(False)
            ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
            writer = PacketWriter(ours, Turns(), lambda reason: pytest.fail(reason))
            writer.send(b"a publication", memoryview(bytes(MEGABYTE)))  # what others publish does not count
            await writer.caught_up()
            for _ in range(REPLIES + 1):
                writer.send(b"\xd0\x00")
            waiting = asyncio.create_task(writer.caught_up())
            await asyncio.sleep(0)
            assert not waiting.done()
            loop, left = asyncio.get_running_loop(), 13 + MEGABYTE + 2
            while left > 0:
                left -= len(await loop.sock_recv(theirs, 65536))
            await waiting
            writer.end()

    asyncio.run(asyncio.wait_for(scenario(), 20))


def test_who_waits_for_a_peer_that_has_gone_is_woken():
    async def scenario() -> None:
        ours, theirs = socket.socketpair()
        with ours, theirs:
            ours.setblocking(False)
            writer = PacketWriter(ours, Turns(), lambda reason: pytest.fail(reason))
            writer.send(b"x", memoryview(bytes(MEGABYTE)))
            for _ in range(REPLIES + 1):
                writer.send(b"\xd0\x00")
            waiting = asyncio.create_task(writer.caught_up())
            await asyncio.sleep(0)
            writer.end()
            await waiting

    asyncio.run(asyncio.wait_for(scenario(), 20))


def test_only_so_many_persistent_sessions_are_kept_and_those_longest_away_go_first(start_broker, raw, eventually):
    broker = start_broker("--max-offline-sessions", "2")
    for number, name in enumerate(("first", "second", "third"), 1):
        client = raw(broker)
        client.connect(name, clean=False)
        client.send(0xE0)
        assert client.is_closed_by_broker()
        wanted = max(0, number - 2)
        eventually(lambda wanted=wanted: broker.event("dropped_sessions") == wanted, "the session is put away")
    assert [raw(broker).connect(name, clean=False) for name in ("second", "third", "first")] == [1, 1, 0]


def test_what_is_kept_for_all_sessions_together_is_limited():
    away = Away(sessions=9, session_bytes=100, all_bytes=150)
    assert away.leaves("a", 0) == []
    assert (away.keep("a", 90), away.keep("a", 20)) == (True, False)
    assert away.leaves("b", 0) == []
    assert (away.keep("b", 50), away.keep("b", 20)) == (True, False)
    assert away.leaves("c", 80) == ["a"]  # 90 + 50 + 80 > 150
    away.returns("b")
    assert away.keep("c", 20)


def test_a_subscriber_that_reads_nothing_holds_the_others_up_for_the_shorter_time_only(start_broker, raw):
    # Were it the stall timeout of 60 s, the healthy reader would give up after 20.
    broker = start_broker("--memory-mb", "16", "--pressed-stall-timeout-s", "0.5")
    stuck, healthy, publisher = raw(broker), raw(broker), raw(broker)
    for client, name in ((stuck, "stuck"), (healthy, "healthy"), (publisher, "p")):
        client.connect(name)
    stuck.subscribe("a", 0)
    healthy.subscribe("a", 0)
    sending = threading.Thread(target=lambda: [publisher.publish("a", bytes(4_000_000), 1) for _ in range(12)])
    sending.start()
    assert [len(healthy.read_publish()[3]) for _ in range(12)] == [4_000_000] * 12
    sending.join()
    broker.counted("dropped_stalled", 1)
    healthy.ping()


def test_a_slow_reader_is_not_dropped_for_the_shorter_time_either(start_broker, raw):
    broker = start_broker("--memory-mb", "8", "--pressed-stall-timeout-s", "2")
    slow, publisher, pace = raw(broker), raw(broker), raw(broker)
    for client, name in ((slow, "slow"), (publisher, "p"), (pace, "pace")):
        client.connect(name)
    slow.subscribe("a", 0)
    sending = threading.Thread(target=lambda: [publisher.publish("a", bytes(4_000_000), 1) for _ in range(6)])
    sending.start()
    left = 6 * (4_000_000 + 1 + 4 + 3)
    slow.sock.settimeout(30)
    while left:
        left -= len(slow.sock.recv(min(left, 1_500_000)))
        pace.is_closed_by_broker(within_s=0.1)  # a pause, by the clock of nobody in particular
    sending.join()
    slow.ping()
    assert broker.event("dropped_stalled") == 0


def test_made_up_topics_do_not_fill_the_meter(monkeypatch):
    monkeypatch.setattr("jouleswarm.broker.meter.MAX_ROWS", 2)
    meter = BrokerMeter()
    for number in range(9):
        meter.count("c", f"jouleswarm/r/fl/ul/1/{number}/experience", "in", 10, 22)
    meter.count("c", "jouleswarm/r/fl/ul/1/0/experience", "in", 10, 22)
    assert [(row.topic[-12:], row.messages) for row in meter.rows()] == [("0/experience", 2), ("1/experience", 1)]
    assert meter.event_counts() == {"unmetered": 7}
    assert (meter.unmetered("r"), meter.unmetered("another")) == (7, 0)


def test_a_message_costs_its_overhead_once_more_for_each_receiver():
    budget = Budget(10_000)
    budget.try_take(100)
    publication = Publication("a", memoryview(b"x"), 1, budget, 100)
    publication.hold()
    publication.hold()
    assert budget.used_bytes == 100 + 2 * OVERHEAD_BYTES
    for _ in range(3):
        publication.drop()
    assert budget.used_bytes == 0
