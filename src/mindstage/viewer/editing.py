"""Edits of the world that pages request; any client can undo them.

All edits go through `Simulation.edits`, which has one history for all clients.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection
from typing import Annotated, Literal

import msgspec
import numpy as np

from mindstage.access.limits import PASTE_CHARACTERS
from mindstage.access.policies import EDIT, READ, SPAWN
from mindstage.errors import BodyNotFoundError, InvalidArgumentError
from mindstage.ranges import Index, RotationQuaternion
from mindstage.rendering.camera import corners
from mindstage.scene import Body, BodyId, BodyPhysics, Material, Mobility, Pose, Vector
from mindstage.scene.colors import parse_color
from mindstage.scene.edits import SetPoses, counted_ids
from mindstage.scene.transforms import pose_array, pose_from_array
from mindstage.simulation import JointHandle, Simulation, StateSnapshot
from mindstage.simulation.body_groups import BodyGroup, Dependents, find_dependents, paste_group
from mindstage.simulation.joint_motion import JointClearance
from mindstage.simulation.state import poses_in
from mindstage.viewer.client_views import moved_with
from mindstage.viewer.server import ClientSession, EmptyRequest, RpcChannel
from mindstage.viewer.view_tools import PickResult

__all__ = ["EditHandler", "history_message"]


_Meters = Annotated[float, msgspec.Meta(ge=-10_000.0, le=10_000.0)]
_SLIDER_SETTLE_S = 2.0
"""Time for which a joint is pulled on after its slider was released [s]."""
_JOINT_TOLERANCE = 0.004
"""At which distance from its goal a joint has reached it [m or rad]."""
_CLEARANCE_M = 0.001


class MoveRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `move`."""

    id: BodyId
    position: tuple[_Meters, _Meters, _Meters]
    quaternion: RotationQuaternion


class SetPhysicsRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `set_physics`: changes the given properties."""

    id: BodyId
    mobility: Mobility | msgspec.UnsetType = msgspec.UNSET
    gravity: bool | msgspec.UnsetType = msgspec.UNSET
    mass_kg: Annotated[float, msgspec.Meta(gt=0.0, le=1e6)] | msgspec.UnsetType = msgspec.UNSET


class SetMaterialRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `set_material`: replaces the materials of a body by one; removes them without name and color."""

    id: BodyId
    name: Annotated[str, msgspec.Meta(max_length=200)] = ""
    color: str | None = None


class RenameRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `rename`: the new label of a body; an empty one removes it."""

    id: BodyId
    label: Annotated[str, msgspec.Meta(max_length=200)]


class MoveJointRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `move_joint`: the target position of an axis."""

    id: BodyId
    axis: Literal["x", "y", "z", "twist", "swing2", "swing1"]
    value: _Meters
    done: bool = True
    """False while the slider is being dragged."""


class AttachRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `attach`: attaches a body to another one; without a parent, detaches it."""

    child: BodyId
    parent: BodyId | None = None


_Ids = Annotated[tuple[BodyId, ...], msgspec.Meta(min_length=1, max_length=10_000)]


class BodiesRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `dependents`, `copy` and `duplicate`."""

    ids: _Ids


class DeleteRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `delete`; see `dependents`."""

    ids: _Ids
    parts: bool = False
    """Whether to delete what is attached or joined to them, too."""
    contents: bool = False
    """Whether to delete the loose bodies on or in them, too."""


class PasteRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `paste`: the text that `copy` returned."""

    text: Annotated[str, msgspec.Meta(max_length=PASTE_CHARACTERS.count)]


class GoToRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `go_to_step`: how many steps of the history are done then."""

    position: Annotated[int, msgspec.Meta(ge=0, le=1000)]
    version: Index
    """That of the topic `history` that the page has shown."""


def history_message(simulation: Simulation) -> dict[str, object]:
    """The history of edits for the topic `history`: the steps that are done, oldest first, and those to redo."""
    history = simulation.edits.history
    return {
        "undo": next(iter(history.undo), None),
        "redo": next(iter(history.redo), None),
        "done": history.undo[::-1],
        "undone": history.redo,
        "version": simulation.edits.version,
    }


class MoveJointReply(msgspec.Struct, frozen=True):
    """The result of `move_joint`."""

    value: float
    """The position that was set, or that the joint is pulled to [m or rad]."""
    blocked_by: BodyId | None = None
    """The body that the moved one would be inside of at the wanted position."""


def _put_down(body: Body, below: Callable[[Vector], PickResult | None]) -> Pose:
    """The pose of a body that is moved vertically until it is on what is below its center."""
    ends = corners(pose_array([body.pose]), np.array([body.size or (0.0, 0.0, 0.0)]))
    x, y, _ = body.pose.position
    lowest = float(ends[:, 2].min())
    found = below((x, y, lowest))
    if found is None:
        return body.pose
    if found.id == body.id:  # its own lower side
        found = below((x, y, lowest - _CLEARANCE_M))
    if found is None or found.id == body.id:
        return body.pose
    height = body.pose.position[2] - lowest + found.point[2] + _CLEARANCE_M
    return msgspec.structs.replace(body.pose, position=(x, y, height))


class EditHandler:
    """Handles edits of the world; any client can undo them."""

    def __init__(
        self, simulation: Simulation, channel: RpcChannel, *, find_joint: Callable[[BodyId], JointHandle]
    ) -> None:
        """Registers the requests.

        Args:
            channel: the channel of the pages.
            find_joint: returns the handle of a joint.
        """
        self._simulation, self._channel, self._find_joint = simulation, channel, find_joint
        self._joint_drags: dict[BodyId, _JointDrag] = {}
        edits = simulation.edits

        def undo(session: ClientSession, _: EmptyRequest) -> str:
            label = edits.undo()
            channel.tell_others(session, f"undid: {label}")
            return label

        def redo(session: ClientSession, _: EmptyRequest) -> str:
            label = edits.redo()
            channel.tell_others(session, f"did again: {label}")
            return label

        channel.register("move", MoveRequest, self._move, EDIT)
        channel.register("set_physics", SetPhysicsRequest, self._set_physics, EDIT)
        channel.register("set_material", SetMaterialRequest, self._set_material, EDIT)
        channel.register("rename", RenameRequest, lambda _, request: edits.set_label(request.id, request.label), EDIT)
        channel.register("move_joint", MoveJointRequest, self._move_joint, EDIT)
        channel.register("attach", AttachRequest, self._attach, EDIT)
        channel.register("delete", DeleteRequest, self._delete, EDIT)
        channel.register("dependents", BodiesRequest, self._dependents, READ, queue="details")
        channel.register("copy", BodiesRequest, lambda _, request: self._group(request.ids).text, READ)
        channel.register("duplicate", BodiesRequest, self._duplicate, EDIT)
        channel.register("paste", PasteRequest, self._paste, SPAWN)
        channel.register("go_to_step", GoToRequest, self._go_to, EDIT)
        channel.register("undo", EmptyRequest, undo, EDIT)
        channel.register("redo", EmptyRequest, redo, EDIT)
        channel.on_disconnect(self._release)

    def publish(self, snapshot: StateSnapshot) -> None:
        """Releases joints that have reached the positions of their sliders."""
        for id, drag in list(self._joint_drags.items()):
            if drag.release_time is None:
                continue
            try:
                joint = self._find_joint(drag.joint)
                poses = poses_in(snapshot, {joint.joint.parent, joint.joint.child})
                reached = abs(joint.positions(poses)[drag.axis] - drag.value) < _JOINT_TOLERANCE
            except (BodyNotFoundError, KeyError):  # deleted in the meantime
                reached = True
            if reached or time.monotonic() > drag.release_time or not snapshot.playing:
                self._joint_drags.pop(id, None)
                self._simulation.release(id)

    # -- bodies --------------------------------------------------------------------------------------------------------

    def _move(self, _: ClientSession, request: MoveRequest) -> None:
        if not any(request.quaternion):
            raise InvalidArgumentError("quaternion", cause="its norm is 0")
        self._simulation.edits.move(request.id, Pose(request.position, request.quaternion))

    def move_group(
        self,
        id: BodyId,
        pose: Pose,
        selection: Collection[BodyId],
        *,
        below: Callable[[Vector], PickResult | None] | None,
    ) -> None:
        """Moves a body, and the other selected ones rigidly with it, as one edit.

        Args:
            pose: its new pose.
            selection: the selected bodies; those that are parts of others move with those.
            below: finds what is below a point, to put the body down on it; None keeps the pose.
        """
        world = self._simulation.snapshot()
        bodies = {body.id: body for body in world.bodies}
        parts = {id for each in selection if each in bodies for id in find_dependents(world, [each]).parts}
        group = {each: bodies[each].pose for each in selection if each in bodies and each not in parts and each != id}
        if below is not None:
            pose = _put_down(msgspec.structs.replace(bodies[id], pose=pose), below)
        moved = moved_with(world.body(id).pose, pose, group)
        if not moved:
            self._simulation.edits.move(id, pose)
        else:
            self._simulation.edits.move_all({id: pose, **moved})

    def _delete(self, session: ClientSession, request: DeleteRequest) -> tuple[BodyId, ...]:
        deleted = self._simulation.edits.delete(request.ids, parts=request.parts, contents=request.contents)
        self._channel.tell_others(session, f"deleted {counted_ids(deleted)}")
        return deleted

    def _dependents(self, _: ClientSession, request: BodiesRequest) -> Dependents:
        return find_dependents(self._simulation.snapshot(), request.ids)

    def _group(self, ids: tuple[BodyId, ...]) -> BodyGroup:
        return BodyGroup.from_world(self._simulation.snapshot(), ids)

    def _duplicate(self, _: ClientSession, request: BodiesRequest) -> tuple[BodyId, ...]:
        return self._spawn_group(self._group(request.ids), verb="duplicated")

    def _paste(self, _: ClientSession, request: PasteRequest) -> tuple[BodyId, ...]:
        return self._spawn_group(BodyGroup.from_text(request.text), verb="pasted")

    def _spawn_group(self, group: BodyGroup, *, verb: str) -> tuple[BodyId, ...]:
        return paste_group(self._simulation, group, verb=verb)

    def _go_to(self, session: ClientSession, request: GoToRequest) -> None:
        self._simulation.edits.go_to(request.position, version=request.version)
        self._channel.tell_others(session, f"went to step {request.position} of the history")

    def _set_physics(self, _: ClientSession, request: SetPhysicsRequest) -> None:
        changes = {
            name: value
            for name in ("mobility", "gravity", "mass_kg")
            if (value := getattr(request, name)) is not msgspec.UNSET
        }
        physics: BodyPhysics = msgspec.structs.replace(self._body(request.id).physics, **changes)
        self._simulation.edits.set_physics(
            request.id, physics, label=" and ".join(changes).replace("_kg", "") or "physics"
        )

    def _set_material(self, _: ClientSession, request: SetMaterialRequest) -> None:
        if not request.name and request.color is None:
            self._simulation.edits.set_materials(request.id, ())
            return
        current = next((each for each in self._body(request.id).materials if each.name == request.name), None)
        color = None if request.color is None else parse_color(request.color)
        material = Material(name=request.name or "paint", path=current.path if current else "", color=color)
        self._simulation.edits.set_materials(request.id, (material,))

    def _attach(self, _: ClientSession, request: AttachRequest) -> None:
        if request.parent is None:
            self._simulation.edits.detach(request.child)
        else:
            self._simulation.edits.attach(request.parent, request.child)

    def _body(self, id: BodyId) -> Body:
        return self._simulation.snapshot().body(id)

    # -- joints --------------------------------------------------------------------------------------------------------

    def _move_joint(self, session: ClientSession, request: MoveJointRequest) -> MoveJointReply:
        """Pulls the moving body while the simulation runs, so that obstacles stop it; moves it while paused.

        A paused body is moved as far as it does not enter another one that cannot give way.
        """
        joint, snapshot = self._find_joint(request.id), self._simulation.state
        if request.axis not in {axis.name for axis in joint.axes}:
            raise InvalidArgumentError(request.axis, cause=f"{request.id!r} has no such axis")
        poses = poses_in(snapshot, {joint.joint.parent, joint.joint.child})
        previous = self._joint_drags.get(joint.moving_body)
        start_pose = previous.start_pose if previous is not None else pose_from_array(poses[joint.moving_body])
        release_time = time.monotonic() + _SLIDER_SETTLE_S if request.done else None
        self._joint_drags[joint.moving_body] = _JointDrag(
            request.id, request.axis, request.value, session.key, start_pose, release_time
        )
        if not snapshot.playing:
            value, blocked_by = JointClearance(self._simulation, joint).limit(request.axis, request.value, poses)
            pose = joint.pose_for(request.axis, value, poses)
            self._simulation.edits.move(joint.moving_body, pose, continues_last=previous is not None)
            return MoveJointReply(value, blocked_by)
        pull = joint.pull_target(request.axis, request.value, poses)
        self._simulation.pull(pull.id, point=pull.point, target=pull.target)
        if request.done:
            self._simulation.edits.record(SetPoses({joint.moving_body: start_pose}, {}))
        return MoveJointReply(request.value)

    def _release(self, session: ClientSession) -> None:
        for id, drag in list(self._joint_drags.items()):
            if drag.session == session.key:
                self._joint_drags.pop(id, None)
                self._simulation.release(id)


class _JointDrag(msgspec.Struct, frozen=True):
    """A joint that a client moves by its slider."""

    joint: BodyId
    axis: str
    value: float
    session: str
    start_pose: Pose
    """Pose of the moving body before the drag."""
    release_time: float | None
    """When the joint is released at the latest, by the monotonic clock [s]; None while the slider is held."""
