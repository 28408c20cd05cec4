"""The Python side of KnowRob's predicates about objects: where they are, how they are joined, what they look like.

Poses are those of the running simulation and of the maps that are not spawned in it. KnowRob remembers what a robot
perceived and when; here each reading of the state is an observation, and the state at an earlier time is that of the
latest observation before it, or that of an episode which has a state at that time. Frames: poses are in the world
frame, lengths in meters, quaternions (w, x, y, z).
"""

from __future__ import annotations

import re
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import count
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from mindstage.access.limits import OBSERVATIONS
from mindstage.errors import (
    AmbiguousNameError,
    EpisodeError,
    InvalidArgumentError,
    MindstageError,
    NameNotFoundError,
)
from mindstage.knowledge.history import History, QuestionTime, histories_of
from mindstage.knowledge.names import EntityType
from mindstage.knowledge.over_time import state_of_time
from mindstage.knowledge.questions import StateAccess, WorldState
from mindstage.prolog.predicates import Handler, text_of
from mindstage.prolog.swipl import FREE, Atom, Compound, Value
from mindstage.ranges import Time, check_number, declared_range
from mindstage.rdf.graphs import local_name, namespace_of
from mindstage.scene import (
    AngularLimits,
    AxisMotion,
    Body,
    BodyId,
    Iri,
    Joint,
    LinearLimits,
    Pose,
    SoftLimit,
    World,
)
from mindstage.scene.edits import Attach, SetPoses
from mindstage.scene.joint_kinematics import moving_body
from mindstage.scene.transforms import Array, normalize, pose_array, pose_from_array, pose_inverse, pose_multiply
from mindstage.scene.transforms import rotation_matrix as rotation_matrices
from mindstage.simulation import Marker, MarkerType, Simulation

__all__ = ["ObjectPredicates"]


_TIME = declared_range(Time)
_SIDE_M = 0.30
_CENTER_M = 0.20
_CONTAINMENT_M = 0.05
"""The tolerances of KnowRob's comp_spatial.pl (M. Tenorth, L. Kunze, 2009-13) [m]."""
_VERTICAL = 1e-9
"""A direction with a smaller component is parallel to a plane; a fraction of its length."""
_WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|[0-9]+")

_JOINT_NUMBERS = 28
"""The length of the list of spawn_constraint/1: 2 ids, 7 numbers of the pose, 7 linear and 12 angular ones."""


class _Scene(msgspec.Struct, frozen=True, eq=False):
    """The bodies of one world as arrays; row i of each describes `bodies[i]`."""

    state: WorldState
    rows: Mapping[Iri, int]
    poses: Array
    """n x 7."""
    rotations: Array
    """n x 3 x 3."""
    sizes: Array
    """n x 3: depth, width, height; NaN if unknown."""
    joints: Mapping[Iri, Joint]

    @property
    def bodies(self) -> tuple[Body, ...]:
        return self.state.world.bodies

    @property
    def positions(self) -> Array:
        return self.poses[:, :3]


def _scene(state: WorldState) -> _Scene:
    bodies = state.world.bodies
    poses = pose_array(body.pose for body in bodies).reshape(-1, 7)
    poses[:, 3:] = normalize(poses[:, 3:])
    unknown = (np.nan,) * 3
    sizes = np.array([body.size or unknown for body in bodies], dtype=np.float64).reshape(-1, 3)
    return _Scene(
        state=state,
        rows={body.iri: row for row, body in enumerate(bodies)},
        poses=poses,
        rotations=rotation_matrices(poses[:, 3:]),
        sizes=sizes,
        joints={joint.iri: joint for joint in state.world.joints},
    )


class _Observation(msgspec.Struct, frozen=True, eq=False):
    """The state of all scenes from a time on, until the next observation."""

    number: int
    time_s: float
    """Seconds since 1970."""
    ids: tuple[BodyId, ...]
    poses: Array
    worlds: tuple[World, ...]
    """The worlds as they were spawned, and those of all maps."""
    scenes: tuple[_Scene, ...]


_Rows = NDArray[np.intp]
_Mask = NDArray[np.bool_]
_Relation = Callable[[_Scene, _Rows, _Rows], _Mask]


def _left_of(scene: _Scene, a: _Rows, b: _Rows) -> _Mask:
    x, y, z = (scene.positions[a] - scene.positions[b]).T
    return np.asarray((np.abs(x) <= _SIDE_M) & (y >= 0.0) & (np.abs(z) <= _SIDE_M))


