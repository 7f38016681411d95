"""Bytes of Flower's messages."""

from __future__ import annotations

from math import prod
from typing import NamedTuple

import numpy as np
from flwr.app import Message
from flwr.common.serde import message_to_proto, metadata_to_proto
from flwr.proto.message_pb2 import Message as ProtoMessage


class Sizes(NamedTuple):
    """Of a message: serialised as a whole, and the elements of its arrays alone."""

    message: int
    arrays: int


def size_of(message: Message, shares: dict[int, Sizes]) -> Sizes:
    """Bytes of a message.

    Args:
        shares: what contents add, by `id`: many clients are sent the very same, which is then serialised once. It holds
            as long as those contents do.
    """
    if not message.has_content():
        return Sizes(message_to_proto(message).ByteSize(), 0)
    bare = ProtoMessage(metadata=metadata_to_proto(message.metadata)).ByteSize()
    if (share := shares.get(id(message.content))) is None:
        whole = message_to_proto(message).ByteSize()
        share = shares[id(message.content)] = Sizes(whole - bare, array_bytes(message))
    return Sizes(bare + share.message, share.arrays)


def array_bytes(message: Message) -> int:
    """Elements x bytes of one; of what is no NumPy array, compressed say, as it is sent."""
    arrays = [each for record in message.content.array_records.values() for each in record.values()]
    return sum(
        prod(each.shape) * np.dtype(each.dtype).itemsize if each.stype == "numpy.ndarray" else len(each.data)
        for each in arrays
    )
