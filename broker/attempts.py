"""Logins that fail, by where they come from: who fails too often has to wait before the next is looked at."""

from __future__ import annotations

import ipaddress
from collections import OrderedDict

AT_ONCE = 10  # failures of one address that are looked at as fast as they come
EVERY_S = 5.0  # and one more in each such time
ADDRESSES = 1000  # held at most; the one that failed last longest ago is forgotten first


class Attempts:
    """A leaky bucket for each address (the generic cell rate algorithm, ITU-T I.371): one number is its whole state."""

    def __init__(self) -> None:
        self._empty_at_s: OrderedDict[str, float] = OrderedDict()

    def must_wait(self, source: str, now_s: float) -> bool:
        """Whether a login of this address is not looked at yet."""
        return self._empty_at_s.get(source, now_s) > now_s + (AT_ONCE - 1) * EVERY_S

    def failed(self, source: str, now_s: float) -> None:
        """Note that a login of this address has failed."""
        self._empty_at_s[source] = max(self._empty_at_s.pop(source, now_s), now_s) + EVERY_S
        if len(self._empty_at_s) > ADDRESSES:
            self._empty_at_s.popitem(last=False)


def source_of(host: str) -> str:
    """What counts as one address: that of IPv4, the first 64 bits of IPv6, of which every subscriber has all others."""
    address = ipaddress.ip_address(host.partition("%")[0])
    if address.version == 4:
        return str(address)
    return str(address.ipv4_mapped or ipaddress.ip_network((address, 64), strict=False))
