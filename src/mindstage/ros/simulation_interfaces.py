r"""Entities and spawning, as in simulation_interfaces.

An entity is a body, and its name is the id of the body. Filters combine name, category, tags and bounds; all must
match. Names are matched by RE2, in time linear in the length of the name, with its POSIX syntax: `.`, `[a-z[:digit:]]`,
`^`, `$`, `*`, `+`, `?`, `{2,5}`, `|`, groups, and `\` before a literal. It differs from POSIX extended expressions as
RE2 documents: a backslash escapes in brackets too, an invalid interval (`a{x`) is literal, intervals are at most 1000,
and character classes are ASCII.

A resource is a body or a map in the knowledge base, a file in the folder that the server has opened (no path leads out
of it), or a text. New entities are copies of it with another name and pose; in a namespace the name of the entity
and of its parts begins with it. Two points in which the texts of the package leave a choice:

- A resource that does not exist gives `RESULT_NOT_FOUND`: `NO_RESOURCE` is for a request with neither a URI nor a text.
- An empty name is replaced by the name in the resource, which only a URDF has; then `NAME_INVALID` is for a resource
  without one, although its own text mentions any empty name.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Collection, Container, Iterable, Iterator, Sequence
from enum import Enum, auto
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple
from urllib.parse import parse_qsl

import msgspec
import numpy as np
import re2
from msgspec.structs import replace
from numpy.typing import NDArray

from mindstage.access.limits import PATTERN_BYTES, PATTERN_CHARACTERS
from mindstage.access.policies import EDIT, FILE, READ, SPAWN
from mindstage.access.resources import GrantedFolder
from mindstage.bridge.conversions import pose_array_messages, pose_from_message, vector_from_message
from mindstage.bridge.conversions_unreal import iri_namespace
from mindstage.engines import SpawnReport
from mindstage.errors import (
    BodyNotFoundError,
    KnowledgeError,
    PoseUnreachableError,
    SourceParseError,
    XacroRefusedError,
)
from mindstage.files import atomic_write
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import UnitConventions
from mindstage.msgs import builtin_interfaces, geometry_msgs, modul_spawner_msgs, std_msgs
from mindstage.msgs import simulation_interfaces as wire
from mindstage.rdf.graphs import local_name
from mindstage.ros.diagnostics import DiagnosticsPublisher
from mindstage.ros.service import OK, ResultError, ServiceSpec, failed, unsupported
from mindstage.ros.state import StateReader, free_id, map_iri
from mindstage.scene import Attachment, Body, BodyId, GeometrySource, Iri, Joint, Mobility, Pose, World
from mindstage.scene.bounding_boxes import OrientedBoxes
from mindstage.scene.edits import Delete, SetPoses
from mindstage.scene.transforms import (
    Array,
    normalize,
    normalized_pose_array,
    pose_from_array,
    pose_inverse,
    pose_multiply,
)
from mindstage.simulation import Simulation

__all__ = [
    "FORMATS",
    "WORLD_FRAME",
    "AssetProblem",
    "EntityServices",
    "ResourceError",
    "ResourceErrorType",
    "ResourceLoader",
    "SpawnServices",
    "asset_problem",
    "bounds_of",
    "category_of",
    "clone_at",
    "filter_entities",
    "has_tags",
    "name_matcher",
    "root_body",
    "subtree",
    "tags_of",
]


FORMATS = {".owl": "owl", ".rdf": "rdf", ".ttl": "ttl", ".urdf": "urdf"}
"""Formats that can be loaded, by suffix of the file name."""
_COLLATING = re.compile(r"\[[^\]]*\[[.=]")
"""Collating symbols and equivalence classes, which RE2 reads as literal characters."""
WORLD_FRAME = "world"
"""Frame id of the world in responses."""
_URDF_NAMESPACE = "http://mindstage.org/urdf/"
"""Beginning of the IRIs of worlds that are read from a URDF."""
_NAME = re.compile(r"[^\s/\x00-\x1f\x7f]+(/[^\s/\x00-\x1f\x7f]+)*")
"""Names of entities: no white space, and no empty part between slashes."""
_NAMESPACE = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*/?", re.ASCII)
"""Namespaces, as ROS restricts them."""
_UNSUPPORTED_FEATURES = {
    wire.Feature.ENTITY_BOUNDS_CONVEX,
    wire.Feature.ENTITY_INFO_SETTING,
    wire.Feature.SIMULATION_RESET_TIME,
}


class ResourceErrorType(Enum):
    """Why a resource cannot be loaded."""

    NOT_GIVEN = auto()
    """Neither a URI nor a text is given."""
    NOT_FOUND = auto()
    UNSUPPORTED_FORMAT = auto()
    PARSE_ERROR = auto()


class ResourceError(Exception):
    """A resource cannot be loaded."""

    def __init__(self, type: ResourceErrorType, text: str) -> None:
        self.type = type
        super().__init__(text)


class ResourceLoader:
    """Finds and loads resources."""

    def __init__(self, knowledge: KnowledgeBase, folder: Path | None) -> None:
        """Creates the loader.

        Args:
            knowledge: knowledge base with the maps.
            folder: folder with files that may be loaded; None for no files.
        """
        self.knowledge = knowledge
        self._folder = GrantedFolder(folder)

    def files(self) -> Iterator[str]:
        """Yields the paths of all files that can be loaded, relative to the folder."""
        return self._folder.files(FORMATS)

    def find_file(self, name: str, suffixes: Collection[str]) -> Path | None:
        """Returns the file of a name in the folder, with one of some suffixes; None if there is none."""
        path = self._folder.find(name)
        return path if path is not None and path.suffix.lower() in suffixes else None

    def find_body(self, name: str) -> tuple[World, Body] | None:
        """Returns the body with an IRI or id, and the world of its map; None if no map has it."""
        for map in self.knowledge.maps():
            world = self.knowledge.world(map)
            for body in world.bodies:
                if name in {body.iri, body.id}:
                    return world, body
        return None

    def load_world(self, uri: str, text: str = "") -> World:
        """Loads the world of a map, a file or a text; the text is used if the URI is empty.

        The query of the URI of a file gives conventions of its numbers, such as `map.owl?units=cm&quaternion=xyzw`.

        Raises:
            ResourceError: it cannot be loaded.
        """
        maps = self.knowledge.maps()
        if uri and (uri in maps or uri in map(local_name, maps)):
            return self._read(self.knowledge, uri)
        uri, _, query = uri.partition("?")
        conventions = _conventions_from_query(query)
        if uri:
            return self._read_file(self._path(uri), conventions, KnowledgeBase())
        if not text.strip():
            raise ResourceError(ResourceErrorType.NOT_GIVEN, "neither a URI nor a text is given")
        with TemporaryDirectory(prefix="mindstage-") as folder:
            path = Path(folder, f"resource{_guess_suffix(text)}")
            atomic_write(path, text.encode())
            # An import of an ontology that is loaded is accepted; without one, no ontologies have to be loaded again.
            knowledge = self.knowledge.ontologies_only() if "imports" in text else KnowledgeBase()
            return self._read_file(path, conventions, knowledge, untrusted=True)

    def _path(self, uri: str) -> Path:
        path = self._folder.find(uri)
        if path is None:
            known = ", ".join([*map(local_name, self.knowledge.maps()), *self.files()][:10]) or "nothing"
            raise ResourceError(ResourceErrorType.NOT_FOUND, f"no map or file {uri!r}; there is {known}")
        if path.suffix.lower() not in FORMATS:
            raise ResourceError(
                ResourceErrorType.UNSUPPORTED_FORMAT, f"the format of {path.name} is none of {', '.join(FORMATS)}"
            )
        return path

    def _read_file(
        self, path: Path, conventions: UnitConventions, knowledge: KnowledgeBase, *, untrusted: bool = False
    ) -> World:
        with knowledge:
            try:
                knowledge.load(path, conventions=conventions, xacro=False, untrusted=untrusted)
            except SourceParseError as error:  # without the path on this machine
                is_xacro = isinstance(error, XacroRefusedError)
                type = ResourceErrorType.UNSUPPORTED_FORMAT if is_xacro else ResourceErrorType.PARSE_ERROR
                text = str(SourceParseError(path.name, cause=error.cause, line=error.line))
                raise ResourceError(type, text) from error
            except KnowledgeError as error:
                raise ResourceError(ResourceErrorType.PARSE_ERROR, str(error)) from error
            return self._read(knowledge, None)

    @staticmethod
    def _read(knowledge: KnowledgeBase, map: str | None) -> World:
        try:
            return knowledge.world(map)
        except KnowledgeError as error:
            raise ResourceError(ResourceErrorType.PARSE_ERROR, str(error)) from error


def _conventions_from_query(query: str) -> UnitConventions:
    """Returns the conventions that the query of a URI gives.

    Raises:
        ResourceError: a name or a value is invalid.
    """
    try:
        return msgspec.convert(dict(parse_qsl(query, strict_parsing=bool(query))), UnitConventions)
    except ValueError as error:  # msgspec.ValidationError is one too
        names = ", ".join(UnitConventions.__struct_fields__)
        text = f"the query {query!r} does not give conventions ({names}): {error}"
        raise ResourceError(ResourceErrorType.PARSE_ERROR, text) from error


def _guess_suffix(text: str) -> str:
    """Returns the suffix of a file with this content."""
    if re.search(r"<robot[\s>]", text[:10_000]):
        return ".urdf"
    return ".owl" if text.lstrip().startswith("<") and "<rdf:RDF" in text else ".ttl"


def filter_entities(state_reader: StateReader, filters: wire.EntityFilters) -> tuple[BodyId, ...]:
    """Returns the entities that match, in the order of the snapshot.

    Raises:
        ResultError: the pattern is invalid, or the bounds are of an unsupported type.
    """
    ids: tuple[BodyId, ...] = state_reader.state().ids
    if filters.filter:
        matches = name_matcher(filters.filter)
        ids = tuple(id for id in ids if matches(id))
    categories = {each.category for each in filters.categories}
    if categories or filters.tags.tags:
        bodies = {body.id: body for body in state_reader.world().bodies}
        ids = tuple(id for id in ids if id in bodies and has_tags(tags_of(bodies[id]), filters.tags))
        if categories:
            bases = state_reader.robot_bases()
            ids = tuple(id for id in ids if category_of(bodies[id], bases) in categories)
    return (
        _overlapping_bounds(state_reader, ids, filters.bounds)
        if filters.bounds.type is not wire.BoundsType.TYPE_EMPTY
        else ids
    )


def name_matcher(pattern: str) -> Callable[[str], bool]:
    """Compiles a POSIX extended regular expression; the result returns whether it is found anywhere in a text.

    Raises:
        ResultError: it is not such an expression, or it is too large.
    """
    options = re2.Options()
    options.posix_syntax = options.one_line = options.dot_nl = options.never_capture = True
    options.log_errors = False
    options.max_mem = PATTERN_BYTES.count
    try:
        if len(pattern) > PATTERN_CHARACTERS.count:
            raise re2.error(f"longer than {PATTERN_CHARACTERS.count} characters")
        if _COLLATING.search(pattern):
            raise re2.error("collating symbols are not supported")
        compiled = re2.compile(pattern, options)
    except (re2.error, UnicodeEncodeError) as error:
        cause = error.args[0].decode(errors="replace") if isinstance(error.args[0], bytes) else str(error)
        raise failed(f"{pattern[:100]!r} is not an extended regular expression: {cause[:200]}") from error
    return lambda text: compiled.search(text) is not None


def category_of(body: Body, robot_bases: Container[BodyId]) -> wire.Category:
    """Returns the category of a body: that of a robot for its base, else by the mobility of the body.

    Args:
        body: the body.
        robot_bases: the bodies of the root links of all robots; their other links are objects of their own.
    """
    if body.id in robot_bases:
        return wire.Category.CATEGORY_ROBOT
    match body.physics.mobility:
        case Mobility.DYNAMIC:
            return wire.Category.CATEGORY_DYNAMIC_OBJECT
        case Mobility.KINEMATIC:
            return wire.Category.CATEGORY_OBJECT
    return wire.Category.CATEGORY_STATIC_OBJECT


def tags_of(body: Body) -> tuple[str, ...]:
    """Returns the local name of the class of a body, and its tags as `type/key=value`."""
    return (local_name(body.cls), *(f"{tag.type}/{tag.key}={tag.value}" for tag in body.tags))


def has_tags(tags: tuple[str, ...], wanted: wire.TagsFilter) -> bool:
    """Whether tags match a filter; an empty filter matches all."""
    if not wanted.tags:
        return True
    found = [tag in tags for tag in wanted.tags]
    return all(found) if wanted.filter_mode is wire.FilterMode.FILTER_MODE_ALL else any(found)


def _overlapping_bounds(state_reader: StateReader, ids: tuple[BodyId, ...], bounds: wire.Bounds) -> tuple[BodyId, ...]:
    """Returns the entities whose axis-aligned bounding box overlaps the bounds."""
    if not ids:
        return ids
    snapshot = state_reader.state()
    rows = state_reader.row_by_id(snapshot)
    bodies = {body.id: body for body in state_reader.world().bodies}
    ids = tuple(id for id in ids if id in bodies and id in rows)
    poses = snapshot.poses[[rows[id] for id in ids]].reshape(-1, 7).copy()
    poses[:, 3:] = normalize(poses[:, 3:])
    sizes = np.array([bodies[id].size or (0.0, 0.0, 0.0) for id in ids], dtype=np.float64).reshape(-1, 3)
    low, high = OrientedBoxes.from_poses(poses, sizes).bounds()
    overlaps = _bounds_overlap(bounds, low, high)
    return tuple(id for id, overlapping in zip(ids, overlaps, strict=True) if overlapping)


def _bounds_overlap(bounds: wire.Bounds, low: Array, high: Array) -> NDArray[np.bool_]:
    points = np.array([vector_from_message(point) for point in bounds.points], dtype=np.float64).reshape(-1, 3)
    match bounds.type:
        case wire.BoundsType.TYPE_BOX | wire.BoundsType.TYPE_SPHERE if len(points) != 2:
            raise failed(f"a {bounds.type.name} has two points, not {len(points)}")
        case wire.BoundsType.TYPE_BOX:
            overlaps = np.all((low <= points.max(axis=0)) & (high >= points.min(axis=0)), axis=1)
        case wire.BoundsType.TYPE_SPHERE:
            nearest = np.clip(points[0], low, high)
            overlaps = np.linalg.norm(nearest - points[0], axis=1) <= points[1, 0]
        case _:
            raise unsupported("entities can be filtered by a box or a sphere, not by a convex hull")
    return np.asarray(overlaps)


class EntityServices:
    """Services that return and set the state of entities."""

    def __init__(self, state_reader: StateReader) -> None:
        self._state_reader = state_reader
        self._simulation = state_reader.simulation

    def services(self) -> Iterator[ServiceSpec]:
        """Yields all services."""
        yield ServiceSpec(wire.GetEntities, self.get_entities, READ)
        yield ServiceSpec(wire.GetEntitiesStates, self.get_states, READ)
        yield ServiceSpec(wire.GetEntityState, self.get_state, READ, quick=True)
        yield ServiceSpec(wire.SetEntityState, self.set_state, EDIT)
        yield ServiceSpec(wire.GetEntityInfo, self.get_info, READ)
        yield ServiceSpec(wire.SetEntityInfo, self.set_info, EDIT)
        yield ServiceSpec(wire.GetEntityBounds, self.get_bounds, READ)
        yield ServiceSpec(wire.DeleteEntity, self.delete, EDIT)

    def get_entities(self, request: wire.GetEntities.Request) -> wire.GetEntities.Response:
        """Returns the names of the entities that match the filters."""
        return wire.GetEntities.Response(result=OK, entities=filter_entities(self._state_reader, request.filters))

    def get_states(self, request: wire.GetEntitiesStates.Request) -> wire.GetEntitiesStates.Response:
        """Returns the entities that match the filters, with their poses."""
        ids = filter_entities(self._state_reader, request.filters)
        snapshot = self._state_reader.state()
        rows = self._state_reader.row_by_id(snapshot)
        present = tuple(id for id in ids if id in rows)
        poses = pose_array_messages(snapshot.poses[[rows[id] for id in present]].reshape(-1, 7))
        header = self._header()
        states = tuple(wire.EntityState(header=header, pose=pose) for pose in poses)
        return wire.GetEntitiesStates.Response(result=OK, entities=present, states=states)

    def get_state(self, request: wire.GetEntityState.Request) -> wire.GetEntityState.Response:
        """Returns the pose of an entity. Engines have no velocities, so twist and acceleration are zero."""
        (pose,) = pose_array_messages(self._state_reader.pose(request.entity)[None])
        return wire.GetEntityState.Response(result=OK, state=wire.EntityState(header=self._header(), pose=pose))

    def set_state(self, request: wire.SetEntityState.Request) -> wire.SetEntityState.Response:
        """Sets the pose of an entity, at rest; the pose may be in the frame of another entity."""
        self._state_reader.require([request.entity])
        if request.set_twist or request.set_acceleration:
            raise unsupported("only the pose of an entity can be set, not its velocity or acceleration")
        if request.set_pose:
            state, id = request.state, BodyId(request.entity)
            try:
                pose = self._state_reader.to_world_frame(pose_from_message(state.pose), state.header.frame_id)
                self._simulation.apply(SetPoses({id: pose}))
            except (BodyNotFoundError, PoseUnreachableError) as error:
                raise ResultError(wire.SetEntityStateCode.INVALID_POSE, str(error)) from error
        return wire.SetEntityState.Response(result=OK)

    def get_info(self, request: wire.GetEntityInfo.Request) -> wire.GetEntityInfo.Response:
        """Returns the label of an entity, or else its class; the first tag is its class."""
        body = self._state_reader.body(request.entity)
        info = wire.EntityInfo(
            category=wire.EntityCategory(category=category_of(body, self._state_reader.robot_bases())),
            description=body.label or local_name(body.cls),
            tags=tags_of(body),
        )
        return wire.GetEntityInfo.Response(result=OK, info=info)

    def set_info(self, request: wire.SetEntityInfo.Request) -> wire.SetEntityInfo.Response:
        """Rejects the request: the properties of an entity come from its map."""
        self._state_reader.require([request.entity])
        raise unsupported("the properties of an entity come from its map; assert facts in the knowledge base instead")

    def get_bounds(self, request: wire.GetEntityBounds.Request) -> wire.GetEntityBounds.Response:
        """Returns the bounding box of an entity in its own frame; empty if its size is unknown."""
        return wire.GetEntityBounds.Response(result=OK, bounds=bounds_of(self._state_reader.body(request.entity).size))

    def delete(self, request: wire.DeleteEntity.Request) -> wire.DeleteEntity.Response:
        """Deletes an entity; one that was spawned with parts, with those of its parts that exist."""
        self._state_reader.require([request.entity])
        rows = self._state_reader.row_by_id(self._state_reader.state())
        ids = tuple(id for id in _entity_ids(self._simulation.worlds, BodyId(request.entity)) if id in rows)
        self._simulation.apply(Delete(ids))
        return wire.DeleteEntity.Response(result=OK)

    def _header(self) -> std_msgs.Header:
        return std_msgs.Header(stamp=builtin_interfaces.Time.at(self._simulation.state.time_s), frame_id=WORLD_FRAME)


def _entity_ids(worlds: Sequence[World], id: BodyId) -> tuple[BodyId, ...]:
    """Returns a body, with the parts that were spawned with it under its name."""
    for world in reversed(worlds):
        ids = [body.id for body in world.bodies]
        if id in ids and len(ids) > 1 and all(each == id or each.startswith(f"{id}/") for each in ids):
            return (id, *(each for each in ids if each != id))
    return (id,)


def bounds_of(size: tuple[float, float, float] | None) -> wire.Bounds:
    """Returns the bounding box of a body in its own frame: the upper and the lower corner."""
    if size is None:
        return wire.Bounds()
    x, y, z = (extent / 2 for extent in size)
    return wire.Bounds(
        type=wire.BoundsType.TYPE_BOX,
        points=(geometry_msgs.Vector3(x=x, y=y, z=z), geometry_msgs.Vector3(x=-x, y=-y, z=-z)),
    )


def root_body(world: World) -> Body | None:
    """Returns the first body that is not a child of another one; None if there are no bodies."""
    children = {attachment.child for attachment in world.attachments} | {joint.child for joint in world.joints}
    roots = [body for body in world.bodies if body.id not in children] or list(world.bodies)
    return roots[0] if roots else None


def subtree(world: World, id: BodyId) -> World:
    """Returns a body with all bodies attached to it."""
    kept = {id}
    while more := {each.child for each in world.attachments if each.parent in kept} - kept:
        kept |= more
    return replace(
        world,
        bodies=tuple(body for body in world.bodies if body.id in kept),
        joints=(),
        attachments=tuple(each for each in world.attachments if each.parent in kept and each.child in kept),
        lights=(),
        facts=(),
        resources=(),
    )


def clone_at(template: World, root: Body, *, name: str, pose: Pose | None, map: str) -> World:
    """Copies a world with new names and another pose.

    Args:
        template: the body and its parts.
        root: the body that gets the name and the pose.
        name: name of the root; the parts are called `name/part`.
        pose: pose of the root; None keeps all poses.
        map: IRI of the map of the new individuals.
    """

    def new_id(id: BodyId) -> BodyId:
        return BodyId(name if id == root.id else f"{name}/{id}")

    transform = _pose_transform(root.pose, pose)
    namespace = iri_namespace(map)
    return World(
        iri=Iri(map),
        bodies=tuple(_clone_body(body, new_id(body.id), namespace, transform) for body in template.bodies),
        joints=tuple(_clone_joint(joint, new_id, namespace, transform) for joint in template.joints),
        attachments=_clone_attachments(template.attachments, new_id),
    )


def _pose_transform(before: Pose, after: Pose | None) -> Callable[[Pose], Pose]:
    if after is None:
        return lambda pose: pose
    after_from_before: Array = pose_multiply(normalized_pose_array(after), pose_inverse(normalized_pose_array(before)))
    return lambda pose: (
        after if pose == before else pose_from_array(pose_multiply(after_from_before, normalized_pose_array(pose)))
    )


def _clone_body(body: Body, id: BodyId, namespace: str, transform: Callable[[Pose], Pose]) -> Body:
    return replace(body, id=id, iri=Iri(namespace + id), pose=transform(body.pose))


def _clone_joint(
    joint: Joint, new_id: Callable[[BodyId], BodyId], namespace: str, transform: Callable[[Pose], Pose]
) -> Joint:
    id = new_id(joint.id)
    bodies = {"parent": new_id(joint.parent), "child": new_id(joint.child)}
    return replace(joint, id=id, iri=Iri(namespace + id), pose=transform(joint.pose), **bodies)


def _clone_attachments(attachments: Iterable[Attachment], new_id: Callable[[BodyId], BodyId]) -> tuple[Attachment, ...]:
    return tuple(Attachment(parent=new_id(each.parent), child=new_id(each.child)) for each in attachments)


class AssetProblem(NamedTuple):
    """Why the assets of a world, such as meshes, cannot be used."""

    found: bool
    """Whether they were found, but are not supported."""
    text: str


def asset_problem(
    world: World, simulation: Simulation, report: SpawnReport, *, any_geometry: bool
) -> AssetProblem | None:
    """Returns which meshes of a spawned world are not used, and why; None if all are.

    Args:
        simulation: the simulation in which it was spawned.
        any_geometry: whether a mesh may be replaced by the shape that the ontology states for the class.
    """
    replacing = {GeometrySource.MESH, GeometrySource.ONTOLOGY} if any_geometry else {GeometrySource.MESH}
    geometry = simulation.geometry
    unused = [
        body.mesh
        for body in world.bodies
        if body.mesh and (body.id not in geometry or geometry[body.id].source not in replacing)
    ]
    if not unused:
        return None
    rejected = [note.text for note in report.notes if any(Path(mesh).stem in note.text for mesh in unused)]
    names = ", ".join(sorted(set(unused))[:5])
    return AssetProblem(bool(rejected), "; ".join(rejected[:3]) or f"no file is found for {names}")


_RESULT_CODES = {
    ResourceErrorType.NOT_GIVEN: wire.SpawnCode.NO_RESOURCE,
    ResourceErrorType.NOT_FOUND: wire.ResultCode.RESULT_NOT_FOUND,
    ResourceErrorType.UNSUPPORTED_FORMAT: wire.SpawnCode.UNSUPPORTED_FORMAT,
    ResourceErrorType.PARSE_ERROR: wire.SpawnCode.RESOURCE_PARSE_ERROR,
}
_Request = wire.SpawnEntity.Request | wire.SpawnEntityMessage


class SpawnServices:
    """Services that spawn entities."""

    def __init__(
        self, state_reader: StateReader, resources: ResourceLoader, diagnostics: DiagnosticsPublisher, *, step_s: float
    ) -> None:
        self._state_reader = state_reader
        self._simulation = state_reader.simulation
        self._resources = resources
        self._diagnostics = diagnostics
        self._step_s = step_s

    def services(self) -> Iterator[ServiceSpec]:
        """Yields all services."""
        yield ServiceSpec(wire.GetSimulatorFeatures, self.get_features, READ)
        yield ServiceSpec(wire.GetSpawnables, self.get_spawnables, FILE)
        yield ServiceSpec(wire.SpawnEntity, self.spawn_entity, SPAWN)
        yield ServiceSpec(wire.SpawnEntities, self.spawn_entities, SPAWN)
        yield ServiceSpec(modul_spawner_msgs.SpawnRobot, self.spawn_robot, SPAWN)

    def get_features(self, _: wire.GetSimulatorFeatures.Request) -> wire.GetSimulatorFeatures.Response:
        """Returns the supported features."""
        info = {"engine": self._simulation.engine.name, "step_s": self._step_s}
        features = wire.SimulatorFeatures(
            features=tuple(feature for feature in wire.Feature if feature not in _UNSUPPORTED_FEATURES),
            spawn_formats=tuple(FORMATS.values()),
            custom_info=json.dumps(info),
        )
        return wire.GetSimulatorFeatures.Response(features=features)

    def get_spawnables(self, request: wire.GetSpawnables.Request) -> wire.GetSpawnables.Response:
        """Returns the bodies of all maps and the files of the folder.

        `sources` are maps or parts of the folder, which are listed anyway; others are named in the message.
        """
        found: list[wire.Spawnable] = []
        for map in self._resources.knowledge.maps():
            found += (_spawnable(body) for body in self._resources.knowledge.world(map).bodies)
        files = tuple(self._resources.files())
        found += (
            wire.Spawnable(entity_resource=wire.Resource(uri=name), description=f"the file {name}") for name in files
        )
        unknown = [source for source in request.sources if not self._is_listed(source, files)]
        text = f"unknown sources: {', '.join(unknown)[:1000]}" if unknown else ""
        return wire.GetSpawnables.Response(result=replace(OK, error_message=text), spawnables=tuple(found))

    def _is_listed(self, source: str, files: Sequence[str]) -> bool:
        maps = self._resources.knowledge.maps()
        path = source.removeprefix("file://").rstrip("/")
        is_file = any(name == path or name.startswith(f"{path}/") for name in files)
        return source in maps or source in map(local_name, maps) or is_file

    def spawn_entity(self, request: wire.SpawnEntity.Request) -> wire.SpawnEntity.Response:
        """Spawns one entity."""
        return wire.SpawnEntity.Response(result=OK, entity_name=self._spawn(request))

    def spawn_entities(self, request: wire.SpawnEntities.Request) -> wire.SpawnEntities.Response:
        """Spawns several entities, one after the other; one that fails does not stop the rest."""
        results = tuple(self._spawn_result(each) for each in request.spawn_requests)
        failed_count = sum(each.result.result != OK.result for each in results)
        if not failed_count:
            return wire.SpawnEntities.Response(result=OK, results=results)
        text = f"{failed_count} of {len(results)} were not spawned"
        result = wire.Result(result=wire.SpawnEntitiesCode.ENTITIES_SPAWN_FAILED, error_message=text)
        return wire.SpawnEntities.Response(result=result, results=results)

    def spawn_robot(self, request: modul_spawner_msgs.SpawnRobot.Request) -> modul_spawner_msgs.SpawnRobot.Response:
        """Spawns a robot from a file of the folder, or from a URDF text in place of its name."""
        is_text = request.name.lstrip().startswith("<")
        name = request.id or self._free_id("Robot" if is_text else request.name.rpartition("/")[2].partition(".")[0])
        try:
            world = self._resources.load_world("" if is_text else request.name, request.name if is_text else "")
            self._spawn_clone(world, root_body(world), name=name, pose=None)
        except (ResourceError, ResultError) as error:
            self._diagnostics.report_failures("spawn_robot", [(name, str(error))])
            return modul_spawner_msgs.SpawnRobot.Response(id=name)
        return modul_spawner_msgs.SpawnRobot.Response(id=name, name=name, success=True)

    def _spawn_result(self, request: wire.SpawnEntityMessage) -> wire.SpawnResult:
        try:
            return wire.SpawnResult(result=OK, entity_name=self._spawn(request))
        except ResultError as error:
            self._diagnostics.report_failures("spawn_entities", [(request.name, str(error))])
            return wire.SpawnResult(result=error.result, entity_name=request.name)

    def _spawn(self, request: _Request) -> str:
        world, root = self._template(request.entity_resource)
        name = self._entity_name(request, world, root)
        try:
            pose = self._state_reader.to_world_frame(
                pose_from_message(request.initial_pose.pose), request.initial_pose.header.frame_id
            )
        except BodyNotFoundError as error:
            raise ResultError(wire.SpawnCode.INVALID_POSE, str(error)) from error
        if not any(pose.quaternion):
            raise ResultError(wire.SpawnCode.INVALID_POSE, "the quaternion of initial_pose is zero")
        self._spawn_clone(world, root, name=name, pose=pose)
        return name

    def _spawn_clone(self, world: World, root: Body | None, *, name: str, pose: Pose | None) -> None:
        if root is None:
            raise ResultError(wire.SpawnCode.RESOURCE_PARSE_ERROR, "it has no bodies")
        worlds = self._simulation.worlds
        clone = clone_at(world, root, name=name, pose=pose, map=worlds[0].iri if worlds else map_iri("spawned"))
        report = self._simulation.spawn(clone)
        self._diagnostics.report_spawn("spawn", report)
        if report.failed_bodies:
            self._remove(clone)
            text = "; ".join(f"{each.id}: {each.reason}" for each in report.failed_bodies[:3])
            raise failed(text)
        if problem := asset_problem(clone, self._simulation, report, any_geometry=True):
            self._remove(clone)
            code = wire.SpawnCode.UNSUPPORTED_ASSETS if problem.found else wire.SpawnCode.MISSING_ASSETS
            raise ResultError(code, problem.text)

    def _remove(self, world: World) -> None:
        """Deletes what was spawned of an entity that failed."""
        added = {body.id for body in world.bodies}
        self._simulation.apply(Delete(tuple(id for id in self._simulation.state.ids if id in added)))

    def _template(self, resource: wire.Resource) -> tuple[World, Body | None]:
        if resource.uri and (known := self._resources.find_body(resource.uri)):
            world, body = known
            return replace(subtree(world, body.id), name=""), body
        try:
            world = self._resources.load_world(resource.uri, resource.resource_string)
        except ResourceError as error:
            raise ResultError(_RESULT_CODES[error.type], str(error)) from error
        return world, root_body(world)

    def _entity_name(self, request: _Request, world: World, root: Body | None) -> str:
        """Returns the full name of a new entity: in its namespace, and unique."""
        if request.entity_namespace and not _NAMESPACE.fullmatch(request.entity_namespace):
            text = f"{request.entity_namespace!r} is not a namespace; use letters, digits, _ and /"
            raise ResultError(wire.SpawnCode.NAMESPACE_INVALID, text)
        space = request.entity_namespace.strip("/")
        name = request.name or (world.name if world.iri.startswith(_URDF_NAMESPACE) else "")
        if name and not _NAME.fullmatch(name):
            text = f"{name[:100]!r} is not a valid name; it has white space, or an empty part between slashes"
            raise ResultError(wire.SpawnCode.NAME_INVALID, text)
        if not name and not request.allow_renaming:
            text = "a name is required unless the resource has one or allow_renaming is set"
            raise ResultError(wire.SpawnCode.NAME_INVALID, text)
        stem = "/".join(filter(None, (space, name or (local_name(root.cls) if root else "Entity"))))
        taken = self._state_reader.row_by_id(self._state_reader.state())
        if name and stem not in taken:
            return stem
        if not request.allow_renaming:
            raise ResultError(wire.SpawnCode.NAME_NOT_UNIQUE, f"{stem!r} is taken")
        return free_id(stem, taken)

    def _free_id(self, stem: str) -> str:
        return free_id(stem or "Robot", self._state_reader.row_by_id(self._state_reader.state()))


def _spawnable(body: Body) -> wire.Spawnable:
    return wire.Spawnable(
        entity_resource=wire.Resource(uri=body.iri),
        description=body.label or local_name(body.cls),
        spawn_bounds=bounds_of(body.size),
    )