def _in_front_of(scene: _Scene, a: _Rows, b: _Rows) -> _Mask:
    return np.asarray(scene.positions[a, 0] >= scene.positions[b, 0])


def _in_center_of(scene: _Scene, a: _Rows, b: _Rows) -> _Mask:
    return np.asarray(np.all(np.abs(scene.positions[a] - scene.positions[b]) <= _CENTER_M, axis=1))


def _above(scene: _Scene, a: _Rows, b: _Rows) -> _Mask:
    """Whether the center of a is over the footprint of b, the vertical projection of its box, and higher than b's."""
    offset = scene.positions[a] - scene.positions[b]
    rotation = scene.rotations[b]
    start = np.einsum("...ji,...j->...i", rotation, offset)
    direction = np.broadcast_to(rotation[..., 2, :], start.shape)
    half = np.broadcast_to(scene.sizes[b] / 2.0, start.shape)
    parallel = np.abs(direction) < _VERTICAL
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack([(-half - start) / direction, (half - start) / direction])
    first = np.where(parallel, np.where(np.abs(start) <= half, -np.inf, np.inf), ends.min(axis=0))
    last = np.where(parallel, np.where(np.abs(start) <= half, np.inf, -np.inf), ends.max(axis=0))
    has_extent = (half[..., 0] > 0.0) & (half[..., 1] > 0.0)
    over: _Mask = first.max(axis=-1) <= last.min(axis=-1)
    return over & has_extent & (offset[..., 2] > 0.0)


def _contained(scene: _Scene, a: _Rows, b: _Rows) -> _Mask:
    """Whether the extents of a are within those of b, whatever their rotations."""
    distance = np.abs(scene.positions[a] - scene.positions[b])
    return np.asarray(np.all(distance <= (scene.sizes[b] - scene.sizes[a]) / 2.0 + _CONTAINMENT_M, axis=1))


_RELATIONS: Mapping[str, _Relation] = {
    "on_Physical": _above,
    "comp_above_of": _above,
    "comp_below_of": lambda scene, a, b: _above(scene, b, a),
    "in_ContGeneric": _contained,
    "comp_toTheLeftOf": _left_of,
    "comp_toTheRightOf": lambda scene, a, b: _left_of(scene, b, a),
    "comp_toTheSideOf": lambda scene, a, b: _left_of(scene, a, b) | _left_of(scene, b, a),
    "comp_inFrontOf": _in_front_of,
    "comp_inCenterOf": _in_center_of,
}


_PAIRS_PER_PAGE = 1 << 16


