"""Visitors: what one address may use at a server.

A visitor is a network address, for IPv6 a network of 64 bits. Addresses of this machine are limited in failed tokens
only: programs here that call a service ten thousand times a second are normal, and could harm the machine in any case.
"""

from __future__ import annotations

import ipaddress
from collections.abc import Callable

from mindstage.access.limits import DEFAULT_VISITOR_LIMITS, VISITORS, VisitorLimits

__all__ = ["TokenBucket", "Visitor", "VisitorRegistry", "is_loopback"]


def is_loopback(host: str) -> bool:
    """Whether a host can be reached from this machine only."""
    if host.strip("[]").lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


_BURST_S = 4.0
"""The time whose allowance may be used at once [s]."""


class TokenBucket:
    """A sustained rate, with bursts."""

    def __init__(self, rate: float, burst: float) -> None:
        """Creates a full bucket.

        Args:
            rate: what is added per second [1/s].
            burst: the capacity.
        """
        self._rate, self._burst = rate, burst
        self._left = burst
        self._last_s: float | None = None

    def _refill(self, now_s: float) -> None:
        if self._last_s is not None:
            self._left = min(self._burst, self._left + (now_s - self._last_s) * self._rate)
        self._last_s = now_s

    def try_take(self, now_s: float) -> bool:
        """Takes one; False if there is none."""
        if not self.has_any(now_s):
            return False
        self._left -= 1.0
        return True

    def has_any(self, now_s: float) -> bool:
        """Whether one could be taken."""
        self._refill(now_s)
        return self._left >= 1.0

    def take(self, amount: float, now_s: float) -> float:
        """Takes an amount in any case, and returns how long to wait until it has been refilled [s]."""
        self._refill(now_s)
        self._left -= amount
        return max(0.0, -self._left / self._rate)


class Visitor:
    """What one address uses at one server."""

    def __init__(self, limits: VisitorLimits, *, is_local: bool) -> None:
        self._limits = limits
        self._is_local = is_local
        self.connections = 0
        per_second = limits.failed_tokens_per_minute / 60.0
        self._failures = TokenBucket(per_second, max(1.0, limits.failed_tokens_per_minute))
        self._messages = TokenBucket(limits.messages_per_second, max(1.0, _BURST_S * limits.messages_per_second))
        self._bytes = TokenBucket(limits.bytes_per_second, max(1.0, _BURST_S * limits.bytes_per_second))
        self._queries = TokenBucket(limits.queries_per_second, max(1.0, _BURST_S * limits.queries_per_second))

    @property
    def may_connect(self) -> bool:
        """Whether it may open a further connection."""
        return self._is_local or self.connections < self._limits.connections

    def may_try_token(self, now_s: float) -> bool:
        """Whether a token of it is checked."""
        return self._failures.has_any(now_s)

    def add_failed_token(self, now_s: float) -> None:
        """Counts a wrong token."""
        self._failures.take(1.0, now_s)

    def may_query(self, now_s: float) -> bool:
        """Whether it may send a further expensive request now; counts it."""
        return self._is_local or self._queries.try_take(now_s)

    @property
    def receive_delay(self) -> Callable[[int, float], float] | None:
        """Counts a received message by its size and time, and returns how long to wait before the next one [s].

        None if the visitor is not limited.
        """
        return None if self._is_local else self._receive_delay

    def _receive_delay(self, size: int, now_s: float) -> float:
        return max(self._messages.take(1.0, now_s), self._bytes.take(float(size), now_s))


class VisitorRegistry:
    """The visitors of one server. Belongs to the thread of the server's loop."""

    def __init__(self, limits: VisitorLimits = DEFAULT_VISITOR_LIMITS) -> None:
        """Creates a registry without visitors.

        Args:
            limits: the limits of each visitor.
        """
        self.limits = limits
        self._visitors: dict[str, Visitor] = {}

    def visitor(self, address: object) -> Visitor:
        """The visitor of the remote address of a socket, as asyncio gives it."""
        host = str(address[0]) if isinstance(address, tuple) and address else "127.0.0.1"  # else a Unix socket
        key = _network(host)
        found = self._visitors.pop(key, None)
        if found is None:
            found = Visitor(self.limits, is_local=is_loopback(key))
            self._forget_idle()
        self._visitors[key] = found  # the latest is the last
        return found

    def _forget_idle(self) -> None:
        if len(self._visitors) >= VISITORS.maximum:
            oldest = next((key for key, visitor in self._visitors.items() if not visitor.connections), None)
            if oldest is not None:
                del self._visitors[oldest]


def _network(host: str) -> str:
    try:
        address = ipaddress.ip_address(host.partition("%")[0])
    except ValueError:
        return host
    if isinstance(address, ipaddress.IPv6Address):
        if address.ipv4_mapped:
            return str(address.ipv4_mapped)
        if not address.is_loopback:
            return str(ipaddress.IPv6Network((address, 64), strict=False).network_address)
    return str(address)
