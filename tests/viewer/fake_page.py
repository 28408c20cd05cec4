"""A page that is none: it asks a channel's handlers as a socket would, and hears what all are told."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import msgspec

from mindstage.viewer.server import RpcChannel, _Request


class FakePage:
    """One visitor without a browser."""

    def __init__(self, channel: RpcChannel) -> None:
        self._channel = channel
        self.session: Any = SimpleNamespace(key="pretended", state={})

    def ask(self, method: str, **arguments: object) -> Any:
        """What the server answers; an error's words are raised as a `RequestFailed`."""
        request = _Request(id=1, method=method, arguments=msgspec.Raw(msgspec.json.encode(arguments)))
        reply = msgspec.json.decode(self._channel._run_handler(self.session, request))
        if "error" in reply:
            raise RequestFailed(f"{reply['error']['type']}: {reply['error']['message']}")
        return reply["result"]

    def latest_value(self, topic: str) -> Any:
        """What a visitor who comes now is told about a topic; None if nothing."""
        text = self._channel._states.get(topic)
        return None if text is None else msgspec.json.decode(text)["value"]


class RequestFailed(Exception):
    """The server said no."""
