"""Advertisements and subscriptions at a rosbridge of ROS, which has only the types of the packages that it finds.

Such a server refuses each operation whose type it lacks, and one of them closes the connection when more answers wait
than its queue has places for (rosbridge-server-rs: 64, code 1013). So the first operation of each package is a probe,
what needs a package that is missing is left out, and the operations are sent in batches, each ended by a round trip.
"""

from __future__ import annotations

import asyncio
import re
from collections import Counter, deque
from collections.abc import Awaitable, Callable, Hashable, Iterator

from mindstage.access.limits import HELD_MESSAGES
from mindstage.bridge.broker import resolve_name
from mindstage.bridge.protocol import Advertise, Operation, Publish, Unadvertise

__all__ = ["ADVERTISEMENT_BATCH", "PacedAdvertising", "package_of"]

ADVERTISEMENT_BATCH = 8
"""Number of operations before a round trip."""
_PROBES = 2
"""Number of types of a package of which the server refuses all before the package counts as missing."""
_MISSING_PACKAGE = re.compile(
    r"Unable to (load the manifest|import)|install and source its ROS package|No module named|package '.*' not found"
)
"""What servers say if they lack a package and not only the type: rosbridge_suite of ROS 1 and ROS 2, and
rosbridge-server-rs."""


def package_of(operation: Operation) -> str:
    """The package of an operation's type; empty if it names none."""
    return (getattr(operation, "type", None) or "").partition("/")[0]


class PacedAdvertising:
    """What waits to be sent on one connection, and which packages the server lacks. Belongs to the loop."""

    def __init__(
        self,
        send: Callable[[Operation], None],
        round_trip: Callable[[], Awaitable[None]],
        leave_out: Callable[[Operation, str], None],
        publish: Callable[[Publish], None],
        *,
        batch: int = ADVERTISEMENT_BATCH,
    ) -> None:
        """Sends nothing yet.

        Args:
            send: sends an operation now.
            round_trip: returns when the server has handled what was sent before.
            leave_out: called with each operation that is not sent because its package is missing, and the package.
            publish: sends a message that was held, unless its topic was refused.
            batch: number of operations before a round trip.
        """
        self._send = send
        self._round_trip = round_trip
        self._leave_out = leave_out
        self._publish = publish
        self._batch = batch
        self._waiting: dict[Hashable, Operation] = {}
        self._unanswered: dict[Hashable, Operation] = {}
        self._held: dict[str, deque[Publish]] = {}
        self._sent = Counter[str]()
        self._refused = Counter[str]()
        self._missing = set[str]()
        self._has_work = asyncio.Event()
        self.is_idle = asyncio.Event()
        """Set while nothing waits."""
        self.is_idle.set()

    def add(self, key: Hashable, operation: Operation) -> None:
        """Sends an operation when it is its turn; one that waits under the same key is replaced."""
        self._waiting[key] = operation
        self.is_idle.clear()
        self._has_work.set()

    def withdraw(self, key: Hashable, operation: Operation) -> None:
        """Sends the end of an advertisement or a subscription, unless it was not sent yet."""
        if isinstance(operation, Unadvertise):
            self._held.pop(resolve_name(operation.topic), None)
        if self._waiting.pop(key, None) is None:
            self._send(operation)

    def hold(self, message: Publish) -> bool:
        """Keeps a message whose topic is not advertised yet until it is; returns whether it was kept."""
        if self.is_idle.is_set():
            return False
        name = resolve_name(message.topic)
        if not self._is_pending(name):
            return False
        self._held.setdefault(name, deque(maxlen=HELD_MESSAGES.count)).append(message)
        return True

    def on_refusal(self, operation: Operation, cause: str) -> bool:
        """Counts the refusal of an operation; returns whether its package is missing."""
        package = package_of(operation)
        if not package:
            return False
        self._refused[package] += 1
        refused = self._refused[package]
        if _MISSING_PACKAGE.search(cause) or (refused >= _PROBES and refused >= self._sent[package]):
            self._missing.add(package)
        return package in self._missing

    async def run(self) -> None:
        """Sends what waits until it is canceled."""
        while True:
            await self._has_work.wait()
            while batch := dict(self._next_batch()):
                self._unanswered = batch
                for operation in batch.values():
                    self._sent[package_of(operation)] += 1
                    self._send(operation)
                await self._round_trip()
                self._unanswered = {}
                for name in [each for each in self._held if not self._is_pending(each)]:
                    for message in self._held.pop(name):
                        self._publish(message)
            self._has_work.clear()
            self.is_idle.set()

    def _next_batch(self) -> Iterator[tuple[Hashable, Operation]]:
        """Removes the next operations from those that wait, and leaves out those of missing packages."""
        probed = set[str]()
        number = 0
        for key, operation in tuple(self._waiting.items()):
            package = package_of(operation)
            if package in self._missing:
                del self._waiting[key]
                self._leave_out(operation, package)
                continue
            if number == self._batch or package in probed:
                continue
            if package and self._sent[package] == self._refused[package]:
                probed.add(package)  # nothing of it was accepted yet
            del self._waiting[key]
            number += 1
            yield key, operation

    def _is_pending(self, topic: str) -> bool:
        """Whether the advertisement of a topic waits, or waits for its answer."""
        pending = (*self._waiting.values(), *self._unanswered.values())
        return any(isinstance(each, Advertise) and resolve_name(each.topic) == topic for each in pending)
