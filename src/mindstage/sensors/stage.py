"""The cameras of a simulation by name, and what renders them: a thread with OpenGL, in which meshes stay uploaded."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, Protocol

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from mindstage.errors import BodyNotFoundError, InvalidArgumentError, NameNotFoundError, RendererUnavailableError
from mindstage.rendering.gl_context import OffscreenContext
from mindstage.rendering.render_scene import ClassKnowledge, RenderScene, described_world, render_scene
from mindstage.rendering.screenshot import DEFAULT_CAMERA
from mindstage.rendering.sensor_view import PinholeView, SensorImages, SensorLighting, SensorRasterizer
from mindstage.scene import BodyId, GeometryMap, PoseLike, World
from mindstage.scene.transforms import Array, normalize, normalized_pose_array
from mindstage.scene.world_model import as_pose
from mindstage.sensors.camera import Camera, SeenBody, optical_pose
from mindstage.sensors.camera_model import CameraModel, CameraMount

__all__ = ["CameraSet", "CameraStage", "HasCameras", "SensedSession", "SensedState"]

_TIMEOUT_S = 120.0
"""Longest wait for an image: the first one uploads meshes and bakes textures [s]."""


class SensedState(Protocol):
    """The part of a `StateSnapshot` that cameras see."""

    @property
    def time_s(self) -> float:
        """Simulated time [s]."""

    @property
    def ids(self) -> tuple[BodyId, ...]:
        """The bodies that exist."""

    @property
    def poses(self) -> NDArray[np.float64]:
        """N x 7, in the order of `ids`."""

    @property
    def revision(self) -> int:
        """Incremented when bodies are added, removed or changed."""


class SensedSession(Protocol):
    """The part of a `Simulation` that cameras see."""

    @property
    def state(self) -> SensedState:
        """The latest published state."""

    @property
    def worlds(self) -> tuple[World, ...]:
        """The worlds that were spawned."""

    @property
    def geometry(self) -> GeometryMap:
        """The geometry of the bodies that exist."""

    @property
    def knowledge(self) -> Any:
        """Its knowledge base."""

    def snapshot(self) -> World:
        """The current state as a world."""


class CameraStage:
    """Renders a simulation for its cameras; the bodies are uploaded again if some were added, removed or changed."""

    def __init__(self, session: SensedSession) -> None:
        """Starts nothing; the first image does.

        Args:
            session: the simulation.
        """
        self._session = session
        self._thread: ThreadPoolExecutor | None = None
        self._context: OffscreenContext | None = None
        self._rasterizer: SensorRasterizer | None = None
        self._content: tuple[object, ...] = ()
        self._revision: int | None = None
        self._ids: tuple[BodyId, ...] = ()
        self._legend: dict[int, SeenBody] = {}

    def freeze(self, mount: CameraMount) -> tuple[SensedState, Array]:
        """The present state, and the pose of the optical frame of a camera in it.

        Raises:
            BodyNotFoundError: the body that it is on was deleted.
        """
        state = self._session.state
        if mount.body is None:
            return state, optical_pose(mount, None)
        if mount.body not in state.ids:
            raise BodyNotFoundError(mount.body, known=state.ids)
        return state, optical_pose(mount, normalized_pose_array(state.poses[state.ids.index(mount.body)]))

    def render(
        self, mount: CameraMount, view: PinholeView, state: SensedState, *, lighting: SensorLighting, **asked: bool
    ) -> tuple[SensorImages, Mapping[int, SeenBody]]:
        """The images of a camera, and what the numbers in them stand for.

        Args:
            mount: the camera.
            view: what it sees, without distortion.
            state: the frozen state.
            lighting: the light.
            asked: which images are made; see `SensorRasterizer.render`.

        Raises:
            InvalidArgumentError: the camera is inside of a body.
            RendererUnavailableError: there is no OpenGL library, or it does not answer.
        """
        scene = None
        if state.revision != self._revision:
            scene = self._scene()
        if self._thread is None:
            self._thread = ThreadPoolExecutor(1, thread_name_prefix="mindstage-cameras")
        future: Future[SensorImages] = self._thread.submit(self._draw, scene, state, mount, view, lighting, asked)
        try:
            images = future.result(_TIMEOUT_S)
        except TimeoutError as error:
            cause = f"an image took more than {_TIMEOUT_S:.0f} s"
            raise RendererUnavailableError("OpenGL", cause=cause, remedy="use a GPU or smaller images") from error
        return images, self._legend

    def close(self) -> None:
        """Frees the context; calling it again is harmless."""
        thread, self._thread = self._thread, None
        if thread is not None:
            thread.submit(self._free)
            thread.shutdown(wait=True)

    # -- in the caller's thread ----------------------------------------------------------------------------------------

    def _scene(self) -> tuple[RenderScene, World]:
        session = self._session
        world = session.snapshot()
        knowledge: ClassKnowledge = session.knowledge
        described = described_world(world, session.worlds)
        return render_scene(described, session.geometry, knowledge, camera=DEFAULT_CAMERA), world

    # -- in the thread of the context ----------------------------------------------------------------------------------

    def _draw(
        self,
        scene: tuple[RenderScene, World] | None,
        state: SensedState,
        mount: CameraMount,
        view: PinholeView,
        lighting: SensorLighting,
        asked: dict[str, bool],
    ) -> SensorImages:
        if scene is not None:
            self._upload(*scene)
            self._revision = state.revision
        rasterizer = self._rasterizer
        assert rasterizer is not None
        rows = {id: row for row, id in enumerate(state.ids)}
        poses = np.tile([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], (len(self._ids), 1))
        present = [(at, rows[id]) for at, id in enumerate(self._ids) if id in rows]
        if present:
            at, row = np.array(present).T
            poses[at] = state.poses[row]
            poses[at, 3:] = normalize(poses[at, 3:])
        hidden = [at + 1 for at, id in enumerate(self._ids) if id not in rows]
        around = rasterizer.around(view.position, poses)
        housing = {*mount.owner, mount.body}
        hidden += [number for number in around if self._ids[number - 1] in housing]
        if enclosing := [number for number in around if number not in hidden]:
            found = rasterizer.enclosing(view, poses, enclosing, hidden=hidden)
            if found:
                raise InvalidArgumentError(
                    f"the camera {mount.name}",
                    cause=f"it is inside of {self._ids[found - 1]}, at {tuple(view.position.round(3).tolist())} m",
                    remedy="place it in free space",
                )
        return rasterizer.render(view, poses, hidden=hidden, lighting=lighting, **asked)

    def _upload(self, scene: RenderScene, world: World) -> None:
        content = (scene.ground_height, tuple((each.id, each.key) for each in scene.items), scene.lights)
        if self._rasterizer is not None and content == self._content:
            return
        self._free()
        self._context = OffscreenContext()
        self._rasterizer = SensorRasterizer(
            self._context.gl, scene.items, lights=scene.lights, ground_height=scene.ground_height
        )
        self._content, self._ids = content, tuple(each.id for each in scene.items)
        bodies = {body.id: body for body in world.bodies}
        self._legend = {
            number: SeenBody(id=id, iri=bodies[id].iri, cls=bodies[id].cls)
            for number, id in enumerate(self._ids, start=1)
        }

    def _free(self) -> None:
        context, self._context, self._rasterizer, self._revision = self._context, None, None, None
        if context is not None:
            context.close()


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
