"""Subscription: one topic's messages on their way to whoever handles them here."""

from __future__ import annotations

import logging
from collections.abc import Callable
from inspect import iscoroutinefunction
from typing import Any, Protocol

import msgspec

from mindstage.bridge.protocol import Publish, Subscribe

__all__ = ["CallbackTask", "MessageHandler", "MessageSender", "Subscription"]

MessageHandler = Callable[..., object]
"""Gets a message as plain values, in a worker thread and in order; or is a coroutine function, and runs on the loop.
One that asked for it gets the `MessageSender` too, or None where nobody knows who that is."""

_log = logging.getLogger("mindstage.bridge")


class MessageSender(Protocol):
    """Whoever published a message, at a hub in this process."""

    has_left: bool
    """Whether it has left since."""

    def __hash__(self) -> int: ...


class Subscription:
    """Handles one topic's messages until `close`."""

    def __init__(
        self, request: Subscribe, handler: MessageHandler, close: Callable[[Subscription], None], *, with_sender: bool
    ) -> None:
        self.request = request
        self.handler = handler
        self.is_async = iscoroutinefunction(handler)
        self.with_sender = with_sender
        self._close = close

    @property
    def topic(self) -> str:
        """Where it listens."""
        return self.request.topic

    def close(self) -> None:
        """Ends it, any number of times; what is being handled is handled to its end."""
        self._close(self)


class CallbackTask:
    """One message for one handler, read where it is handled."""

    def __init__(self, subscription: Subscription, message: Publish, sender: MessageSender | None) -> None:
        self._subscription = subscription
        self._message = message
        self._sender = sender

    def __call__(self) -> None:
        """Handles it, whatever comes of it."""
        try:
            self._handle()
        except Exception:
            self._log_error()

    async def run(self) -> None:
        """The same where the handler is a coroutine function."""
        try:
            await self._handle()
        except Exception:
            self._log_error()

    def _handle(self) -> Any:
        values = msgspec.json.decode(self._message.msg)
        senders = (self._sender,) if self._subscription.with_sender else ()
        return self._subscription.handler(values, *senders)

    def _log_error(self) -> None:
        _log.exception("the handler of messages on %s broke", self._message.topic)
