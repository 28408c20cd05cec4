"""RemoteEngine: an engine at the other end of a rosbridge.

There are two kinds, and `RemoteEngine.connect` finds out which one answers: another Mindstage offers the whole contract
(`MindstageRemoteEngine`), Unreal's plugin what its services can do (`UnrealEngine`). Both are the contract's `Engine`, with
a `ping`, and both raise an `EngineError` within their timeout when the far side is gone; once it is back, the next
call reaches it again.
"""

from __future__ import annotations

from abc import abstractmethod

from mindstage.engines.base import Engine, EngineStats
from mindstage.engines.remote.client import RemoteProfile, ServiceClient
from mindstage.errors import EngineClosedError, UnsupportedByEngineError

__all__ = ["RemoteEngine"]


class RemoteEngine(Engine):
    """What both kinds share: the link and its end. Make one with `connect`."""

    profile: RemoteProfile

    def __init__(self, link: ServiceClient) -> None:
        self._client = link
        self._closed = False

    @property
    def name(self) -> str:
        """Where it is; never with the token."""
        return self._client.name

    @abstractmethod
    def ping(self) -> float:
        """Asks the engine itself for a sign of life, and gives how long that took [s].

        Raises:
            EngineError: there is none.
        """

    def stats(self) -> EngineStats:
        """How busy it is, nobody is told over the wire; no far engine declares the ability."""
        self._require_open()
        raise UnsupportedByEngineError(self.name, what="say how busy it is", remedy="look at it where it runs")

    def close(self) -> None:
        """Lets go of the far engine, which runs on; any number of times."""
        if not self._closed:
            self._closed = True
            self._disconnect()
            self._client.close()

    def _disconnect(self) -> None:
        """Says what is to be said before the end; must not raise."""

    def _require_open(self) -> ServiceClient:
        if self._closed:
            raise EngineClosedError(self.name)
        return self._client
