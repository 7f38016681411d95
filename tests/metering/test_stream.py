"""Connections taken apart as their pieces come."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jouleswarm.common.meter.tally import Tally
from jouleswarm.metering.packets import MOST_BEGINNING_BYTES
from jouleswarm.metering.stream import Connection
from tests.metering.packets import connect, packet, publish, text

Found = dict[tuple[str, str, str], tuple[int, int, int]]
CONNACK, DISCONNECT = packet(0x20, b"\0\0"), packet(0xE0)
ALIAS_7 = b"\x23\x00\x07"


def metered(sent: bytes, received: bytes = b"", pieces: int = 1 << 20, *, most_rows: int = 100) -> Found:
    """What is counted of a connection whose bytes come in pieces of this size."""
    tally = Tally(most_rows)
    connection = Connection(tally)
    for stream, held in ((connection.sent, sent), (connection.received, received)):
        for at in range(0, len(held), pieces):
            stream.feed(held[at : at + pieces])
    connection.end()
    return tally.counts()


def test_messages_are_counted_by_client_direction_and_topic_and_control_packets_apart() -> None:
    sent = connect("robot") + publish("a", b"12345", first=0x32) + publish("a", b"123") + publish("b", b"") + DISCONNECT
    received = CONNACK + packet(0x40, b"\0\1") + publish("c/d", b"12")
    assert metered(sent, received) == {
        ("robot", "", "in control"): (2, 0, 19 + 2),  # 2 + 10 + 2 + 5 of CONNECT, and DISCONNECT
        ("robot", "", "out control"): (2, 0, 4 + 4),
        ("robot", "a", "in publish"): (2, 8, 2 + 3 + 2 + 5 + 2 + 3 + 3),
        ("robot", "b", "in publish"): (1, 0, 5),
        ("robot", "c/d", "out publish"): (1, 2, 2 + 5 + 2),
    }


def test_repeats_are_counted_among_the_messages_and_by_themselves() -> None:
    found = metered(connect("r") + publish("a", b"12", first=0x32) + publish("a", b"12", first=0x3A))
    assert found["r", "a", "in publish"] == (2, 4, 18)
    assert found["r", "a", "in repeat"] == (1, 2, 9)


def test_a_topic_alias_of_mqtt_5_stands_for_its_topic_in_its_direction() -> None:
    long = publish("fed/1", b"123", properties=ALIAS_7)
    short = publish("", b"4567", properties=b"\x26" + text("a") + text("b") + ALIAS_7)
    found = metered(connect("r", 5) + long + short, packet(0x20, b"\0\0\0") + short)
    assert found["r", "fed/1", "in publish"] == (2, 7, len(long) + len(short))
    assert found["r", "", "out unparsed"] == (1, 0, len(short))  # the broker never said what its 7 stands for


def test_a_client_of_mqtt_5_without_an_id_has_the_one_that_it_is_given() -> None:
    given = packet(0x20, b"\0\0" + b"\x09\x12" + text("auto-1"))
    tally = Tally()
    connection = Connection(tally)
    connection.sent.feed(connect("", 5))
    connection.received.feed(given)
    connection.sent.feed(publish("a", b"1", properties=b""))
    assert set(tally.counts()) == {("", "", "in control"), ("auto-1", "", "out control"), ("auto-1", "a", "in publish")}


@pytest.mark.parametrize(
    "spoilt",
    [
        b"\x00\x00",  # no kind
        b"\xf0\x00",  # AUTH, which 3.1.1 has not
        b"\x36\x05\x00\x01a\x00\x01",  # QoS 3
        b"\x30\x03\x00\x09a",  # a topic longer than its packet
        b"\x30\xff\xff\xff\xff\x01",  # a length of five bytes
        b"\x30\x03\x00\x01\xff",  # no UTF-8
        b"\x30\x02\x00\x00",  # no topic
        b"\x30\x03\x00\x01#",  # a filter
        b"\x80\x00",  # SUBSCRIBE with flags of none
    ],
)
def test_from_the_first_packet_that_is_none_on_bytes_are_unparsed(spoilt: bytes) -> None:
    found = metered(connect("r") + publish("a", b"1") + spoilt + publish("a", b"1"))
    assert found["r", "a", "in publish"] == (1, 1, 6)
    assert found["r", "", "in unparsed"][2] == len(spoilt) + 6


def test_what_is_no_mqtt_at_all_is_unparsed_both_ways() -> None:
    assert metered(b"GET / HTTP/1.1\r\n\r\n", b"HTTP/1.1 400\r\n") == {
        ("", "", "in unparsed"): (1, 0, 18),
        ("", "", "out unparsed"): (1, 0, 14),
    }


def test_a_message_that_is_cut_off_is_no_message() -> None:
    cut = publish("a", b"12345")[:-1]
    assert metered(connect("r") + cut)["r", "", "in unparsed"] == (1, 0, len(cut))
    assert metered(connect("r") + b"\x30\x80")["r", "", "in unparsed"] == (1, 0, 2)


def test_what_is_held_of_a_beginning_is_bounded() -> None:
    endless = bytes((0x30, 0xFF, 0xFF, 0xFF, 0x7F)) + text("a") + b"\xff\xff\xff\x7f"  # properties of 256 MB
    connection = Connection(tally := Tally())
    connection.sent.feed(connect("r", 5) + endless)
    for _ in range(8):
        connection.sent.feed(bytes(MOST_BEGINNING_BYTES // 4))
    assert len(connection.sent._begun) == 0
    assert tally.counts()["r", "", "in unparsed"][2] == len(endless) + 2 * MOST_BEGINNING_BYTES


def test_topics_beyond_the_most_rows_are_counted_together() -> None:
    sent = connect("r") + b"".join(publish(f"t{number}", b"12") for number in range(5))
    found = metered(sent, most_rows=3)
    assert found["r", "t1", "in publish"] == (1, 2, 8)
    assert found["", "", "in overflow"] == (3, 6, 24)
    assert metered(connect("r") + publish("x" * 3000, b"1"))["", "", "in overflow"] == (1, 1, 3 + 2 + 3000 + 1)


PUBLISHED = st.builds(
    publish,
    st.sampled_from(["a", "fed/1/c/up", "ü" * 90]),
    st.binary(max_size=300),
    first=st.sampled_from([0x30, 0x31, 0x32, 0x34, 0x3A]),
    properties=st.sampled_from([b"", ALIAS_7, b"\x01\x01\x0b\x80\x01" + ALIAS_7, b"\x26" + text("k") + text("v")]),
)


@given(st.lists(PUBLISHED | st.just(packet(0xC0)), max_size=8), st.binary(max_size=20), st.integers(0, 2**32))
def test_in_whatever_pieces_a_stream_comes_the_same_is_counted_and_every_byte_once(
    packets: list[bytes], rest: bytes, seed: int
) -> None:
    whole = connect("r", 5) + b"".join(packets) + rest
    tally, cuts = Tally(), random.Random(seed)
    connection, at = Connection(tally), 0
    while at < len(whole):
        size = cuts.choice((1, 2, 7, 100))
        connection.sent.feed(whole[at : at + size])
        at += size
    connection.end()
    found, once = tally.counts(), metered(whole)
    pieces = {key: counts[1:] for key, counts in found.items()}
    assert pieces == {key: counts[1:] for key, counts in once.items()}
    assert sum(counts[2] for (_, _, what), counts in found.items() if "repeat" not in what) == len(whole)


@given(st.lists(PUBLISHED, max_size=4), st.integers(0, 10_000), st.integers(0, 255), st.sampled_from([4, 5]))
def test_a_byte_that_is_spoilt_fails_nothing_and_every_byte_is_counted(
    packets: list[bytes], place: int, value: int, version: int
) -> None:
    sent, received = bytearray(connect("r", version) + b"".join(packets)), packet(0x20, b"\0\0\x04\x12\0\1x")
    sent[place % len(sent)] = value
    found = metered(bytes(sent), received + bytes(sent), 50)
    counted = sum(counts[2] for (_, _, what), counts in found.items() if "repeat" not in what)
    assert counted == 2 * len(sent) + len(received)
