"""Ways to spoil a payload: bytes, lengths, and the JSON of headers and control messages."""

from __future__ import annotations

import json
import random
import re
import struct
from collections.abc import Callable
from typing import Any

DEEP = 20_000

WEIRD: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 3, 127, 2**31, 2**53, 2**63, 2**64, 10**30, -(10**30), 0.5, -0.0, 1e9, 1.1e9, 1e308,
    float("nan"), float("inf"), "", "0", "-1", "1", "1.0", "NaN", "Infinity", "1e999", "null", "true", "{}", "[]",
    "9" * 5000, "x" * 5000, "\0", "\ud800", "é", "model", "F32", "F64", "BF16", "I8", "F8_E5M2", "BOOL", [], {}, [1],
    [-1, 2], [2**63], [0] * 500, {"": {}}, [[]], {"1": [1, float("nan")]}, '{"3": [1, NaN]}', '{"3": [1, 1e400]}',
    '{"3": [99, 1]}', '{"3": 1, "3": [1, 2]}', {"dtype": "F32", "shape": [], "data_offsets": [0, 4]},
)  # fmt: skip
BYTES = (
    b"\0",
    b"\xff",
    b"\x80",
    b"\x7f",
    b"\x00\x00\xc0\x7f",
    b"\x00\x00\x80\x7f",
    b"\x00\x7c",
    b"\x00\x7e",
    b"{",
    b'"',
)
LENGTHS = (0, 1, 7, 8, 2**16, 2**16 + 1, 2**31, 2**32, 2**63 - 1, 2**63, 2**64 - 1)
_KEY = re.compile(rb'"[^"\\]{0,40}":')
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?")

Mutation = Callable[[random.Random, bytearray], bytearray]


def mutate(rng: random.Random, payload: bytes, others: tuple[bytes, ...]) -> bytes:
    """A payload spoilt one to three times over; `others` are pieces of them to paste in."""
    spoilt = bytearray(payload)
    for _ in range(rng.choice((1, 1, 1, 2, 2, 3))):
        spoilt = _paste(rng, spoilt, others) if rng.random() < 0.05 else rng.choice(MUTATIONS)(rng, spoilt)
    return bytes(spoilt)


def _flip(rng: random.Random, data: bytearray) -> bytearray:
    for _ in range(rng.choice((1, 1, 2, 8))):
        if data:
            data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return data


def _overwrite(rng: random.Random, data: bytearray) -> bytearray:
    piece = rng.choice(BYTES)
    # where floats lie, more often than anywhere
    place = rng.randrange(len(data) + 1) // 4 * 4 if rng.random() < 0.7 else rng.randrange(len(data) + 1)
    data[place : place + len(piece)] = piece
    return data


def _truncate(rng: random.Random, data: bytearray) -> bytearray:
    return data[: rng.randrange(len(data) + 1)] if rng.random() < 0.5 else data[: -rng.randint(1, 8)]


def _extend(rng: random.Random, data: bytearray) -> bytearray:
    return data + rng.randbytes(rng.choice((1, 4, 8, 100, 1000)))


def _cut_out(rng: random.Random, data: bytearray) -> bytearray:
    start = rng.randrange(len(data) + 1)
    del data[start : start + rng.choice((1, 2, 4, 8, 64))]
    return data


def _repeat(rng: random.Random, data: bytearray) -> bytearray:
    start = rng.randrange(len(data) + 1)
    piece = data[start : start + rng.choice((1, 4, 16, 64))]
    data[start:start] = piece * rng.choice((1, 2, 50))
    return data


def _lie_about_length(rng: random.Random, data: bytearray) -> bytearray:
    """Of the header in front, or somewhere in 4 bytes, big-endian, as PNG chunks have it."""
    if rng.random() < 0.6:
        (true,) = struct.unpack_from("<Q", bytes(data[:8]).ljust(8, b"\0"))
        lie = rng.choice((*LENGTHS, true + 1, true - 1, true + 8, len(data), len(data) - 8)) % 2**64
        data[:8] = struct.pack("<Q", lie)
    else:
        place = rng.randrange(len(data) + 1)
        data[place : place + 4] = struct.pack(">I", rng.choice(LENGTHS) % 2**32)
    return data


