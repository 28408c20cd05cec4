"""Edit desk: what visitors change in the world, through the stage's editing, so that it can be undone."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Annotated, Literal

import msgspec

from mindstage.errors import BodyNotFoundError, InvalidArgumentError
from mindstage.knowledge.names import local_name
from mindstage.knowledge.reasoning import EntityType
from mindstage.stage import Simulation, StateSnapshot
from mindstage.stage.edits import MoveBody
from mindstage.stage.joints import poses_in
from mindstage.stage.putting import make_body
from mindstage.viewport.channel import RpcChannel
from mindstage.viewport.visitor import ClientSession
from mindstage.viewport.worlddesk import EmptyRequest, WorldHandler
from mindstage.world import Body, BodyId, BodyPhysics, Iri, Material, Mobility, Pose, Quaternion, Vector, World
from mindstage.world.colors import parse_color
from mindstage.world.geometry import pose_from_array

__all__ = ["EditHandler"]

_Meters = Annotated[float, msgspec.Meta(ge=-10_000.0, le=10_000.0)]
_Extent = Annotated[float, msgspec.Meta(ge=0.001, le=1000.0)]
_SLIDER_SETTLE_S = 2.0
"""After a slider was let go the hand holds on until the joint is there, or so long."""
_JOINT_TOLERANCE = 0.004
_MAX_CLASSES = 60
_CLEARANCE_M = 0.002


class MoveRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Puts a body somewhere else."""

    id: BodyId
    position: tuple[_Meters, _Meters, _Meters]
    quaternion: Quaternion


class SetPhysicsRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Changes what is given of a body's physics."""

    id: BodyId
    mobility: Mobility | msgspec.UnsetType = msgspec.UNSET
    gravity: bool | msgspec.UnsetType = msgspec.UNSET
    mass_kg: Annotated[float, msgspec.Meta(gt=0.0, le=1e6)] | msgspec.UnsetType = msgspec.UNSET


class SetMaterialRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Gives a body one surface instead of those that it has; none, where nothing is named."""

    id: BodyId
    name: Annotated[str, msgspec.Meta(max_length=200)] = ""
    color: str | None = None


class MoveJointRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Opens or shuts a joint, by hand where time passes."""

    id: BodyId
    axis: Literal["x", "y", "z", "twist", "swing2", "swing1"]
    value: _Meters
    done: bool = True
    """Whether the hand is opened then; False while a slider is dragged."""


class AttachRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Attaches a body to another one; to none, detaches it."""

    child: BodyId
    parent: BodyId | None = None


class DeleteRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Removes bodies."""

    ids: Annotated[tuple[BodyId, ...], msgspec.Meta(min_length=1, max_length=10_000)]


class FindClassesRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Looks for classes by a part of their names."""

    text: Annotated[str, msgspec.Meta(max_length=200)] = ""


class AddRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename={"cls": "class"}):
    """Drops in a new thing."""

    cls: Annotated[str, msgspec.Meta(min_length=1, max_length=2000)]
    on: BodyId | None = None
    """What it comes to stand on."""
    into: BodyId | None = None
    at: tuple[_Meters, _Meters, _Meters] | None = None
    """Where its lower side comes to be, if it is put on nothing; without it, where the visitor looks."""
    size: tuple[_Extent, _Extent, _Extent] | None = None


class EditHandler:
    """Does what pages ask to have changed; each edit is undone by anybody."""

    def __init__(
        self,
        simulation: Simulation,
        channel: RpcChannel,
        world_handler: WorldHandler,
        *,
        view_center: Callable[[ClientSession], Vector | None],
    ) -> None:
        """Offers what it does.

        Args:
            stage: whose world is changed.
            channel: to the pages.
            worlds: knows the joints.
            aim: tells what a visitor looks at.
        """
        self._simulation, self._world_handler, self._view_center = simulation, world_handler, view_center
        self._joint_drags: dict[BodyId, _JointDrag] = {}
        editing = simulation.editing
        channel.register("move", MoveRequest, self._move)
        channel.register("set_physics", SetPhysicsRequest, self._set_physics)
        channel.register("set_material", SetMaterialRequest, self._set_material)
        channel.register("move_joint", MoveJointRequest, self._move_joint)
        channel.register("attach", AttachRequest, self._attach)
        channel.register("delete", DeleteRequest, lambda _, wish: editing.delete(wish.ids))
        channel.register("undo", EmptyRequest, lambda _, wish: editing.undo())
        channel.register("redo", EmptyRequest, lambda _, wish: editing.redo())
        channel.register("find_classes", FindClassesRequest, self._find_classes, queue="look")
        channel.register("add", AddRequest, self._add)
        channel.on_disconnect(self._release)

    def publish(self, frame: StateSnapshot) -> None:
        """Opens the hands whose joints have arrived; called some times in a second."""
        for id, slide in list(self._joint_drags.items()):
            if slide.release_time is None:
                continue
            try:
                joint = self._world_handler.joint(slide.joint)
                poses = poses_in(frame, {joint.joint.parent, joint.joint.child})
                there = abs(joint.positions(poses)[slide.axis] - slide.value) < _JOINT_TOLERANCE
            except (BodyNotFoundError, KeyError):  # it was deleted meanwhile
                there = True
            if there or time.monotonic() > slide.release_time or not frame.playing:
                self._joint_drags.pop(id, None)
                self._simulation.release(id)

    # -- what a body is ------------------------------------------------------------------------------------------------

    def _move(self, _: ClientSession, request: MoveRequest) -> None:
        if not any(request.quaternion):
            raise InvalidArgumentError("quaternion", cause="four zeros are no rotation")
        self._simulation.editing.move(request.id, Pose(request.position, request.quaternion))

    def _set_physics(self, _: ClientSession, request: SetPhysicsRequest) -> None:
        changes = {
            name: value
            for name in ("mobility", "gravity", "mass_kg")
            if (value := getattr(request, name)) is not msgspec.UNSET
        }
        physics: BodyPhysics = msgspec.structs.replace(self._body(request.id).physics, **changes)
        self._simulation.editing.set_physics(
            request.id, physics, label=" and ".join(changes).replace("_kg", "") or "physics"
        )

    def _set_material(self, _: ClientSession, request: SetMaterialRequest) -> None:
        if not request.name and request.color is None:
            self._simulation.editing.set_materials(request.id, ())
            return
        known = next((each for each in self._body(request.id).materials if each.name == request.name), None)
        color = None if request.color is None else parse_color(request.color)
        material = Material(name=request.name or "paint", path=known.path if known else "", color=color)
        self._simulation.editing.set_materials(request.id, (material,))

    def _attach(self, _: ClientSession, request: AttachRequest) -> None:
        if request.parent is None:
            self._simulation.editing.detach(request.child)
        else:
            self._simulation.editing.attach(request.parent, request.child)

    def _body(self, id: BodyId) -> Body:
        return self._simulation.snapshot().body(id)

    # -- joints --------------------------------------------------------------------------------------------------------

    def _move_joint(self, session: ClientSession, request: MoveJointRequest) -> None:
        """Pulls while time passes, so that what is in the way stops it; puts it there while time stands still."""
        joint, frame = self._world_handler.joint(request.id), self._simulation.state
        if request.axis not in {axis.name for axis in joint.axes}:
            raise InvalidArgumentError(request.axis, cause=f"{request.id!r} does not move so")
        poses = poses_in(frame, {joint.joint.parent, joint.joint.child})
        going_on = self._joint_drags.get(joint.moving_body)
        before = going_on.start_pose if going_on is not None else pose_from_array(poses[joint.moving_body])
        ends = time.monotonic() + _SLIDER_SETTLE_S if request.done else None
        self._joint_drags[joint.moving_body] = _JointDrag(
            request.id, request.axis, request.value, session.key, before, ends
        )
        if not frame.playing:
            pose = joint.pose_for(request.axis, request.value, poses)
            self._simulation.editing.move(joint.moving_body, pose, continues_last=going_on is not None)
            return
        pull = joint.pull_target(request.axis, request.value, poses)
        self._simulation.pull(pull.id, point=pull.point, target=pull.target)
        if request.done:
            self._simulation.editing.record(MoveBody(joint.moving_body, before, f"place of {joint.moving_body}"))

    def _release(self, session: ClientSession) -> None:
        for id, slide in list(self._joint_drags.items()):
            if slide.session == session.key:
                self._joint_drags.pop(id, None)
                self._simulation.release(id)

    # -- new things ----------------------------------------------------------------------------------------------------

    def _find_classes(self, _: ClientSession, request: FindClassesRequest) -> list[dict[str, object]]:
        knowledge, text = self._simulation.knowledge, request.text.strip().casefold()
        with knowledge.lock:
            known = {iri: local_name(iri) for iri in knowledge.reasoner.declared_classes() if not iri.startswith("_:")}
            here = {body.cls for world in self._simulation.worlds for body in world.bodies}
            known |= {cls: local_name(cls) for cls in here}
            matching = [iri for iri, name in known.items() if text in name.casefold()]
            matching.sort(key=lambda iri: _search_rank(known[iri], text, is_here=iri in here))
            return [
                {"class": iri, "name": known[iri], "size": getattr(knowledge.shape_rule(iri), "size", None)}
                for iri in matching[:_MAX_CLASSES]
            ]

    def _add(self, session: ClientSession, request: AddRequest) -> BodyId:
        knowledge = self._simulation.knowledge
        with knowledge.lock:
            cls = knowledge.names.find(request.cls, EntityType.CLASS)
        body = self._make_body(cls, request.size)
        if request.on is not None or request.into is not None:
            put = self._simulation.place(body, on=request.on, into=request.into)
            self._simulation.editing.record_spawn([put.id])
            return put.id
        x, y, z = request.at or self._view_center(session) or (0.0, 0.0, 0.0)
        height = body.size[2] if body.size else 0.0
        placed = msgspec.structs.replace(body, pose=Pose((x, y, z + height / 2 + _CLEARANCE_M)))
        self._spawn(placed)
        return placed.id

    def _make_body(self, cls: Iri, size: Vector | None) -> Body:
        return make_body(self._simulation, cls, size=size)

    def _spawn(self, body: Body) -> None:
        first = next(iter(self._simulation.worlds), None)
        iri, name = (first.iri, first.name) if first else (Iri("http://mindstage.org/maps/new.owl#map"), "new")
        report = self._simulation.spawn(World(iri=iri, name=name, bodies=(body,)), persistent=False)
        for failure in report.failed_bodies:
            raise InvalidArgumentError(failure.id, cause=failure.reason)
        self._simulation.editing.record_spawn([body.id])


class _JointDrag(msgspec.Struct, frozen=True):
    """A joint that somebody moves by its slider."""

    joint: BodyId
    axis: str
    value: float
    session: str
    start_pose: Pose
    """Where the moving end was at first."""
    release_time: float | None
    """When the hand opens at the latest; None while the slider is held [s of the monotonic clock]."""


def _search_rank(name: str, text: str, *, is_here: bool) -> tuple[bool, bool, bool, int, str]:
    """What is meant most likely comes first: the very name, what begins so, what the place has already."""
    small = name.casefold()
    return small != text, not small.startswith(text), not is_here, len(name), name
