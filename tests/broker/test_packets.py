"""What clients send, field by field: the standard's numbered statements (MQTT 3.1.1, appendix B) on packets by hand."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jouleswarm.broker.errors import MalformedPacket, NotAccepted
from jouleswarm.broker.packets import (
    Connect,
    Publish,
    Will,
    is_filter,
    is_topic,
    parse_connect,
    parse_packet_id,
    parse_publish,
    parse_subscribe,
    parse_unsubscribe,
)

OVERLONG, CUT, SURROGATE = b"\xc0\x80", b"a\xc3", b"\xed\xa0\x80"
WILL, QOS_1, QOS_2, RETAIN, PASSWORD, USER = 4, 8, 16, 32, 64, 128


def text(value: str | bytes) -> bytes:
    data = value.encode() if isinstance(value, str) else value
    return len(data).to_bytes(2, "big") + data


def connect(*fields: str | bytes, flags: int = 2, level: int = 4, name: str = "MQTT", keepalive_s: int = 0) -> Connect:
    """By default a clean session; `fields` begin with the client id."""
    body = text(name) + bytes([level, flags]) + keepalive_s.to_bytes(2, "big") + b"".join(map(text, fields))
    return parse_connect(0x10, memoryview(body))


def test_connect_is_taken_apart() -> None:
    assert connect("me", keepalive_s=258) == Connect(4, "me", True, 258, None, None, None)
    whole = connect("me", "w/t", b"\0\xff", "user", b"\xff\0", flags=WILL | QOS_2 | RETAIN | USER | PASSWORD)
    assert whole == Connect(4, "me", False, 0, Will("w/t", b"\0\xff", 2, True), "user", b"\xff\0")
    assert connect("", "", "", flags=2 | USER | PASSWORD) == Connect(4, "", True, 0, None, "", b"")
    assert connect("me", level=3, name="MQIsdp").level == 3


@pytest.mark.parametrize("bad", [OVERLONG, CUT, SURROGATE, "a\0b", "a\x01", "a\x1f", "a\x7f", "a\x9f", "a\uffff"])
@pytest.mark.parametrize("field", ["client id", "will topic", "user"])
def test_1_5_3_1_and_2_strings_of_connect(field: str, bad: str | bytes) -> None:
    fields, flags = {
        "client id": ((bad,), 2),
        "will topic": (("a", bad, "w"), 2 | WILL),
        "user": (("a", bad), 2 | USER),
    }[field]
    with pytest.raises(MalformedPacket, match=r"UTF-8|U\+"):
        connect(*fields, flags=flags)


@pytest.mark.parametrize(
    ("statement", "fields", "options"),
    [
        ("3.1.2-1", ("a",), {"name": "MQTU"}),
        ("3.1.2-1", ("a",), {"name": ""}),
        ("3.1.2-3", ("a",), {"flags": 3}),
        ("3.1.2-9", ("a",), {"flags": 2 | WILL}),
        ("3.1.2-9", ("a", "topic"), {"flags": 2 | WILL}),
        ("3.1.2-11", ("a",), {"flags": 2 | QOS_1}),
        ("3.1.2-13", ("a",), {"flags": 2 | QOS_2}),
        ("3.1.2-14", ("a", "topic", "w"), {"flags": 2 | WILL | QOS_1 | QOS_2}),
        ("3.1.2-15", ("a",), {"flags": 2 | RETAIN}),
        ("3.1.2-18", ("a", "user"), {"flags": 2}),
        ("3.1.2-19", ("a",), {"flags": 2 | USER}),
        ("3.1.2-20", ("a", "user", "password"), {"flags": 2 | USER}),
        ("3.1.2-21", ("a", "user"), {"flags": 2 | USER | PASSWORD}),
        ("3.1.2-22", ("a", "password"), {"flags": 2 | PASSWORD}),
        ("3.1.3-3", (), {}),
        ("3.1.4-1", ("a", "left over"), {}),
        ("4.7.1-1", ("a", "+/x", "w"), {"flags": 2 | WILL}),
        ("4.7.3-1", ("a", "", "w"), {"flags": 2 | WILL}),
    ],
)
def test_connect_that_is_malformed(statement: str, fields: tuple[str, ...], options: dict[str, int]) -> None:
    with pytest.raises(MalformedPacket) as caught:
        connect(*fields, **options)  # type: ignore[arg-type]
    assert not isinstance(caught.value, NotAccepted), "closed without a CONNACK"


@pytest.mark.parametrize(
    ("statement", "code", "fields", "options"),
    [
        ("3.1.2-2", 1, ("a",), {"level": 5}),
        ("3.1.2-2", 1, ("a",), {"level": 3}),
        ("3.1.2-2", 1, ("a",), {"level": 4, "name": "MQIsdp"}),
        ("3.1.3-8", 2, ("",), {"flags": 0}),
        ("MQTT 3.1", 2, ("",), {"level": 3, "name": "MQIsdp"}),
    ],
)
def test_connect_that_is_answered_by_a_return_code(
    statement: str, code: int, fields: tuple[str, ...], options: dict[str, int]
) -> None:
    with pytest.raises(NotAccepted) as caught:
        connect(*fields, **options)  # type: ignore[arg-type]
    assert caught.value.code == code


@pytest.mark.parametrize("first", [0x11, 0x18, 0x30, 0xC0])
def test_2_2_2_2_and_3_1_0_1_the_first_packet_is_connect(first: int) -> None:
    with pytest.raises(MalformedPacket, match="expected CONNECT"):
        parse_connect(first, memoryview(text("MQTT") + b"\x04\x02\0\0" + text("a")))


def test_publish_is_taken_apart() -> None:
    parsed = parse_publish(0x3D, memoryview(text("a/\U0002a6d4") + b"\0\7" + b"x\0"))
    assert parsed == Publish("a/\U0002a6d4", b"\0\7", memoryview(b"x\0"), 2, True)
    # 1.5.3-3: U+FEFF is a character as any other, also the first
    assert parse_publish(0x30, memoryview(text("\ufeffa"))).topic == "\ufeffa"


@pytest.mark.parametrize(
    ("statement", "first", "body"),
    [
        ("1.5.3-1", 0x30, text(OVERLONG)),
        ("1.5.3-1", 0x30, text(SURROGATE)),
        ("1.5.3-2", 0x30, text("a\0")),
        ("1.5.3", 0x30, text("a\x1f")),
        ("2.3.1-1", 0x32, text("a") + b"\0\0x"),
        ("2.3.1-1", 0x34, text("a") + b"\0\0x"),
        ("2.3.1-1", 0x34, text("a") + b"\1"),
        ("3.3.1-2", 0x38, text("a")),
        ("3.3.1-4", 0x36, text("a") + b"\0\1x"),
        ("3.3.2-2", 0x30, text("a/+")),
        ("3.3.2-2", 0x30, text("a/#")),
        ("4.7.3-1", 0x30, text("")),
        ("3.3.2-1", 0x30, b"\0\5abc"),
        ("3.3.2-1", 0x30, b"\0"),
        ("200 levels", 0x30, text("/" * 201)),
    ],
)
def test_publish_that_is_malformed(statement: str, first: int, body: bytes) -> None:
    with pytest.raises(MalformedPacket):
        parse_publish(first, memoryview(body))


def test_subscribe_and_unsubscribe_are_taken_apart() -> None:
    assert parse_subscribe(memoryview(b"\0\1" + text("a/+") + b"\0" + text("#") + b"\2")) == (
        b"\0\1",
        [("a/+", 0), ("#", 2)],
    )
    assert parse_unsubscribe(memoryview(b"\1\0" + text("a") + text("+"))) == (b"\1\0", ["a", "+"])


@pytest.mark.parametrize(
    ("statement", "body"),
    [
        ("2.3.1-1", b"\0\0" + text("a")),
        ("3.8.3-3, 3.10.3-2", b"\0\1"),
        ("1.5.3-1", b"\0\1" + text(SURROGATE)),
        ("1.5.3-2", b"\0\1" + text("a\0")),
        ("4.7.3-1", b"\0\1" + text("")),
        ("200 levels", b"\0\1" + text("/" * 201)),
        ("left over", b"\0\1" + text("a") + b"\0"),
        ("cut short", b"\0\1\0\5abc"),
        ("cut short", b"\0"),
    ],
)
def test_subscribe_and_unsubscribe_that_are_malformed(statement: str, body: bytes) -> None:
    with pytest.raises(MalformedPacket):
        parse_unsubscribe(memoryview(body))
    qos = b"\0" if len(body) > 2 else b""
    with pytest.raises(MalformedPacket):
        parse_subscribe(memoryview(body + qos))


@pytest.mark.parametrize("qos", [3, 4, 8, 0x10, 0x20, 0x40, 0x80])
def test_3_8_3_4_a_qos_above_2_or_reserved_bits(qos: int) -> None:
    with pytest.raises(MalformedPacket, match="for a QoS"):
        parse_subscribe(memoryview(b"\0\1" + text("a") + b"\1" + text("b") + bytes([qos])))


@pytest.mark.parametrize("body", [b"", b"\1", b"\0\0", b"\0\1\0"])
def test_2_3_1_6_an_acknowledgement_is_two_bytes_and_not_0(body: bytes) -> None:
    with pytest.raises(MalformedPacket):
        parse_packet_id(memoryview(body))


@pytest.mark.parametrize("topic_filter", ["a", "/", "a//b", "#", "a/#", "+", "+/+", "a/+/b", "/+", "$SYS/#", "é/+"])
def test_4_7_1_filters(topic_filter: str) -> None:
    assert is_filter(topic_filter)


@pytest.mark.parametrize(
    "topic_filter", ["", "a#", "#a", "a/#/b", "a/b#", "a+", "+a", "a/+b/c", "##", "++", "#/#", "+#"]
)
def test_4_7_1_2_and_3_what_is_no_filter(topic_filter: str) -> None:
    assert not is_filter(topic_filter)


@given(st.lists(st.sampled_from(["a", "", "é", "+", "#", "a+", "#b"]), min_size=1, max_size=4))
def test_a_topic_is_a_filter_without_wildcards(levels: list[str]) -> None:
    name = "/".join(levels)
    assert is_topic(name) == (is_filter(name) and "+" not in name and "#" not in name)
