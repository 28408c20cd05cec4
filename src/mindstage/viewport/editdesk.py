"""Edit desk: what visitors change in the world, through the stage's editing, so that it can be undone."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Annotated, Literal

import msgspec

from mindstage.errors import ArgumentRefused, BodyUnknown
from mindstage.knowledge.names import local_name
from mindstage.knowledge.reasoning import NameKind
from mindstage.stage import Frame, Stage
from mindstage.stage.edits import Move
from mindstage.stage.joints import poses_in
from mindstage.stage.putting import thing_of
from mindstage.viewport.channel import Channel
from mindstage.viewport.visitor import Visitor
from mindstage.viewport.worlddesk import Nothing, WorldDesk
from mindstage.world import Body, BodyId, Iri, Material, Mobility, Physics, Pose, Quaternion, Vector, World
from mindstage.world.colours import colour_from
from mindstage.world.geometry import pose_from

__all__ = ["EditDesk"]

_Metres = Annotated[float, msgspec.Meta(ge=-10_000.0, le=10_000.0)]
_Extent = Annotated[float, msgspec.Meta(ge=0.001, le=1000.0)]
_SETTLES_S = 2.0
"""After a slider was let go the hand holds on until the joint is there, or so long."""
_THERE = 0.004
_MOST_FOUND = 60
_CLEARANCE_M = 0.002


class MoveTo(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Puts a body somewhere else."""

    id: BodyId
    position: tuple[_Metres, _Metres, _Metres]
    quaternion: Quaternion


