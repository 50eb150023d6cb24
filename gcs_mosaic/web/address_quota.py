"""Places for visitors: so many in all, and so many of one address, so that nobody can take them all."""

from __future__ import annotations

import ipaddress
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

SUBNET_BITS = 64  # of IPv6: whoever has one address of it has all


class AddressQuota:
    """Counts who is there. The last `per_address` places are for this machine itself, whoever else comes."""

    def __init__(self, most: int, per_address: int) -> None:
        self._most, self._per_address = most, per_address
        self._taken: Counter[str] = Counter()

    def take(self, origin: str) -> bool:
        """Whether there is a place for one more of this origin (see `origin_of`), which is then taken."""
        others = sum(count for taker, count in self._taken.items() if not is_loopback(taker))
        if self._taken.total() >= self._most or self._taken[origin] >= self._per_address:
            return False
        if not is_loopback(origin) and others >= self._most - self._per_address:
            return False
        self._taken[origin] += 1
        return True

    def greediest(self, origin: str) -> str | None:
        """Who is to make room for this origin: whoever has most places, and at least two more; never this machine for others."""
        rivals = [taker for taker in self._taken if is_loopback(origin) or not is_loopback(taker)]
        most = max(rivals, key=self._taken.__getitem__, default=None)
        return most if most is not None and self._taken[most] > self._taken[origin] + 1 else None

    def leave(self, origin: str) -> None:
        self._taken[origin] -= 1
        if not self._taken[origin]:
            del self._taken[origin]

    @contextmanager
    def taken(self, origin: str) -> Iterator[bool]:
        """A place for the block; whether there is one."""
        found = self.take(origin)
        try:
            yield found
        finally:
            if found:
                self.leave(origin)


def origin_of(remote: str | None) -> str:
    """Who a peer's address counts as: an IPv4 address, or an IPv6 network; "" for what is none."""
    try:
        address = ipaddress.ip_address((remote or "").partition("%")[0])
    except ValueError:
        return ""
    if isinstance(address, ipaddress.IPv4Address):
        return str(address)
    if address.ipv4_mapped:
        return str(address.ipv4_mapped)
    return str(address) if address.is_loopback else str(ipaddress.ip_network((address, SUBNET_BITS), strict=False))


def is_loopback(origin: str) -> bool:
    """Whether it is this machine, by its loopback addresses."""
    return origin == "::1" or origin.startswith("127.")
