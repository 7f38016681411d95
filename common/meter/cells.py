"""What one key has counted: in memory, or in a file that is mapped into memory, so that counting costs no call.

A kept cell has two places in the file, written in turn: the one that is being written is marked so, and the other holds
the counts before it. Each place has a checksum of its counts and its key, so that what is not as it was written is
refused, a file of zeros too.

What others may have seen before it can be counted, such as a packet in the kernel, is announced: it stands in the file
from then on, and in no counter that is read while the process lives.
"""

from __future__ import annotations

import json
import struct
import zlib

Key = tuple[str, str, str]
Counts = tuple[int, int, int]
"""Messages, payload bytes, packet bytes."""

_COUNTS = struct.Struct("<qqq")
PLACE = 4  # numbers: three counts, and their checksum; 0 while they are written
CELL = 2 * PLACE
_KEPT = 1 << 32  # so that no checksum is 0


class Cell:
    """What one key has counted."""

    __slots__ = ("messages", "packet_bytes", "payload_bytes")

    def __init__(self, counts: Counts = (0, 0, 0)) -> None:
        self.messages, self.payload_bytes, self.packet_bytes = counts

    def add(self, payload_bytes: int, packet_bytes: int, messages: int = 1) -> None:
        """Count a message."""
        self.messages += messages
        self.payload_bytes += payload_bytes
        self.packet_bytes += packet_bytes

    def announce(self, payload_bytes: int, packet_bytes: int) -> None:
        """A message is about to happen: whoever reads the file of a process that is killed now finds it counted."""

    def withdraw(self) -> None:
        """What was announced and has not been added did not happen."""

    def forget(self) -> None:
        """Count anew from nothing."""
        self.messages = self.payload_bytes = self.packet_bytes = 0

    @property
    def counts(self) -> Counts:
        """All three."""
        return self.messages, self.payload_bytes, self.packet_bytes


class KeptCell(Cell):
    """One in a file."""

    __slots__ = ("_ahead", "_at", "_numbers", "_salt")

    def __init__(self, numbers: memoryview, key: Key, counts: Counts | None) -> None:
        """`counts`: as found in `numbers`; None: make a new one of them."""
        super().__init__(counts or (0, 0, 0))
        self._numbers, self._salt, self._at = numbers, salt_of(key), 0
        self._ahead: Counts | None = None  # with what was announced, until that is added or withdrawn
        if counts is None:
            for place in range(CELL):
                numbers[place] = 0
            numbers[PLACE - 1] = _checksum(self.counts, self._salt)
        elif counts_at(numbers, PLACE, self._salt) == counts:
            self._at = PLACE

    def add(self, payload_bytes: int, packet_bytes: int, messages: int = 1) -> None:
        self.messages += messages
        self.payload_bytes += payload_bytes
        self.packet_bytes += packet_bytes
        counts = self.messages, self.payload_bytes, self.packet_bytes
        if self._ahead is not None and counts[0] < self._ahead[0]:
            return  # it was announced with others, and the file is ahead
        if counts != self._ahead:
            self._write(self._at ^ PLACE, counts)
        self._at ^= PLACE
        self._ahead = None

    def announce(self, payload_bytes: int, packet_bytes: int) -> None:
        messages, payloads, packets = self._ahead or self.counts
        self._ahead = messages + 1, payloads + payload_bytes, packets + packet_bytes
        self._write(self._at ^ PLACE, self._ahead)

    def withdraw(self) -> None:
        if self._ahead is not None:
            # The older place first: while it is written the newer one counts, with what was announced.
            self._write(self._at, self.counts)
            self._write(self._at ^ PLACE, self.counts)
            self._ahead = None

    def forget(self) -> None:
        super().forget()
        # In this order: whoever is killed in between has what was counted, or nothing, and never half of it.
        self._write(self._at ^ PLACE, self.counts)
        self._numbers[self._at + 3] = 0
        self._at ^= PLACE
        self._ahead = None

    def _write(self, at: int, counts: Counts) -> None:
        numbers = self._numbers
        numbers[at + 3] = 0
        numbers[at], numbers[at + 1], numbers[at + 2] = counts
        numbers[at + 3] = _checksum(counts, self._salt)


def counts_at(numbers: memoryview, at: int, salt: int) -> Counts | None:
    """Those of a place, if it was written to its end."""
    counts = numbers[at], numbers[at + 1], numbers[at + 2]
    return counts if numbers[at + 3] == _checksum(counts, salt) else None


def _checksum(counts: Counts, salt: int) -> int:
    return zlib.crc32(_COUNTS.pack(*counts), salt) | _KEPT


def salt_of(key: Key) -> int:
    """What ties the checksums of a cell to its key."""
    return zlib.crc32(json.dumps(key).encode())
