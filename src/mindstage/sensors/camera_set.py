"""The cameras of a simulation by name: those of its robots, and those that were added."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from msgspec.structs import replace

from mindstage.errors import InvalidArgumentError, NameNotFoundError
from mindstage.scene import BodyId, PoseLike
from mindstage.scene.world_model import as_pose
from mindstage.sensors.camera import Camera
from mindstage.sensors.camera_model import CameraModel, CameraMount
from mindstage.sensors.stage import CameraStage, SensedSession

__all__ = ["CameraSet", "HasCameras"]


class HasCameras(Protocol):
    """A robot."""

    @property
    def cameras(self) -> tuple[CameraMount, ...]:
        """Its cameras."""


class SessionWithRobots(SensedSession, Protocol):
    """A simulation."""

    @property
    def robots(self) -> Mapping[str, HasCameras]:
        """The robots by name."""


class CameraSet:
    """The cameras of one simulation."""

    def __init__(self, session: SessionWithRobots) -> None:
        """There are those of robots first.

        Args:
            session: the simulation.
        """
        self._session = session
        self._stage = CameraStage(session)
        self._added: dict[str, CameraMount] = {}

    def mounts(self) -> dict[str, CameraMount]:
        """All cameras: those that were added by name, then those of robots by ROBOT/NAME."""
        found = dict(self._added)
        for name, robot in self._session.robots.items():
            found |= {f"{name}/{each.name}": replace(each, name=f"{name}/{each.name}") for each in robot.cameras}
        return found

    def camera(self, name: str) -> Camera:
        """See `Simulation.camera`."""
        mounts = self.mounts()
        for key in ((lambda full: full), (lambda full: full.rpartition("/")[2]), _beginning):
            found = [full for full in mounts if key(full) == name or not name]
            if len(found) == 1:
                return Camera(mounts[found[0]], self._stage)
            if found:
                cause = f"{name or 'no name'} may stand for {' or '.join(found)}"
                raise InvalidArgumentError("a camera", cause=cause, remedy="give the whole name of one of them")
        raise NameNotFoundError(name or "camera", entity_type="camera", known=mounts)

    def add(self, name: str, model: CameraModel | None, *, at: PoseLike, on: BodyId | None) -> Camera:
        """See `Simulation.add_camera`."""
        self._added[name] = CameraMount(
            name=name, model=model or CameraModel(), body=on, pose=as_pose(at, "at"), frame=f"{name}_optical_frame"
        )
        return Camera(self._added[name], self._stage)

    def copy_from(self, other: CameraSet) -> None:
        """Adds the cameras that were added to another simulation."""
        self._added |= other._added

    def close(self) -> None:
        """Frees what renders."""
        self._stage.close()


def _beginning(name: str) -> str:
    return name.rpartition("/")[2].partition("_")[0]