class ChangePhysics(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Changes what is given of a body's physics."""

    id: BodyId
    mobility: Mobility | msgspec.UnsetType = msgspec.UNSET
    gravity: bool | msgspec.UnsetType = msgspec.UNSET
    mass_kg: Annotated[float, msgspec.Meta(gt=0.0, le=1e6)] | msgspec.UnsetType = msgspec.UNSET


class ChangeMaterial(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Gives a body one surface instead of those that it has; none, where nothing is named."""

    id: BodyId
    name: Annotated[str, msgspec.Meta(max_length=200)] = ""
    color: str | None = None


class MoveJoint(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Opens or shuts a joint, by hand where time passes."""

    id: BodyId
    axis: Literal["x", "y", "z", "twist", "swing2", "swing1"]
    value: _Metres
    done: bool = True
    """Whether the hand is opened then; False while a slider is dragged."""


class Hang(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Attaches a body to another one; to none, detaches it."""

    child: BodyId
    parent: BodyId | None = None


class Delete(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Removes bodies."""

    ids: Annotated[tuple[BodyId, ...], msgspec.Meta(min_length=1, max_length=10_000)]


class FindClasses(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Looks for classes by a part of their names."""

    text: Annotated[str, msgspec.Meta(max_length=200)] = ""


class Add(msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename={"cls": "class"}):
    """Drops in a new thing."""

    cls: Annotated[str, msgspec.Meta(min_length=1, max_length=2000)]
    on: BodyId | None = None
    """What it comes to stand on."""
    into: BodyId | None = None
    at: tuple[_Metres, _Metres, _Metres] | None = None
    """Where its lower side comes to be, if it is put on nothing; without it, where the visitor looks."""
    size: tuple[_Extent, _Extent, _Extent] | None = None


class EditDesk:
    """Does what pages ask to have changed; each edit is undone by anybody."""

    def __init__(
        self, stage: Stage, channel: Channel, worlds: WorldDesk, *, aim: Callable[[Visitor], Vector | None]
    ) -> None:
        """Offers what it does.

        Args:
            stage: whose world is changed.
            channel: to the pages.
            worlds: knows the joints.
            aim: tells what a visitor looks at.
        """
        self._stage, self._worlds, self._aim = stage, worlds, aim
        self._slides: dict[BodyId, _Slide] = {}
        editing = stage.editing
        channel.offer("move", MoveTo, self._move)
        channel.offer("set_physics", ChangePhysics, self._physics)
        channel.offer("set_material", ChangeMaterial, self._material)
        channel.offer("move_joint", MoveJoint, self._joint)
        channel.offer("attach", Hang, self._hang)
        channel.offer("delete", Delete, lambda _, wish: editing.delete(wish.ids))
        channel.offer("undo", Nothing, lambda _, wish: editing.undo())
        channel.offer("redo", Nothing, lambda _, wish: editing.redo())
        channel.offer("find_classes", FindClasses, self._classes, lane="look")
        channel.offer("add", Add, self._add)
        channel.on_leave(self._let_go)

    def tell(self, frame: Frame) -> None:
        """Opens the hands whose joints have arrived; called some times in a second."""
        for id, slide in list(self._slides.items()):
            if slide.ends is None:
                continue
            try:
                joint = self._worlds.joint(slide.joint)
                poses = poses_in(frame, {joint.constraint.parent, joint.constraint.child})
                there = abs(joint.positions(poses)[slide.axis] - slide.value) < _THERE
            except (BodyUnknown, KeyError):  # it was deleted meanwhile
                there = True
            if there or time.monotonic() > slide.ends or not frame.playing:
                self._slides.pop(id, None)
                self._stage.release(id)

    # -- what a body is ------------------------------------------------------------------------------------------------

    def _move(self, _: Visitor, wish: MoveTo) -> None:
        if not any(wish.quaternion):
            raise ArgumentRefused("quaternion", cause="four zeros are no rotation")
        self._stage.editing.move(wish.id, Pose(wish.position, wish.quaternion))

    def _physics(self, _: Visitor, wish: ChangePhysics) -> None:
        changes = {
            name: value
            for name in ("mobility", "gravity", "mass_kg")
            if (value := getattr(wish, name)) is not msgspec.UNSET
        }
        physics: Physics = msgspec.structs.replace(self._body(wish.id).physics, **changes)
        self._stage.editing.set_physics(wish.id, physics, what=" and ".join(changes).replace("_kg", "") or "physics")

    def _material(self, _: Visitor, wish: ChangeMaterial) -> None:
        if not wish.name and wish.color is None:
            self._stage.editing.set_materials(wish.id, ())
            return
        known = next((each for each in self._body(wish.id).materials if each.name == wish.name), None)
        colour = None if wish.color is None else colour_from(wish.color)
        material = Material(name=wish.name or "paint", path=known.path if known else "", colour=colour)
        self._stage.editing.set_materials(wish.id, (material,))

    def _hang(self, _: Visitor, wish: Hang) -> None:
        if wish.parent is None:
            self._stage.editing.detach(wish.child)
        else:
            self._stage.editing.attach(wish.parent, wish.child)

    def _body(self, id: BodyId) -> Body:
        return self._stage.log().body(id)

    # -- joints --------------------------------------------------------------------------------------------------------

    def _joint(self, visitor: Visitor, wish: MoveJoint) -> None:
        """Pulls while time passes, so that what is in the way stops it; puts it there while time stands still."""
        joint, frame = self._worlds.joint(wish.id), self._stage.frame
        if wish.axis not in {axis.name for axis in joint.axes}:
            raise ArgumentRefused(wish.axis, cause=f"{wish.id!r} does not move so")
        poses = poses_in(frame, {joint.constraint.parent, joint.constraint.child})
        going_on = self._slides.get(joint.moving)
        before = going_on.before if going_on is not None else pose_from(poses[joint.moving])
        ends = time.monotonic() + _SETTLES_S if wish.done else None
        self._slides[joint.moving] = _Slide(wish.id, wish.axis, wish.value, visitor.key, before, ends)
        if not frame.playing:
            pose = joint.pose_at(wish.axis, wish.value, poses)
            self._stage.editing.move(joint.moving, pose, going_on=going_on is not None)
            return
        pull = joint.pull_to(wish.axis, wish.value, poses)
        self._stage.grip(pull.id, point=pull.point, target=pull.target)
        if wish.done:
            self._stage.editing.record(Move(joint.moving, before, f"place of {joint.moving}"))

    def _let_go(self, visitor: Visitor) -> None:
        for id, slide in list(self._slides.items()):
            if slide.visitor == visitor.key:
                self._slides.pop(id, None)
                self._stage.release(id)

    # -- new things ----------------------------------------------------------------------------------------------------

    def _classes(self, _: Visitor, wish: FindClasses) -> list[dict[str, object]]:
        knowledge, text = self._stage.knowledge, wish.text.strip().casefold()
        with knowledge.turn:
            known = {iri: local_name(iri) for iri in knowledge.index.declared_classes() if not iri.startswith("_:")}
            here = {body.cls for world in self._stage.worlds for body in world.bodies}
            known |= {cls: local_name(cls) for cls in here}
            matching = [iri for iri, name in known.items() if text in name.casefold()]
            matching.sort(key=lambda iri: _rank(known[iri], text, is_here=iri in here))
            return [
                {"class": iri, "name": known[iri], "size": getattr(knowledge.shape_rule(iri), "size", None)}
                for iri in matching[:_MOST_FOUND]
            ]

    def _add(self, visitor: Visitor, wish: Add) -> BodyId:
        knowledge = self._stage.knowledge
        with knowledge.turn:
            cls = knowledge.names.find(wish.cls, NameKind.CLASS)
        body = self._thing(cls, wish.size)
        if wish.on is not None or wish.into is not None:
            put = self._stage.put(body, on=wish.on, into=wish.into)
            self._stage.editing.added([put.id])
            return put.id
        x, y, z = wish.at or self._aim(visitor) or (0.0, 0.0, 0.0)
        height = body.size[2] if body.size else 0.0
        placed = msgspec.structs.replace(body, pose=Pose((x, y, z + height / 2 + _CLEARANCE_M)))
        self._spawn(placed)
        return placed.id

    def _thing(self, cls: Iri, size: Vector | None) -> Body:
        return thing_of(self._stage, cls, size=size)

    def _spawn(self, body: Body) -> None:
        first = next(iter(self._stage.worlds), None)
        iri, name = (first.iri, first.name) if first else (Iri("http://mindstage.org/maps/new.owl#map"), "new")
        report = self._stage.spawn(World(iri=iri, name=name, bodies=(body,)), lasting=False)
        for failure in report.failed_bodies:
            raise ArgumentRefused(failure.id, cause=failure.reason)
        self._stage.editing.added([body.id])


class _Slide(msgspec.Struct, frozen=True):
    """A joint that somebody moves by its slider."""

    joint: BodyId
    axis: str
    value: float
    visitor: str
    before: Pose
    """Where the moving end was at first."""
    ends: float | None
    """When the hand opens at the latest; None while the slider is held [s of the monotonic clock]."""


def _rank(name: str, text: str, *, is_here: bool) -> tuple[bool, bool, bool, int, str]:
    """What is meant most likely comes first: the very name, what begins so, what the place has already."""
    small = name.casefold()
    return small != text, not small.startswith(text), not is_here, len(name), name
