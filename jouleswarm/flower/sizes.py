"""Bytes of Flower's messages as Protocol Buffers, worked out without serialising their arrays."""

from __future__ import annotations

from collections import OrderedDict
from math import prod
from typing import NamedTuple

import numpy as np
from flwr.app import Array, ArrayRecord, Message, RecordDict
from flwr.common.serde import message_to_proto, metadata_to_proto, recorddict_to_proto
from flwr.proto.message_pb2 import Message as ProtoMessage


class Sizes(NamedTuple):
    """Of a message: serialised as a whole, and the elements of its arrays alone."""

    message: int
    arrays: int


def size_of(message: Message) -> Sizes:
    """As Flower's `message_to_proto` makes it, which copies all arrays several times."""
    if not message.has_content():
        return Sizes(message_to_proto(message).ByteSize(), 0)
    bare = int(ProtoMessage(metadata=metadata_to_proto(message.metadata)).ByteSize())
    content = _content_bytes(message.content)
    arrays = [each for record in message.content.array_records.values() for each in record.values()]
    return Sizes(bare + 1 + _varint(content) + content, sum(map(_elements, arrays)))


def _elements(array: Array) -> int:
    """Bytes of its elements, without what Flower writes around them."""
    try:
        return int(prod(array.shape) * np.dtype(array.dtype).itemsize)
    except TypeError:  # no dtype of NumPy's: packed in some way of the app's own
        return len(array.data)


def _content_bytes(content: RecordDict) -> int:
    """Of the records: serialised without arrays' data, and what each field that encloses data grows by it."""
    hollow = recorddict_to_proto(RecordDict({key: _hollow(record) for key, record in content.items()}))
    grown = 0
    for item, record in zip(hollow.items, content.values(), strict=True):
        if not isinstance(record, ArrayRecord):
            continue
        of_record = 0
        for entry, array in zip(item.array_record.items, record.values(), strict=True):
            data = len(array.data)
            of_array = 1 + _varint(data) + data if data else 0
            of_record += _growth(_growth(of_array, entry.value.ByteSize()), entry.ByteSize())
        grown += _growth(_growth(of_record, item.array_record.ByteSize()), item.ByteSize())
    return int(hollow.ByteSize()) + grown


def _hollow(record: object) -> object:
    if not isinstance(record, ArrayRecord):
        return record
    hollow = ((key, Array(each.dtype, each.shape, each.stype, b"")) for key, each in record.items())
    return ArrayRecord(OrderedDict(hollow))


def _growth(inside: int, before: int) -> int:
    """What a message grows by, whose field of `before` bytes grows by `inside`: its length may need more digits."""
    return inside + _varint(before + inside) - _varint(before)


def _varint(value: int) -> int:
    """Bytes of a number: seven bits in each."""
    return max(1, -(-value.bit_length() // 7))
