"""Path-traced pictures of simulations: one state, seen from any camera, and the cameras of films."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from msgspec.structs import replace

from mindstage.engines.base import SpawnNoteKind
from mindstage.errors import InvalidArgumentError
from mindstage.rendering.appearance import compute_appearance
from mindstage.rendering.camera import CameraPose, corners, focus_camera, initial_target
from mindstage.rendering.path_tracing import PathTracedPicture, PathTracingSettings, path_trace
from mindstage.rendering.render_scene import ClassKnowledge, RenderScene, render_scene
from mindstage.scene import BodyId, Color, Pose, Vector, World
from mindstage.scene.geometry import GeometryMap
from mindstage.scene.transforms import Array, normalized_pose_array, pose_array, quat_rotate
from mindstage.simulation.highlights import Marker
from mindstage.simulation.marker_items import marker_items
from mindstage.simulation.state import EngineSession

__all__ = ["ScenePhotographer", "flight", "render_picture", "turntable"]


class ScenePhotographer:
    """A world in one state, from which scenes for any camera are made."""

    def __init__(
        self,
        world: World,
        described: Mapping[BodyId, Pose],
        geometry: GeometryMap,
        knowledge: ClassKnowledge,
        *,
        highlights: Mapping[BodyId, Color] | None = None,
        markers: Collection[Marker] = (),
        enclosing: Collection[BodyId] = (),
    ) -> None:
        """Decides how the bodies are drawn.

        Args:
            world: the world, with the current poses.
            described: the poses of its description, from which it is found what is a wall and which way it faces.
            geometry: the geometry of its bodies.
            knowledge: the knowledge base of its classes.
            highlights: the colors of highlighted bodies.
            markers: visualization markers; their texts are not drawn.
            enclosing: bodies that the engine reported as enclosures.
        """
        self._world, self._geometry, self._knowledge = world, geometry, knowledge
        self._poses = {body.id: body.pose for body in world.bodies}
        self._highlights, self._enclosing = dict(highlights or {}), frozenset(enclosing)
        bodies = tuple(replace(body, pose=described.get(body.id, body.pose)) for body in world.bodies)
        self._described = replace(world, bodies=bodies)
        self._appearances = compute_appearance(
            self._described, knowledge.shape_rule, knowledge.ancestors, geometry=geometry, enclosing=self._enclosing
        )
        self._markers = tuple(marker_items(markers, {id: each.whole_visuals for id, each in self._appearances.items()}))

    @classmethod
    def of(cls, simulation: EngineSession) -> ScenePhotographer:
        """The current state of a simulation, with its highlights; it may go on."""
        described = {body.id: body.pose for world in simulation.worlds for body in world.bodies}
        reports = simulation.reports
        return cls(
            simulation.snapshot(),
            described,
            simulation.geometry,
            simulation.knowledge,
            highlights=dict(simulation.state.highlights),
            markers=simulation.state.markers,
            enclosing={id for report in reports for id in report.ids_with_note(SpawnNoteKind.ENCLOSURE)},
        )

    def scene(
        self,
        camera: CameraPose | None = None,
        *,
        aspect: float = 1.6,
        hidden: Collection[BodyId] = (),
        clip_height: float | None = None,
    ) -> RenderScene:
        """What a camera sees, by default that of the first view.

        Args:
            camera: the camera.
            aspect: the aspect ratio of the picture, for the first view.
            hidden: bodies that are left out, such as a robot around its own camera.
            clip_height: nothing above this height is drawn [m].
        """
        return render_scene(
            self._described,
            self._geometry,
            self._knowledge,
            camera=camera,
            aspect=aspect,
            poses=self._poses,
            enclosing=self._enclosing,
            highlights=self._highlights,
            hidden=hidden,
            clip_height=clip_height,
            appearances=self._appearances,
            ghosts=self._markers,
        )

    def first_camera(self, aspect: float, *, upright: bool = False) -> CameraPose:
        """The camera of the first view; an upright one keeps vertical edges vertical, by a shifted lens."""
        target = initial_target(self._described, self._appearances)
        return target.upright_camera(aspect) if upright else target.camera(aspect)

    def top_camera(self, aspect: float) -> CameraPose:
        """The camera that looks down."""
        return initial_target(self._described, self._appearances).top_camera(aspect)

    def camera_to(self, id: str, aspect: float) -> CameraPose:
        """The camera that a body fills, from the direction of the first view.

        Raises:
            BodyNotFoundError: no body has this id.
        """
        body = self._world.body(BodyId(id))
        points = corners(pose_array([body.pose]), np.array([self._appearances[body.id].size]))
        first = self.first_camera(aspect)
        return focus_camera(points, first.position, first.look_at, aspect)

    def center_of(self, id: str) -> Vector:
        """The center of a body [m].

        Raises:
            BodyNotFoundError: no body has this id.
        """
        return self._world.body(BodyId(id)).pose.position

    def camera_of_link(self, id: BodyId, *, forward: Vector, field_of_view_rad: float) -> CameraPose:
        """The camera of a robot.

        Args:
            id: the body of the link that it is on.
            forward: the direction in which it looks, in the frame of the link.
            field_of_view_rad: its vertical field of view.
        """
        pose = normalized_pose_array(self._poses[id])
        ahead = quat_rotate(pose[3:], np.array(forward))
        return CameraPose(_vector(pose[:3]), _vector(pose[:3] + ahead), field_of_view_rad)


def render_picture(
    simulation: EngineSession,
    camera: CameraPose | None = None,
    settings: PathTracingSettings | None = None,
    *,
    clip_height: float | None = None,
) -> PathTracedPicture:
    """Renders the current state of a simulation; see `Simulation.render`."""
    chosen = settings or PathTracingSettings()
    aspect = chosen.size[0] / chosen.size[1]
    scene = ScenePhotographer.of(simulation).scene(camera, aspect=aspect, clip_height=clip_height)
    return path_trace(scene, chosen)


def turntable(camera: CameraPose, count: int) -> list[CameraPose]:
    """Cameras on a circle about the vertical through the point that a camera looks at.

    Args:
        camera: the first one.
        count: their number; the one after the last is the first again.
    """
    away = np.subtract(camera.position, camera.look_at)
    found = []
    for number in range(count):
        angle = 2 * np.pi * number / count
        cosine, sine = np.cos(angle), np.sin(angle)
        turned = np.array([cosine * away[0] - sine * away[1], sine * away[0] + cosine * away[1], away[2]])
        found.append(replace(camera, position=_vector(np.array(camera.look_at) + turned)))
    return found


def flight(stops: Sequence[CameraPose], count: int) -> list[CameraPose]:
    """Cameras on a smooth path through several ones (a Catmull-Rom spline), which begins and ends slowly.

    Args:
        stops: at least two cameras.
        count: the number of cameras of the path, at least two.

    Raises:
        InvalidArgumentError: there are fewer than two stops.
    """
    if len(stops) < 2:
        raise InvalidArgumentError("--flight", cause="it has fewer than two stops", remedy="give at least two cameras")
    values = np.array([(*stop.position, *stop.look_at, stop.field_of_view_rad) for stop in stops])
    padded = np.concatenate([values[:1], values, values[-1:]])
    found = []
    for part in np.linspace(0.0, 1.0, count):
        eased = part * part * (3 - 2 * part) * (len(stops) - 1)
        row = min(int(eased), len(stops) - 2)
        before, start, end, after = padded[row : row + 4]
        t = eased - row
        point = 0.5 * (
            2 * start
            + (end - before) * t
            + (2 * before - 5 * start + 4 * end - after) * t**2
            + (3 * start - before - 3 * end + after) * t**3
        )
        found.append(CameraPose(_vector(point[:3]), _vector(point[3:6]), float(point[6])))
    return found


def _vector(array: Array) -> Vector:
    x, y, z = (float(part) for part in array)
    return x, y, z
