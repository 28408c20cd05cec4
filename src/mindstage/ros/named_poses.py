"""Named poses as in simulation_interfaces: support surfaces, free places on them, and handles.

- `BODY/on`, `BODY/inside`: the center of a level support surface, with z up; the tags have `support_surface`. A second
  surface is `BODY/on_2`. Its bounds are the rectangle of the surface, up to what is above but does not stand on it.
- `BODY/on/free`: a pose near that center at which a cube of 10 cm overlaps no other body; the tags have `placement`.
  Its bounds are that cube.
- `BODY/grasp`: the pose of a handle; the tags have `handle`. Its bounds are its box.

The tags also have `on` or `inside`, `spawn` where something can be spawned, and the class of the body. All poses are
those of the current state.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from mindstage.access.limits import TESTED_PLACES
from mindstage.access.policies import QUERY
from mindstage.bridge.conversions import pose_message
from mindstage.errors import NameNotFoundError
from mindstage.msgs import geometry_msgs
from mindstage.msgs import simulation_interfaces as wire
from mindstage.rdf.graphs import local_name
from mindstage.rdf.vocabulary import knowrob
from mindstage.ros.service import OK, ResultError, ServiceSpec
from mindstage.ros.simulation_interfaces import bounds_of, has_tags
from mindstage.ros.state import StateReader
from mindstage.scene import Body, BodyId, Iri, Pose, Vector
from mindstage.scene.bounding_boxes import OrientedBoxes
from mindstage.scene.placement import PlacementSampler, PlacementSurface, support_surfaces
from mindstage.scene.transforms import Array, normalize, pose_from_array
from mindstage.simulation.placement import enclosing_body_ids

__all__ = ["NamedPoseServices"]

_SURFACE, _PLACEMENT, _HANDLE = "support_surface", "placement", "handle"
_HANDLE_CLASS = knowrob("Handle")
_ITEM_SIZE_M: Vector = (0.1, 0.1, 0.1)
"""Size of the cube for which free places are found."""
_MAX_HEIGHT_M = 2.0
"""Height of the bounds of a surface with nothing above it."""
_STANDING_M = 0.01
"""A body whose underside is nearer to a surface stands on it."""


class _NamedPose(NamedTuple):
    message: wire.NamedPose
    surface: PlacementSurface | None
    """Its support surface; None for other poses."""
    size: Vector | None
    """The extents of its bounds about the pose, unless it is a surface."""


class NamedPoseServices:
    """Services that list named poses and return their bounds."""

    def __init__(self, state_reader: StateReader) -> None:
        self._state_reader = state_reader
        self._simulation = state_reader.simulation

    def services(self) -> Iterator[ServiceSpec]:
        """Yields all services."""
        yield ServiceSpec(wire.GetNamedPoses, self.get_poses, QUERY)
        yield ServiceSpec(wire.GetNamedPoseBounds, self.get_bounds, QUERY)

    def get_poses(self, request: wire.GetNamedPoses.Request) -> wire.GetNamedPoses.Response:
        """Returns the named poses with matching tags."""
        scene = _Scene(self._state_reader)
        poses = tuple(each.message for each in scene.named_poses(lambda _, tags: has_tags(tags, request.tags)))
        return wire.GetNamedPoses.Response(result=OK, poses=poses)

    def get_bounds(self, request: wire.GetNamedPoseBounds.Request) -> wire.GetNamedPoseBounds.Response:
        """Returns the bounds of a named pose in its own frame."""
        scene = _Scene(self._state_reader)
        named = next(scene.named_poses(lambda name, _: name == request.name), None)
        if named is None:
            names = [each.message.name for each in scene.named_poses(lambda _, tags: _PLACEMENT not in tags)]
            error = NameNotFoundError(request.name, entity_type="named pose", known=names)
            raise ResultError(wire.ResultCode.RESULT_NOT_FOUND, str(error))
        bounds = bounds_of(named.size) if named.surface is None else scene.surface_bounds(named.surface)
        return wire.GetNamedPoseBounds.Response(result=OK, bounds=bounds)


class _Scene:
    """The bodies at their current poses."""

    def __init__(self, state_reader: StateReader) -> None:
        self._simulation = state_reader.simulation
        snapshot = state_reader.state()
        bodies = {body.id: body for body in state_reader.world().bodies}
        rows = [row for row, id in enumerate(snapshot.ids) if id in bodies]
        self._ids = [snapshot.ids[row] for row in rows]
        self._bodies = bodies
        self._poses = snapshot.poses[rows].reshape(-1, 7).copy()
        self._poses[:, 3:] = normalize(self._poses[:, 3:])
        self._geometry = self._simulation.geometry
        self._sampler: PlacementSampler | None = None

    def named_poses(self, is_wanted: Callable[[str, tuple[str, ...]], bool]) -> Iterator[_NamedPose]:
        """Yields the named poses of which the name and the tags are wanted."""
        for id, pose in zip(self._ids, self._poses, strict=True):
            body = self._bodies[id]
            for inside in (False, True):
                for number, surface in enumerate(self._surfaces(body, pose, inside=inside), start=1):
                    yield from self._surface_poses(body, surface, number, is_wanted, inside=inside)
            if self._is_handle(body):
                named = _grasp_pose(body, pose)
                if is_wanted(named.message.name, named.message.tags):
                    yield named

    def surface_bounds(self, surface: PlacementSurface) -> wire.Bounds:
        """Returns the space above a support surface, in the frame of its named pose."""
        (x, y), height = surface.size, surface.surface.clearance
        if height is None:
            height = self._free_height(surface)
        upper, lower = geometry_msgs.Vector3(x=x / 2, y=y / 2, z=height), geometry_msgs.Vector3(x=-x / 2, y=-y / 2)
        return wire.Bounds(type=wire.BoundsType.TYPE_BOX, points=(upper, lower))

    def _surfaces(self, body: Body, pose: Array, *, inside: bool) -> list[PlacementSurface]:
        found = support_surfaces(body, self._geometry.get(body.id), pose, inside=inside)
        return sorted(found, key=lambda surface: -surface.size[0] * surface.size[1])

    def _surface_poses(
        self,
        body: Body,
        surface: PlacementSurface,
        number: int,
        is_wanted: Callable[[str, tuple[str, ...]], bool],
        *,
        inside: bool,
    ) -> Iterator[_NamedPose]:
        where = "inside" if inside else "on"
        name = f"{body.id}/{where}" + (f"_{number}" if number > 1 else "")
        tags = (where, "spawn", local_name(body.cls))
        if is_wanted(name, (_SURFACE, *tags)):
            size = f"{surface.size[0]:.2f} m x {surface.size[1]:.2f} m"
            text = f"center of a support surface {where} {body.label or body.id}, {size}"
            pose = pose_message(pose_from_array(surface.pose))
            message = wire.NamedPose(name=name, description=text, tags=(_SURFACE, *tags), pose=pose)
            yield _NamedPose(message, surface, None)
        name = f"{name}/free"
        if is_wanted(name, (_PLACEMENT, *tags)) and (free := self._free_pose(surface)):
            text = f"free place for a cube of 10 cm {where} {body.label or body.id}"
            message = wire.NamedPose(name=name, description=text, tags=(_PLACEMENT, *tags), pose=pose_message(free))
            yield _NamedPose(message, None, _ITEM_SIZE_M)

    def _free_pose(self, surface: PlacementSurface) -> Pose | None:
        """Returns the tested pose nearest to the center of a surface at which the cube is free."""
        if min(surface.size) < max(_ITEM_SIZE_M[:2]):
            return None
        if self._sampler is None:
            ignored = enclosing_body_ids(self._simulation)
            self._sampler = PlacementSampler(self._bodies, self._geometry, self._ids, self._poses, ignored)
        cube = Body(id=BodyId(""), iri=Iri(""), cls=Iri(""), pose=Pose(), size=_ITEM_SIZE_M)
        candidates, _ = self._sampler.candidate_poses(cube, None, surface, max_tested=TESTED_PLACES.count)
        return candidates[0] if candidates else None

    def _free_height(self, surface: PlacementSurface) -> float:
        """Returns the height up to the lowest body above a surface, by their axis-aligned bounding boxes [m]."""
        sizes = np.array([self._bodies[id].size or (0.0, 0.0, 0.0) for id in self._ids], dtype=np.float64)
        low, high = OrientedBoxes.from_poses(self._poses, sizes.reshape(-1, 3)).bounds()
        flat = np.array([[*surface.size, 0.0]])
        (least,), (most,) = OrientedBoxes.from_poses(surface.pose[None], flat).bounds()
        above = np.all((low[:, :2] < most[:2]) & (high[:, :2] > least[:2]), axis=1)
        above &= low[:, 2] > surface.pose[2] + _STANDING_M
        heights = low[above, 2] - surface.pose[2]
        return min(float(heights.min(initial=_MAX_HEIGHT_M)), _MAX_HEIGHT_M)

    def _is_handle(self, body: Body) -> bool:
        if local_name(body.cls) == local_name(_HANDLE_CLASS):
            return True
        return self._simulation.knowledge.reasoner.is_a(body.cls, _HANDLE_CLASS)


def _grasp_pose(body: Body, pose: Array) -> _NamedPose:
    message = wire.NamedPose(
        name=f"{body.id}/grasp",
        description=f"handle {body.label or body.id}",
        tags=(_HANDLE, local_name(body.cls)),
        pose=pose_message(pose_from_array(pose)),
    )
    return _NamedPose(message, None, body.size)
