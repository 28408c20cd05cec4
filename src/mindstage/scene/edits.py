"""Edits: the changes of a world that physics does not cause, as values.

An edit is made once, and the same value is applied by an engine, undone, recorded in an episode, sent by a port, and
made in the original of a copy. As JSON it has the name of its class, in lower case, in the field `do`, and of geometry
the digests of bodies only.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from typing import TYPE_CHECKING, Any, Union

import msgspec
from msgspec.structs import force_setattr, replace

from mindstage.errors import InvalidArgumentError
from mindstage.scene.geometry import NO_GEOMETRY, BodyGeometry, GeometryMap
from mindstage.scene.world_model import Body, BodyId, BodyPhysics, Material, Pose, World, as_pose

__all__ = [
    "Attach",
    "BodyEdit",
    "Delete",
    "Detach",
    "Edit",
    "EditGroup",
    "GeometryByDigest",
    "GeometryEdit",
    "SetLabel",
    "SetMaterials",
    "SetPhysics",
    "SetPoses",
    "Spawn",
    "counted_ids",
    "edit_from_json",
    "edit_to_json",
    "geometry_digests",
]


def _tag(name: str) -> str:
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()


class Edit(
    msgspec.Struct, frozen=True, kw_only=True, tag_field="do", tag=_tag, forbid_unknown_fields=True, omit_defaults=True
):
    """The base class of all edits; a subclass that is imported can be read from JSON."""

    title: str = ""
    """What people read in the history; by default the kind and the bodies."""

    @property
    def ids(self) -> tuple[BodyId, ...]:
        """The bodies that it is about."""
        return ()

    @property
    def kind(self) -> str:
        """The name of its class in words: "set poses"."""
        return _tag(type(self).__name__).replace("_", " ")

    @property
    def label(self) -> str:
        """The title, or what is done with which bodies: "delete Mug"."""
        return self.title or f"{self.kind} {counted_ids(self.ids)}".strip()

    def parts(self) -> tuple[Edit, ...]:
        """The edits that it consists of, in their order; empty for one that engines make themselves."""
        return ()

    def geometries(self) -> tuple[BodyGeometry, ...]:
        """The geometries that have to be stored beside its JSON."""
        return tuple(dict.fromkeys(each for part in self.parts() for each in part.geometries()))

    def inverse_of_parts(self, inverses: tuple[Edit, ...]) -> Edit:
        """The inverse of an edit with parts.

        Args:
            inverses: those of its parts, in the order in which they are applied: the last part first.
        """
        return EditGroup(inverses, title=self.label)


def counted_ids(ids: tuple[BodyId, ...]) -> str:
    """The only one of some bodies, or how many there are."""
    return ids[0] if len(ids) == 1 else f"{len(ids)} bodies" if ids else ""


class GeometryByDigest(Mapping[BodyId, BodyGeometry]):
    """The geometry of bodies in an edit; as JSON, the digest of each, since meshes are stored once elsewhere."""

    __slots__ = ("_bodies",)

    def __init__(self, bodies: GeometryMap = NO_GEOMETRY) -> None:
        self._bodies = dict(bodies)

    def __getitem__(self, id: BodyId) -> BodyGeometry:
        return self._bodies[id]

    def __iter__(self) -> Iterator[BodyId]:
        return iter(self._bodies)

    def __len__(self) -> int:
        return len(self._bodies)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, GeometryByDigest) and geometry_digests(self) == geometry_digests(other)

    def __hash__(self) -> int:
        return hash(tuple(self._bodies))

    def to_edit_json(self) -> dict[BodyId, str]:
        """The digests by body; `edit_to_json` calls it for any type that has it, and reading `from_edit_json`."""
        return geometry_digests(self)

    @classmethod
    def from_edit_json(cls, value: Mapping[BodyId, str], stored: Mapping[str, BodyGeometry]) -> GeometryByDigest:
        """The geometry of digests.

        Raises:
            ValueError: one is not stored.
        """
        if missing := sorted(set(value.values()) - stored.keys()):
            raise ValueError(f"the geometry {missing[0]} is not stored here")
        return cls({id: stored[key] for id, key in value.items()})


def geometry_digests(geometry: GeometryMap) -> dict[BodyId, str]:
    """The digest of the geometry of each body."""
    return {id: each.key for id, each in geometry.items()}


if TYPE_CHECKING:
    _Geometry = GeometryMap
    _Edits = tuple[Edit, ...]
else:  # the types for decoding

    class _Edits(tuple):
        pass

    _Geometry = GeometryByDigest


class GeometryEdit(Edit, frozen=True, kw_only=True):
    """The base class of edits that add bodies."""

    geometry: _Geometry = msgspec.field(default_factory=GeometryByDigest)
    """Visual meshes and collision shapes of the bodies; one without an entry is its primitive shape, scaled to its
    size. Geometry is not part of a snapshot."""

    def __post_init__(self) -> None:
        if not isinstance(self.geometry, GeometryByDigest):
            force_setattr(self, "geometry", GeometryByDigest(self.geometry))

    def geometries(self) -> tuple[BodyGeometry, ...]:
        """See `Edit`."""
        return tuple(dict.fromkeys(self.geometry.values()))


class EditGroup(Edit, frozen=True):
    """Several edits as one, in this order: all are made, or none."""

    edits: _Edits

    @property
    def ids(self) -> tuple[BodyId, ...]:
        """See `Edit`."""
        return tuple(dict.fromkeys(id for each in self.edits for id in each.ids))

    def parts(self) -> tuple[Edit, ...]:
        """See `Edit`."""
        return self.edits


class Spawn(GeometryEdit, frozen=True):
    """Adds a world to the running one: bodies and lights first, then joints, then attachments.

    What cannot be spawned (an id in use, a joint without its bodies, a pose that is not finite) is in the report with
    the reason; the rest is spawned. The fields below add to the statements of the world, which a snapshot has alone.
    """

    world: World
    immovable: frozenset[BodyId] = frozenset()
    """Dynamic bodies that are simulated as static ones, such as walls, until their physics is set."""
    uncertain_poses: frozenset[BodyId] = frozenset()
    """Bodies whose poses are doubtful by a finding about the map: the height of the ground is not theirs."""
    ground: bool = False
    """Whether a ground is assumed where there is nothing below loose bodies."""
    settle: bool = True
    """Whether loose bodies are moved out of what they overlap; otherwise such pairs do not collide."""
    excluded_pairs: frozenset[tuple[BodyId, BodyId]] = frozenset()
    """Pairs of bodies that never collide, in any order, at least one of them new: parts of a robot whose collision
    shapes always overlap or never meet."""
    whole: bool = False
    """Whether nothing is spawned if a part of it cannot be: then `SpawnRefusedError` is raised."""
    persistent: bool = True
    """Whether `Simulation.reset` restores it; otherwise that removes it."""

    @property
    def ids(self) -> tuple[BodyId, ...]:
        """See `Edit`."""
        return tuple(body.id for body in self.world.bodies)

    @property
    def label(self) -> str:
        """See `Edit`."""
        return self.title or f"{counted_ids(self.ids)} added"


class Delete(Edit, frozen=True):
    """Removes bodies with their joints and attachments; bodies attached to them stay where they are.

    Raises `BodyNotFoundError` for the first unknown id; nothing is deleted then.
    """

    bodies: tuple[BodyId, ...]

    @property
    def ids(self) -> tuple[BodyId, ...]:
        """See `Edit`."""
        return self.bodies

    @property
    def label(self) -> str:
        """See `Edit`."""
        return self.title or f"{counted_ids(self.ids)} deleted"


class SetPoses(Edit, frozen=True):
    """Moves bodies, at rest, in this order; what is attached to one of them moves along.

    An engine may give a kinematic body, whose poses are set one after the other, the velocity of that motion.

    Raises `BodyNotFoundError` for an unknown body, and `PoseUnreachableError` if a joint does not allow a pose, or it
    is not finite; nothing is moved then.
    """

    poses: Mapping[BodyId, Pose]
    """In the world frame."""
    holders: Mapping[BodyId, tuple[BodyId, Pose]] | None = None
    """For poses that are restored: what bodies were attached to, or on joints of, when they had them, and the pose
    of that: each is restored relative to it, also where physics had pushed it beyond a limit of its joint. None
    for a new motion, which is neither."""

    def __post_init__(self) -> None:
        if not all(isinstance(each, Pose) for each in self.poses.values()):
            force_setattr(self, "poses", {id: as_pose(each) for id, each in self.poses.items()})

    @property
    def ids(self) -> tuple[BodyId, ...]:
        """See `Edit`."""
        return tuple(self.poses)

    @property
    def label(self) -> str:
        """See `Edit`."""
        return self.title or f"pose of {counted_ids(self.ids)}"


class Attach(Edit, frozen=True):
    """Attaches a child rigidly to a parent; it is detached from another one first.

    Raises `BodyNotFoundError` if either is unknown, and `AttachmentError` if the attachment would close a cycle.
    """

    parent: BodyId
    child: BodyId
    pose: Pose | None = None
    """In the frame of the parent: the child is moved there first. None if both keep their poses."""

    def __post_init__(self) -> None:
        if self.pose is not None:
            force_setattr(self, "pose", as_pose(self.pose))

    @property
    def ids(self) -> tuple[BodyId, ...]:
        """See `Edit`."""
        return self.child, self.parent

    @property
    def label(self) -> str:
        """See `Edit`."""
        return self.title or f"{self.child} attached to {self.parent}"


class Detach(Edit, frozen=True):
    """Detaches a child, which keeps its pose and velocity; does nothing if it is not attached.

    Raises `BodyNotFoundError` if it is unknown.
    """

    child: BodyId

    @property
    def ids(self) -> tuple[BodyId, ...]:
        """See `Edit`."""
        return (self.child,)

    @property
    def label(self) -> str:
        """See `Edit`."""
        return self.title or f"{self.child} detached"


class BodyEdit(Edit, frozen=True):
    """Changes what the description of one body says; raises `BodyNotFoundError` if it is unknown.

    A subclass needs nothing else in any engine, unless the change is about what is simulated.
    """

    id: BodyId

    @property
    def ids(self) -> tuple[BodyId, ...]:
        """See `Edit`."""
        return (self.id,)

    @property
    def label(self) -> str:
        """See `Edit`."""
        return self.title or f"{self.kind.removeprefix('set ')} of {self.id}"

    def changed(self, body: Body) -> Body:
        """The body after the edit."""
        raise NotImplementedError

    def inverse(self, body: Body) -> BodyEdit:
        """The edit that restores the body as it is before."""
        raise NotImplementedError


class SetPhysics(BodyEdit, frozen=True):
    """Replaces mobility, gravity, mass [kg] and overlap events of a body."""

    physics: BodyPhysics
    immovable: bool = False
    """Whether it is simulated as static, although its mobility is dynamic; see `Spawn.immovable`."""

    def changed(self, body: Body) -> Body:
        """See `BodyEdit`."""
        return replace(body, physics=self.physics)

    def inverse(self, body: Body) -> BodyEdit:
        """See `BodyEdit`."""
        return replace(self, physics=body.physics, immovable=False)


class SetMaterials(BodyEdit, frozen=True):
    """Replaces the surface materials of a body."""

    materials: tuple[Material, ...]

    def changed(self, body: Body) -> Body:
        """See `BodyEdit`."""
        return replace(body, materials=self.materials)

    def inverse(self, body: Body) -> BodyEdit:
        """See `BodyEdit`."""
        return replace(self, materials=body.materials)


class SetLabel(BodyEdit, frozen=True):
    """Sets the label of a body, its name for people; an empty one removes it. The id stays."""

    text: str

    def changed(self, body: Body) -> Body:
        """See `BodyEdit`."""
        return replace(body, label=self.text or None)

    def inverse(self, body: Body) -> BodyEdit:
        """See `BodyEdit`."""
        return replace(self, text=body.label or "")


# -- JSON --------------------------------------------------------------------------------------------------------------


def edit_to_json(edit: Edit) -> bytes:
    """An edit as JSON.

    Raises:
        InvalidArgumentError: it has a value that JSON cannot represent.
    """

    def encode(value: object) -> object:
        if hasattr(value, "to_edit_json"):
            return value.to_edit_json()
        if hasattr(value, "tolist"):
            return value.tolist()  # of NumPy
        raise TypeError(f"{type(value).__name__} in an edit")

    try:
        return msgspec.json.encode(edit, enc_hook=encode, order="deterministic")
    except (TypeError, UnicodeError, RecursionError) as error:
        raise InvalidArgumentError(edit.kind, cause=str(error)) from error


def edit_from_json(text: bytes | str | Mapping[str, Any], *, geometry: Iterable[BodyGeometry] = ()) -> Edit:
    """The edit of a JSON object, as text or as plain data.

    Args:
        text: the object.
        geometry: the geometries that are stored, which an edit names by their digests.

    Raises:
        InvalidArgumentError: it is not an edit that is known here, or a geometry is missing.
    """
    stored: dict[str, BodyGeometry] = {}

    def decode(type: Any, value: Any) -> Any:
        if type is _Edits:
            return _Edits(msgspec.convert(each, _all_edits(), dec_hook=decode) for each in value)
        if value and not stored:
            stored.update((each.key, each) for each in geometry)
        return type.from_edit_json(value, stored)

    try:
        if isinstance(text, Mapping):
            return msgspec.convert(text, _all_edits(), dec_hook=decode)  # type: ignore[no-any-return]
        return msgspec.json.decode(text, type=_all_edits(), dec_hook=decode)  # type: ignore[no-any-return]
    except (msgspec.MsgspecError, UnicodeError, RecursionError) as error:
        raise InvalidArgumentError("the edit", cause=str(error)) from error


def _all_edits() -> Any:
    return _union(frozenset(_subclasses(Edit)) - {BodyEdit, GeometryEdit})


@cache
def _union(classes: frozenset[type[Edit]]) -> Any:
    return Union[tuple(classes)]  # noqa: UP007 - of classes that are known at run time


def _subclasses(cls: type[Edit]) -> Iterator[type[Edit]]:
    for each in cls.__subclasses__():
        yield each
        yield from _subclasses(each)
