"""A queue of requests that takes turns between clients, and which client a thread handles a request of.

A client with many waiting requests does not delay the others: each has one turn in every round.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from itertools import chain
from typing import Generic, TypeVar

from mindstage.access.limits import Limit
from mindstage.errors import RequestLimitError

__all__ = ["FairQueue", "current_caller", "handling_for"]

T = TypeVar("T")
_caller: ContextVar[Hashable] = ContextVar("caller", default=None)


@contextmanager
def handling_for(caller: Hashable) -> Iterator[None]:
    """In the context, this thread handles a request of one connection."""
    token = _caller.set(caller)
    try:
        yield
    finally:
        _caller.reset(token)


def current_caller() -> Hashable:
    """The connection whose request this thread handles; None outside of requests."""
    return _caller.get()


class FairQueue(Generic[T]):
    """Waiting items of clients, taken round robin by client, of each client in their order; not thread-safe."""

    def __init__(self, *, per_client: Limit, total: Limit) -> None:
        """Creates an empty queue.

        Args:
            per_client: largest number of waiting items of one client.
            total: largest number of waiting items.
        """
        self._per_client, self._total = per_client, total
        self._waiting: dict[Hashable, deque[T]] = {}
        """The items of each client that has any; the first client is the next."""
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[T]:
        """The waiting items of one client after the other."""
        return chain.from_iterable(self._waiting.values())

    def put(self, client: Hashable, item: T, *, subject: str) -> None:
        """Adds an item behind those of its client.

        Args:
            client: whose item it is.
            subject: what is requested, for the error.

        Raises:
            RequestLimitError: too many items wait already.
        """
        own = len(self._waiting.get(client, ()))
        if own >= self._per_client.count:
            cause = f"{own} requests of this client wait already, and at most {self._per_client.count} may"
            raise RequestLimitError(subject, cause=f"{cause}; wait for the responses")
        if self._count >= self._total.count:
            cause = f"{self._count} requests wait already, and at most {self._total.count} may"
            raise RequestLimitError(subject, cause=f"{cause}; try again later")
        self._waiting.setdefault(client, deque()).append(item)
        self._count += 1

    def pop(self) -> T | None:
        """Removes the oldest item of the client whose turn it is; None if nothing waits."""
        if not self._waiting:
            return None
        client = next(iter(self._waiting))
        items = self._waiting.pop(client)
        item = items.popleft()
        self._count -= 1
        if items:
            self._waiting[client] = items  # behind all others
        return item

    def place(self, item: T) -> int | None:
        """How many items are taken until this one is, itself included; None if it does not wait."""
        queues = list(self._waiting.values())
        for turn, items in enumerate(queues):
            if item in items:
                before = items.index(item)
                earlier = sum(min(len(each), before + 1) for each in queues[:turn])
                return earlier + before + 1 + sum(min(len(each), before) for each in queues[turn + 1 :])
        return None

    def remove_if(self, condition: Callable[[T], bool]) -> list[T]:
        """Removes the items that fulfill a condition, and returns them."""
        removed = [item for item in self if condition(item)]
        if removed:
            kept = {
                client: deque(each for each in items if not condition(each)) for client, items in self._waiting.items()
            }
            self._waiting = {client: items for client, items in kept.items() if items}
            self._count -= len(removed)
        return removed