def _rows_per_page(scene: _Scene) -> int:
    return max(1, _PAIRS_PER_PAGE // len(scene.bodies))


def _page_starts(scene: _Scene) -> range:
    """The first row of each page of pairs."""
    return range(0, len(scene.bodies), _rows_per_page(scene))


class ObjectPredicates:
    """Handlers of KnowRob's predicates about the poses, joints and appearance of objects."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._numbers = count(1)
        self._observations: deque[_Observation] = deque(maxlen=OBSERVATIONS.count)
        self._past: dict[tuple[str, float], _Observation] = {}
        """States of episodes."""
        self._forgotten = False
        self.handlers: dict[str, Handler] = {
            "observe": lambda: self._observe().number,
            "observe_at": self.observe_at,
            "time_point": self.time_point,
            "located": self.located,
            "pose_in": self.pose_in,
            "spatially_related": self.related,
            "related_pages": self.related_pages,
            "related_rows": self.related_rows,
            "connections": self.connections,
            "appearance": self.appearance,
            "name_kinds": self.name_kinds,
            "classes_with_word": self.classes_with_word,
            "move": self.move,
            "spawn_model": self.spawn_model,
            "spawn_constraint": self.spawn_constraint,
            "attach_models": self.attach_models,
            "add_marker": self.add_marker,
            "remove_marker": self.remove_marker,
        }

    # -- observations --------------------------------------------------------------------------------------------------

    def _observe(self) -> _Observation:
        """The present state; the last observation if nothing has moved since."""
        knowledge, state = self._simulation.knowledge, self._simulation.state
        last = self._observations[-1] if self._observations else None
        maps = self._described()
        worlds = (*self._simulation.worlds, *maps)
        are_same = last is not None and [*map(id, last.worlds)] == [*map(id, worlds)] and last.ids == state.ids
        if last and are_same and np.array_equal(last.poses, state.poses):
            return last
        access = StateAccess(knowledge, self._simulation.current_state)
        scenes = self._scenes_of(access, maps)
        self._forgotten = self._forgotten or len(self._observations) == OBSERVATIONS.count
        found = _Observation(
            number=next(self._numbers),
            time_s=time.time(),
            ids=state.ids,
            poses=state.poses.copy(),
            worlds=worlds,
            scenes=scenes,
        )
        self._observations.append(found)
        return found

    def _described(self) -> tuple[World, ...]:
        """The worlds of all maps."""
        knowledge = self._simulation.knowledge
        with knowledge.lock:
            return tuple(knowledge.world(map) for map in knowledge.maps())

    def _scenes_of(self, access: StateAccess, maps: tuple[World, ...]) -> tuple[_Scene, ...]:
        access.fetch()  # before taking the lock, since the engine may take a while
        with self._simulation.knowledge.lock:
            return tuple(_scene(_with_rest(each, maps)) for each in access.states())

    def observe_at(self, time_s: Value) -> Value:
        """The number of the latest observation that is not after a time [s since 1970]; `none` if there is none.

        Raises:
            InvalidArgumentError: observations of that time are no longer kept.
        """
        if not isinstance(time_s, int | float):
            raise InvalidArgumentError("the time", cause=f"{time_s!r} is no number of seconds since 1970")
        check_number(time_s, _TIME, "the time")
        if (past := self._observe_episode(float(time_s))) is not None:
            return past.number
        if time_s >= time.time():
            return self._observe().number
        found = next((each for each in reversed(self._observations) if each.time_s <= time_s), None)
        if found is None and self._forgotten:
            cause = (
                f"only the latest {OBSERVATIONS.count} observed states are kept, from {self._observations[0].time_s}"
            )
            raise InvalidArgumentError(f"the time {time_s}", cause=cause, remedy="ask about a later time")
        return Atom("none") if found is None else found.number

    def _observe_episode(self, time_s: float) -> _Observation | None:
        """The state of the episode that has a time [s since its begin, or since 1970]; None if none has.

        Raises:
            EpisodeError: several have it.
        """
        knowledge = self._simulation.knowledge
        found: list[tuple[History, float]] = []
        for history in histories_of(knowledge.episodes):
            since_begin = (time_s, time_s - (history.start_unix_s or 0.0))
            found += [(history, at) for at in dict.fromkeys(since_begin) if history.begin_s <= at <= history.end_s][:1]
        if not found:
            return None
        if len(found) > 1:
            names = ", ".join(history.name for history, _ in found[:3])
            raise EpisodeError(f"several episodes have a state at {time_s:g} s: {names}; load one of them")
        ((history, at),) = found
        if (history.name, at) not in self._past:
            access = state_of_time(knowledge, QuestionTime(at_s=at, episode=history.name), knowledge.episodes)
            scenes = self._scenes_of(access, self._described())
            while len(self._past) >= OBSERVATIONS.count:
                del self._past[next(iter(self._past))]
            self._past[history.name, at] = _Observation(
                number=next(self._numbers), time_s=time_s, ids=(), poses=np.zeros((0, 7)), worlds=(), scenes=scenes
            )
        return self._past[history.name, at]

    def time_point(self) -> Value:
        """The present time [s since 1970]; the present state is what later questions about this time refer to."""
        seen = self._observe()
        return max(time.time(), seen.time_s)

    def _scenes(self, number: Value) -> tuple[_Scene, ...]:
        for each in (*reversed(self._observations), *self._past.values()):
            if each.number == number:
                return each.scenes
        cause = f"only the latest {OBSERVATIONS.count} observed states are kept"
        raise InvalidArgumentError(f"the observation {number!r}", cause=cause)

    def _individual(self, name: Value, scenes: Sequence[_Scene]) -> Iri:
        """The IRI of an individual, by IRI, body id or name.

        Raises:
            NameNotFoundError: nothing has that name.
        """
        text = text_of(name, "individual")
        for scene in scenes:
            if text in scene.rows or text in scene.joints:
                return Iri(text)
        try:
            return self._simulation.knowledge.names.find(text, EntityType.INDIVIDUAL)
        except NameNotFoundError:
            bodies = (body for scene in scenes for body in scene.bodies)
            spawned = next((body.iri for body in bodies if body.id == text), None)
            if spawned is None:
                raise
            return spawned

    # -- poses ---------------------------------------------------------------------------------------------------------

    def located(self, number: Value, individual: Value) -> Value:
        """Everything that has a pose: rows of individual, map, type (body or joint), pose and size.

        A pose is [[X, Y, Z], [W, X, Y, Z]], a size [Depth, Width, Height] or none. A bound individual is left unbound.
        """
        scenes = self._scenes(number)
        one = None if individual is FREE else self._individual(individual, scenes)
        return [
            Compound("located", (FREE if one else Atom(iri), Atom(map), Atom(kind), _pose_term(pose), size))
            for iri, map, kind, pose, size in dict.fromkeys(_located(scenes, one))
        ]

    def pose_in(self, number: Value, frame: Value, individual: Value) -> Value:
        """The poses of an individual in the frame of another one, one for each scene that has both."""
        scenes = self._scenes(number)
        base, one = self._individual(frame, scenes), self._individual(individual, scenes)
        found = []
        for scene in scenes:
            poses = {iri: pose for iri, _, _, pose, _ in (*_located((scene,), base), *_located((scene,), one))}
            if base in poses and one in poses:
                relative = pose_multiply(pose_inverse(np.array(poses[base])), np.array(poses[one]))
                found.append(_pose_term(tuple(relative.tolist())))
        return list(dict.fromkeys(found))

    def related(self, number: Value, relation: Value, a: Value, b: Value) -> Value:
        """The pairs [A, B] of a relation of comp_spatial.pl; a bound body is left unbound in them.

        Raises:
            InvalidArgumentError: both are unbound; see `related_rows`.
        """
        scenes = self._scenes(number)
        holds = _RELATIONS[str(relation)]
        first = None if a is FREE else self._individual(a, scenes)
        second = None if b is FREE else self._individual(b, scenes)
        if first is None and second is None:
            raise InvalidArgumentError(str(relation), cause="both bodies are unbound")
        pairs: dict[tuple[Iri, Iri], None] = {}
        for scene in scenes:
            if not {first, second} - {None} <= scene.rows.keys():
                continue
            everything = np.arange(len(scene.bodies))
            rows_a = everything if first is None else np.array([scene.rows[first]])
            rows_b = everything if second is None else np.array([scene.rows[second]])
            mask = holds(scene, rows_a, rows_b) & (rows_a != rows_b)
            for at_a, at_b in zip(*(np.broadcast_to(rows, mask.shape)[mask] for rows in (rows_a, rows_b)), strict=True):
                pairs[scene.bodies[at_a].iri, scene.bodies[at_b].iri] = None
        return [[FREE if first else Atom(one), FREE if second else Atom(other)] for one, other in pairs]

    def related_pages(self, number: Value) -> Value:
        """Rows [Names, Count] for each scene: its bodies as names(Name, …), and how many pages of pairs it has."""
        return [
            [Compound("names", tuple(Atom(body.iri) for body in scene.bodies)), len(_page_starts(scene))]
            for scene in self._scenes(number)
            if scene.bodies
        ]

    def related_rows(self, number: Value, relation: Value, scene_row: Value, page: Value) -> Value:
        """The related pairs of some bodies of a scene with all others: row of A * number of bodies + row of B.

        Numbers take a fraction of the time that names take, of which there may be millions.
        """
        scene = [each for each in self._scenes(number) if each.bodies][int(str(scene_row))]
        count, starts = len(scene.bodies), _page_starts(scene)
        first = starts[int(str(page))]
        some = np.arange(first, min(first + _rows_per_page(scene), count))
        a, b = np.repeat(some, count), np.tile(np.arange(count), len(some))
        mask = _RELATIONS[str(relation)](scene, a, b) & (a != b)
        return (a * count + b)[mask].tolist()  # type: ignore[no-any-return]

    # -- joints and appearance -----------------------------------------------------------------------------------------

    def connections(self) -> Value:
        """How bodies are connected: [Holder, Moved, Joint, Type], the joint `none` for a rigid attachment."""
        found: dict[tuple[str, ...], None] = {}
        for scene in self._observe().scenes:
            bodies = {body.id: body for body in scene.bodies}
            for joint in scene.joints.values():
                if joint.parent in bodies and joint.child in bodies:
                    moving, holder = moving_body(joint, bodies[joint.parent], bodies[joint.child])
                    found[holder.iri, moving.iri, joint.iri, _joint_type(joint)] = None
            for each in scene.state.world.attachments:
                if each.parent in bodies and each.child in bodies:
                    found[bodies[each.parent].iri, bodies[each.child].iri, "none", "Fixed"] = None
        return [[Atom(part) for part in row] for row in found]

    def appearance(self, individual: Value) -> Value:
        """The color of an individual as [R, G, B] from 0 to 1 and the path of its mesh, each `none` if unknown."""
        scenes = self._observe().scenes
        one = self._individual(individual, scenes)
        bodies = [scene.bodies[scene.rows[one]] for scene in scenes if one in scene.rows]
        color = next((each.color for body in bodies for each in body.materials if each.color), None)
        mesh = next((body.mesh for body in bodies if body.mesh), None)
        return Compound("appearance", (list(color) if color else Atom("none"), Atom(mesh or "none")))

    def name_kinds(self, name: Value) -> Value:
        """What a name may denote: class(Iri), individual(Iri), property(Iri)."""
        text = text_of(name, "name")
        found: list[Value] = []
        for kind in (EntityType.CLASS, EntityType.INDIVIDUAL, EntityType.PROPERTY):
            is_class = bool(found)
            try:
                iri = self._simulation.knowledge.names.find(text, kind)
            except NameNotFoundError:
                continue
            except AmbiguousNameError:
                if is_class:
                    continue
                raise
            # The name of a class denotes its only member, too, which is not meant here.
            if not (is_class and local_name(iri) != local_name(text)):
                found.append(Compound(kind.value, (Atom(iri),)))
        return found

    def classes_with_word(self, word: Value) -> Value:
        """The most general classes that have individuals and a word in their name: for milk, CowsMilk."""
        knowledge, wanted = self._simulation.knowledge, str(word).lower()
        with knowledge.lock:
            reasoner = knowledge.reasoner
            used = {cls for types in reasoner.types.values() for type in types for cls in reasoner.classes.above(type)}
            named = sorted(cls for cls in used if wanted in map(str.lower, _WORD.findall(local_name(cls))))
            above = {cls: reasoner.classes.above(cls) for cls in named}
            # Of equivalent classes, which are above each other, the first is taken.
            return [
                Atom(cls)
                for at, cls in enumerate(named)
                if not any(
                    other in above[cls] and (cls not in above[other] or named.index(other) < at)
                    for other in named
                    if other != cls
                )
            ]

    # -- changes -------------------------------------------------------------------------------------------------------

    def move(self, individual: Value, position: Value, quaternion: Value) -> Value:
        """Sets the pose of a body of the running simulation; the quaternion is (w, x, y, z)."""
        scenes = self._observe().scenes
        one = self._individual(individual, scenes)
        ids = (body.id for world in self._simulation.worlds for body in world.bodies if body.iri == one)
        body = next(ids, BodyId(local_name(one)))
        pose = _pose((*_numbers(position, 3), *_numbers(quaternion, 4)))
        self._simulation.apply(SetPoses({body: pose}))
        return True

    def spawn_model(self, id: Value, cls: Value, numbers: Value) -> Value:
        """Spawns a body of a loaded map, or a new one of a class, at a pose (position, then x, y, z, w).

        Returns:
            True, or the reason why it could not be spawned.
        """
        x, y, z, *quaternion = _numbers(numbers, 7)
        pose = _pose((x, y, z, quaternion[3], *quaternion[:3]))
        name = str(id)
        worlds = self._described()
        if any(joint.id == name for world in worlds for joint in world.joints):
            return f"{name} is a joint; spawn_constraint/1 spawns joints"
        found = ((world, body) for world in worlds for body in world.bodies if body.id == name)
        world, body = next(found, (None, None))
        if world is None or body is None:
            try:
                body = self._simulation.make_body(str(cls), id=name)
            except MindstageError as error:
                return str(error)
        home = world or World(iri=Iri(namespace_of(body.iri)), name=name)
        return self._spawned(
            World(iri=home.iri, name=home.name, bodies=(msgspec.structs.replace(body, pose=pose),)), name
        )

    def spawn_constraint(self, parts: Value) -> Value:
        """Spawns a joint between two spawned bodies; `parts` is the list of the thesis's spawn_constraint/1.

        Returns:
            True, or the reason why it could not be spawned.
        """
        if not isinstance(parts, Sequence) or isinstance(parts, str) or len(parts) != _JOINT_NUMBERS:
            cause = f"it is not a list of {_JOINT_NUMBERS} parts"
            raise InvalidArgumentError("the constraint", cause=cause, remedy="give parent, child, pose and limits")
        parent, child = BodyId(str(parts[0])), BodyId(str(parts[1]))
        worlds = self._described()
        known = (
            (world, each) for world in worlds for each in world.joints if (each.parent, each.child) == (parent, child)
        )
        world, joint = next(known, (None, None))
        name = joint.id if joint else BodyId(f"{parent}_{child}_joint")
        iri = joint.iri if joint else Iri(f"http://mindstage.org/spawned.owl#{name}")
        home = world or World(iri=Iri(namespace_of(iri)), name=str(name))
        spawned = _joint(name, iri, parent, child, parts[2:])
        return self._spawned(World(iri=home.iri, name=home.name, joints=(spawned,)), name)

    def attach_models(self, parent: Value, child: Value) -> Value:
        """Attaches a body to another one, both by id; returns true, or the reason why it could not be attached.

        Maps name joints as parents, too: what a spawned joint connects needs no attachment.
        """
        worlds = self._simulation.worlds
        if any(
            str(parent) == joint.id and str(child) in (joint.parent, joint.child)
            for each in worlds
            for joint in each.joints
        ):
            return True
        try:
            self._simulation.apply(Attach(BodyId(str(parent)), BodyId(str(child))))
        except MindstageError as error:
            return str(error)
        return True

    def _spawned(self, world: World, name: str) -> Value:
        report = self._simulation.spawn(world)
        failures = (*report.failed_bodies, *report.failed_joints, *report.failed_attachments)
        return True if report.ok else "; ".join(f"{each.id}: {each.reason}" for each in failures) or f"{name} failed"

    # -- markers -------------------------------------------------------------------------------------------------------

    def add_marker(self, id: Value, kind: Value, pose: Value, size: Value, color: Value, text: Value) -> Value:
        """Adds a marker; `pose` is [Position, Quaternion (w, x, y, z)], the color [R, G, B, Opacity]."""
        try:
            marker_type = MarkerType(str(kind))
        except ValueError:
            known = ", ".join(each.value for each in MarkerType)
            raise InvalidArgumentError(f"the marker {id}", cause=f"{kind} is no type of markers: {known}") from None
        if not isinstance(pose, Sequence) or isinstance(pose, str) or len(pose) != 2:
            raise InvalidArgumentError(f"the marker {id}", cause=f"{pose!r} is no pose")
        *rgb, opacity = _numbers(color, 4)
        x, y, z = _numbers(size, 3)
        marker = Marker(
            id=str(id),
            type=marker_type,
            pose=_pose((*_numbers(pose[0], 3), *_numbers(pose[1], 4))),
            size=(x, y, z),
            color=(rgb[0], rgb[1], rgb[2]),
            opacity=opacity,
            text=str(text) if marker_type is MarkerType.TEXT else "",
            body=str(text) if marker_type is MarkerType.BODY_COPY else "",
        )
        self._simulation.markers.add((marker,))
        return True

    def remove_marker(self, id: Value) -> Value:
        """Removes a marker; returns whether it existed."""
        return bool(self._simulation.markers.remove((str(id),)))


def _with_rest(state: WorldState, maps: Iterable[World]) -> WorldState:
    """Adds the bodies and joints of maps that are spawned in part, where the maps have them, to the simulated ones."""
    spawned: dict[Iri, set[BodyId]] = {}
    for world in state.spawned:
        spawned.setdefault(world.iri, set()).update(_ids(world))
    bodies, joints = list(state.world.bodies), list(state.world.joints)
    rest = []
    for map in maps:
        known = spawned.get(map.iri)
        if known is None or known.issuperset(_ids(map)):
            continue
        bodies += (body for body in map.bodies if body.id not in known)
        joints += (joint for joint in map.joints if joint.id not in known)
        rest.append(map)
    if not rest:
        return state
    world = msgspec.structs.replace(state.world, bodies=tuple(bodies), joints=tuple(joints))
    return msgspec.structs.replace(state, world=world, spawned=(*state.spawned, *rest))


def _ids(world: World) -> Iterator[BodyId]:
    yield from (body.id for body in world.bodies)
    yield from (joint.id for joint in world.joints)


_Located = tuple[Iri, Iri, str, tuple[float, ...], Value]


def _located(scenes: Sequence[_Scene], one: Iri | None) -> Iterator[_Located]:
    for scene in scenes:
        homes = scene.state.map_of_body
        bodies = scene.bodies if one is None else [scene.bodies[scene.rows[one]]] if one in scene.rows else ()
        for body in bodies:
            pose = tuple(scene.poses[scene.rows[body.iri]].tolist())
            yield body.iri, homes[body.id], "body", pose, tuple(body.size) if body.size else Atom("none")
        joints = scene.joints.values() if one is None else [scene.joints[one]] if one in scene.joints else ()
        for joint in joints:
            row = pose_array((joint.pose,))[0]
            pose = (*row[:3].tolist(), *normalize(row[3:]).tolist())
            yield joint.iri, scene.state.world.iri, "joint", pose, Atom("none")


def _joint_type(joint: Joint) -> str:
    """KnowRob's name for a joint: what it moves along or about."""
    linear = (joint.linear.x, joint.linear.y, joint.linear.z)
    angular = (joint.angular.swing1, joint.angular.swing2, joint.angular.twist)
    slides, turns = (any(each is not AxisMotion.LOCKED for each in axes) for axes in (linear, angular))
    if slides and turns:
        return "Connection-Physical"
    return "PrismaticJoint" if slides else "HingedJoint" if turns else "Fixed"


def _pose_term(pose: tuple[float, ...]) -> Value:
    return (tuple(pose[:3]), tuple(pose[3:]))


def _pose(numbers: Sequence[float]) -> Pose:
    row = np.array(numbers, dtype=np.float64)
    length = float(np.linalg.norm(row[3:]))
    if not np.isfinite(row).all() or length < 1e-6:
        raise InvalidArgumentError("the pose", cause=f"{list(numbers)} has no direction or is not finite")
    row[3:] /= length
    return pose_from_array(row)


def _numbers(value: Any, length: int) -> tuple[float, ...]:
    """The numbers of a list.

    Raises:
        InvalidArgumentError: it is not a list of that many numbers.
    """
    is_list = isinstance(value, Sequence) and not isinstance(value, str)
    if not is_list or len(value) != length or not all(isinstance(each, int | float) for each in value):
        raise InvalidArgumentError("the list", cause=f"{value!r} is not a list of {length} numbers")
    return tuple(float(each) for each in value)


def _joint(name: BodyId, iri: Iri, parent: BodyId, child: BodyId, parts: Sequence[Value]) -> Joint:
    x, y, z, qx, qy, qz, qw = _numbers(parts[:7], 7)
    *linear, limit = _numbers(parts[7:11], 4)
    swing1, swing2, twist, swing1_limit, swing2_limit, twist_limit = _numbers(parts[14:20], 6)
    along, about = ([_motion(each) for each in axes] for axes in (linear, (swing1, swing2, twist)))
    return Joint(
        id=name,
        iri=iri,
        parent=parent,
        child=child,
        pose=_pose((x, y, z, qw, qx, qy, qz)),
        linear=LinearLimits(x=along[0], y=along[1], z=along[2], limit=limit, soft_limit=_soft_limit(parts[11:14])),
        angular=AngularLimits(
            swing1=about[0],
            swing2=about[1],
            twist=about[2],
            swing1_limit=swing1_limit,
            swing2_limit=swing2_limit,
            twist_limit=twist_limit,
            swing_soft_limit=_soft_limit(parts[20:23]),
            twist_soft_limit=_soft_limit(parts[23:26]),
        ),
    )


def _motion(number: float) -> AxisMotion:
    try:
        return AxisMotion(int(number))
    except ValueError:
        raise InvalidArgumentError("the motion", cause=f"{number:g} is not 0 (free), 1 (limited) or 2") from None


def _soft_limit(parts: Sequence[Value]) -> SoftLimit:
    stiffness, damping = _numbers(parts[1:], 2)
    return SoftLimit(enabled=str(parts[0]).lower() in {"true", "1"}, stiffness=stiffness, damping=damping)