def _paste(rng: random.Random, data: bytearray, others: tuple[bytes, ...]) -> bytearray:
    other = rng.choice(others)
    start, place = rng.randrange(len(other)), rng.randrange(len(data) + 1)
    piece = other[start : start + rng.choice((8, 64, 10_000))]
    data[place : place + (len(piece) if rng.random() < 0.5 else 0)] = piece
    return data


def _edit_json(rng: random.Random, data: bytearray) -> bytearray:
    """Put something weird in place of a value, a key, or beside them; the length stays true."""
    return _with_text(data, lambda text: _edited(rng, text))


def _edited(rng: random.Random, text: bytes) -> bytes:
    try:
        tree = json.loads(text)
    except (ValueError, RecursionError):
        return text
    holders = list(_holders(tree))
    if not holders:
        return json.dumps(rng.choice(WEIRD)).encode()
    holder = rng.choice(holders)
    key = rng.choice(list(holder)) if isinstance(holder, dict) else rng.randrange(len(holder))
    act = rng.random()
    if act < 0.6:
        holder[key] = rng.choice(WEIRD)
    elif act < 0.75:
        del holder[key]
    elif isinstance(holder, dict):
        value = holder.pop(key) if act < 0.9 else holder[key]
        holder[str(rng.choice(WEIRD))[:6000]] = value
    else:
        holder += [rng.choice(WEIRD)] * rng.choice((1, 300))
    return json.dumps(tree, separators=(",", ":")).encode()


def _holders(tree: Any) -> Any:
    children = tree.values() if isinstance(tree, dict) else tree if isinstance(tree, list) else ()
    if children:
        yield tree
    for child in children:
        yield from _holders(child)


def _duplicate_key(rng: random.Random, data: bytearray) -> bytearray:
    def doubled(text: bytes) -> bytes:
        keys = list(_KEY.finditer(text))
        if not keys:
            return text
        key = rng.choice(keys)
        twin = key.group() + json.dumps(rng.choice(WEIRD)).encode() + b","
        return text[: key.start()] + twin + text[key.start() :]

    return _with_text(data, doubled)


def _number(rng: random.Random, data: bytearray) -> bytearray:
    """Another number in the text, offsets and shapes among them; as long as before where that is possible."""

    def renumbered(text: bytes) -> bytes:
        numbers = list(_NUMBER.finditer(text))
        if not numbers:
            return text
        found = rng.choice(numbers)
        new = rng.choice(
            (b"0", b"-1", b"1e400", b"NaN", b"9" * 5000, b"%d" % rng.randrange(2 ** rng.choice((3, 8, 34, 70))))
        )
        return text[: found.start()] + new + text[found.end() :]

    return _with_text(data, renumbered)


def _nest(rng: random.Random, data: bytearray) -> bytearray:
    def nested(text: bytes) -> bytes:
        numbers = list(_NUMBER.finditer(text))
        if not numbers:
            return b"[" * DEEP
        found, depth = rng.choice(numbers), rng.choice((50, 500, DEEP))
        opening, closing = rng.choice(((b"[", b"]"), (b'{"a":', b"}")))
        deep = opening * depth + b"1" + closing * (depth if rng.random() < 0.7 else 0)
        return text[: found.start()] + deep + text[found.end() :]

    return _with_text(data, nested)


def _with_text(data: bytearray, change: Callable[[bytes], bytes]) -> bytearray:
    """A payload whose JSON (all of a control message, the header of a safetensors file) has been changed."""
    if data[:1] == b"{":
        return bytearray(change(bytes(data)))
    (length,) = struct.unpack_from("<Q", bytes(data[:8]).ljust(8, b"\0"))
    end = 8 + min(length, len(data))
    text = change(bytes(data[8:end]))
    return bytearray(struct.pack("<Q", len(text)) + text + data[end:])


MUTATIONS: tuple[Mutation, ...] = (
    _flip, _overwrite, _overwrite, _truncate, _extend, _cut_out, _repeat, _lie_about_length, _edit_json, _edit_json,
    _edit_json, _duplicate_key, _number, _number, _nest,
)  # fmt: skip
