"""A fake page that calls the handlers of a channel directly, without a websocket."""

from __future__ import annotations

from concurrent.futures import wait
from types import SimpleNamespace
from typing import Any

import msgspec

from mindstage.viewer.server import Later, RpcChannel, _Request


class FakePage:
    """One session without a browser."""

    def __init__(self, channel: RpcChannel) -> None:
        self._channel = channel
        self.session: Any = SimpleNamespace(key="fake", state={})

    def ask(self, method: str, **arguments: object) -> Any:
        """Sends a request; an error response is raised as a `RequestFailedError`."""
        request = _Request(id=1, method=method, params=msgspec.Raw(msgspec.json.encode(arguments)))
        text = self._channel._run_handler(self.session, request)
        while isinstance(text, Later):
            wait([text.future], timeout=60.0)
            text = self._channel._run_handler(self.session, request, text)
        reply = msgspec.json.decode(text)
        if "error" in reply:
            raise RequestFailedError(f"{reply['error']['code']}: {reply['error']['message']}")
        return reply["result"]

    def latest_value(self, topic: str) -> Any:
        """The value of a topic that a new session receives, or None."""
        text = self._channel._states.get(topic)
        return None if text is None else msgspec.json.decode(text)["value"]


class RequestFailedError(Exception):
    """The server responded with an error."""
