"""RemoteEngine: the base class of engines that run in another process, reached through rosbridge.

There are two kinds, and `connect` detects which one answers: another Mindstage offers the whole `Engine` protocol
(`MindstageRemoteEngine`), Unreal's plugin a part of it (`UnrealEngine`). Both raise an `EngineError` within their
timeout while the connection is lost; the first call after it is restored succeeds again.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping

from mindstage.engines.base import ActuatorState, Contact, DynamicsScale, Engine, EngineStats, SpawnNote
from mindstage.engines.remote.client import RemoteProfile, ServiceClient
from mindstage.errors import EngineClosedError, UnsupportedByEngineError
from mindstage.ranges import Finite, checked
from mindstage.scene import BodyId

__all__ = ["RemoteEngine"]


class RemoteEngine(Engine):
    """The connection that all remote engines share. Create one with `connect`."""

    profile: RemoteProfile

    def __init__(self, client: ServiceClient) -> None:
        self._client = client
        self._closed = False

    @property
    def name(self) -> str:
        """The address, without the token."""
        return self._client.name

    @property
    def notes(self) -> tuple[SpawnNote, ...]:
        """None: the wire has no messages for them."""
        return ()

    @property
    def state_key(self) -> object:
        """None: other clients may change the world."""
        return None

    @abstractmethod
    def ping(self) -> float:
        """Calls the engine and returns the round-trip time [s].

        Raises:
            EngineError: the engine does not answer.
        """

    def stats(self) -> EngineStats:
        """Not available over the wire; no remote engine has the capability.

        Raises:
            UnsupportedByEngineError: always.
        """
        self._require_open()
        raise UnsupportedByEngineError(self.name, what="report its activity", remedy="inspect it on its own machine")

    def fork(self) -> Engine:
        """Not available over the wire; no remote engine has the capability.

        Raises:
            UnsupportedByEngineError: always.
        """
        self._require_open()
        remedy = "spawn its snapshot in a MujocoEngine, which has no velocities then"
        raise UnsupportedByEngineError(self.name, what="fork", remedy=remedy)

    def scale_dynamics(self, scales: Mapping[BodyId, DynamicsScale]) -> None:
        """Not available over the wire; no remote engine has the capability.

        Raises:
            UnsupportedByEngineError: always.
        """
        self._require_open()
        raise UnsupportedByEngineError(self.name, what="scale masses and frictions", remedy="fork its simulation")

    @checked
    def set_commands(self, commands: Mapping[str, Finite]) -> None:
        """See `Engine`.

        Raises:
            UnsupportedByEngineError: the engine has no such capability.
        """
        raise self._unsupported_actuators()

    def actuator_states(self) -> Mapping[str, ActuatorState]:
        """See `set_commands`."""
        raise self._unsupported_actuators()

    def _unsupported_actuators(self) -> UnsupportedByEngineError:
        self._require_open()
        remedy = "use mujoco, or godot"
        return UnsupportedByEngineError(self.name, what="drive joints", remedy=remedy)

    def contacts(self) -> tuple[Contact, ...]:
        """Not available over the wire; no remote engine has the capability.

        Raises:
            UnsupportedByEngineError: always.
        """
        self._require_open()
        raise UnsupportedByEngineError(self.name, what="report contacts", remedy="fork its simulation")

    def close(self) -> None:
        """Disconnects from the engine, which continues to run; closing it again has no effect."""
        if not self._closed:
            self._closed = True
            self._disconnect()
            self._client.close()

    def _disconnect(self) -> None:
        """Releases resources on the remote side before disconnecting; must not raise."""

    def _require_open(self) -> ServiceClient:
        if self._closed:
            raise EngineClosedError(self.name)
        return self._client
