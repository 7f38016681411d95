"""What a client may do to a broker, kind by kind: bytes of MQTT 3.1.1 that are wrong, too many, or end too early."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass

from jouleswarm.common.wire.mqtt import length_bytes


def packet(first: int, body: bytes = b"") -> bytes:
    """A whole packet."""
    return bytes([first]) + length_bytes(len(body)) + body


def text(value: str | bytes) -> bytes:
    """A string with its length."""
    data = value if isinstance(value, bytes) else value.encode()
    return len(data).to_bytes(2, "big") + data


def connect(
    client_id: str, *, clean: bool = True, keepalive_s: int = 30, will: tuple[str, bytes] | None = None
) -> bytes:
    """CONNECT (section 3.1)."""
    flags = (2 if clean else 0) | (0x24 if will else 0)
    body = text("MQTT") + bytes([4, flags]) + keepalive_s.to_bytes(2, "big") + text(client_id)
    return packet(0x10, body + (text(will[0]) + text(will[1]) if will else b""))


def publish(
    topic: str | bytes, payload: bytes = b"x", qos: int = 0, packet_id: int = 7, *, retain: bool = False
) -> bytes:
    """PUBLISH (section 3.3)."""
    identifier = packet_id.to_bytes(2, "big") if qos else b""
    return packet(0x30 | qos << 1 | retain, text(topic) + identifier + payload)


def subscribe(*filters: str, packet_id: int = 1, qos: int = 1) -> bytes:
    """SUBSCRIBE (section 3.8)."""
    return packet(0x82, packet_id.to_bytes(2, "big") + b"".join(text(each) + bytes([qos]) for each in filters))


Make = Callable[[random.Random], bytes]


@dataclass(frozen=True)
class Kind:
    """One way to be hostile: what is sent, in one piece or byte by byte, after a CONNECT or instead of it."""

    name: str
    make: Make
    connects: bool = True
    ends: bool = False
    """Whether the broker must end the connection."""
    slowly: bool = False
    client_id: str | None = None
    clean: bool = True
    will: bool = False
    keepalive_s: int = 30


def _name(rng: random.Random) -> str:
    return f"{rng.randrange(10**6)}"


def _valid(rng: random.Random) -> bytes:
    """Packets that are right, to be spoilt."""
    return b"".join(
        rng.choice(
            (
                publish(f"f/{_name(rng)}", rng.randbytes(20), rng.randrange(3)), subscribe("f/+", f"g/{_name(rng)}/#"),
                packet(0xC0), packet(0x40, b"\0\7"), packet(0x62, b"\0\7"), packet(0xA2, b"\0\1" + text("f/+")),
            )
        )
        for _ in range(4)
    )  # fmt: skip


def _spoilt(rng: random.Random) -> bytes:
    data = bytearray(_valid(rng))
    for _ in range(rng.choice((1, 1, 3))):
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return bytes(data[: rng.randrange(1, len(data) + 1)] if rng.random() < 0.3 else data)


def _many(count: int, make: Make) -> Make:
    return lambda rng: b"".join(make(rng) for _ in range(count))


def _always(data: bytes) -> Make:
    return lambda rng: data


def _long_filters(rng: random.Random) -> bytes:
    return b"".join(subscribe(*("/".join([_name(rng)] * 120) for _ in range(20))) for _ in range(2))


def _truncated(make: Make) -> Make:
    def cut(rng: random.Random) -> bytes:
        data = make(rng)
        return data[: rng.randrange(1, len(data))]

    return cut


def _no_identifier(rng: random.Random) -> bytes:
    return rng.choice((publish("a", qos=1, packet_id=0), subscribe("a", packet_id=0)))


def _qos_2(rng: random.Random) -> bytes:
    return publish("q", qos=2, packet_id=rng.randrange(1, 65536)) + packet(0x62, b"\1\1")


def _persistent(rng: random.Random) -> bytes:
    return subscribe(f"p/{_name(rng)[:2]}") + publish(f"p/{_name(rng)[:2]}", bytes(500), 1)


_METERED = "jouleswarm/fuzz/maml/ul/1/"

KINDS: tuple[Kind, ...] = (
    Kind("garbage instead of CONNECT", lambda rng: rng.randbytes(rng.randrange(1, 200)), connects=False),
    Kind("garbage after CONNECT", lambda rng: rng.randbytes(rng.randrange(1, 200))),
    Kind("CONNECT cut off", _truncated(lambda rng: connect(_name(rng), will=("w", b"x"))), connects=False),
    Kind("valid packets spoilt", _spoilt),
    Kind("valid packets cut off", _truncated(_valid)),
    Kind("remaining length of 256 MiB", _always(b"\x30\xff\xff\xff\x7f"), ends=True),
    Kind("remaining length of 5 bytes", _always(b"\x30\xff\xff\xff\xff\x01"), ends=True),
    Kind("SUBSCRIBE of 1 MiB", _always(b"\x82\x80\x80\x40"), ends=True),
    Kind("topic not UTF-8", _always(publish(b"\xc3\x28")), ends=True),
    Kind("wildcard in a topic", _always(publish("a/#")), ends=True),
    Kind("topic of 60 000 bytes", _always(publish("t" * 60_000)), ends=True),
    Kind("QoS 3", _always(publish("a", qos=3)), ends=True),
    Kind("packet identifier 0", _no_identifier, ends=True),
    Kind("a second CONNECT", lambda rng: connect(_name(rng)), ends=True),
    Kind("SUBSCRIBE to nothing", _always(subscribe()), ends=True),
    Kind("keepalive of 18 hours", _always(packet(0xC0)), keepalive_s=65535),
    Kind("half open, with a will", _always(b""), will=True),
    Kind("header byte by byte", _always(b"\x30\x80\x80\x01"), slowly=True),
    Kind("PUBACKs nobody waits for", _many(50, lambda rng: packet(0x40, rng.randbytes(2)))),
    Kind("PUBRELs and QoS 2", _many(10, _qos_2)),
    Kind("retained messages", _many(10, lambda rng: publish(f"r/{_name(rng)}", bytes(4000), retain=True))),
    Kind("all retained again and again", _many(2, _always(subscribe("r/#")))),
    Kind("long filters", _long_filters),
    Kind("pings, answers unread", _always(packet(0xC0) * 1200)),
    Kind("made-up metered topics", _many(10, lambda rng: publish(f"{_METERED}{_name(rng)}/experience"))),
    Kind("persistent sessions", _persistent, clean=False),
    Kind("one client id for all", lambda rng: subscribe("o/#") + publish(f"o/{_name(rng)}"), client_id="same"),
    Kind("large message cut off", lambda rng: publish("l", bytes(300_000))[: rng.randrange(5, 200_000)]),
)  # fmt: skip
