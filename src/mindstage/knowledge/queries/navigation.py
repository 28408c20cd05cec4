"""Questions about the floor: which way a robot can go, what blocks it, and in which rooms things are."""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from enum import StrEnum
from functools import partial

import numpy as np

from mindstage.errors import InvalidArgumentError
from mindstage.knowledge.explain import individual_text, source_text, statement_line
from mindstage.knowledge.queries.proximity import (
    PlacedBodies,
    missing_about,
    parse_numbers,
    placed_states,
    unless_bodies_are_missing,
)
from mindstage.knowledge.queries.spatial import body_claims
from mindstage.knowledge.questions import (
    AnswerRow,
    AskedArguments,
    IndividualName,
    MapName,
    MissingKnowledge,
    QuestionContext,
    StateAccess,
    WorldState,
    question,
)
from mindstage.ranges import Length
from mindstage.rdf.graphs import local_name
from mindstage.rdf.vocabulary import HAS_POSE, THING, knowrob
from mindstage.scene import Iri
from mindstage.scene.bounding_boxes import Indices, footprints
from mindstage.scene.floor_plan import FloorPath, FloorPlan, find_floor, wall_rooms
from mindstage.scene.proximity import BodyBoxes
from mindstage.scene.ray_casting import ShapeScene
from mindstage.scene.transforms import Array

__all__ = ["FloorPathRow", "ReachabilityRow", "RoomBasis", "RoomRow", "in_room", "path", "reachable"]

_RADIUS_M, _HEIGHT_M, _REACH_M = 0.3, 1.5, 0.6
_ROOM_NAMES = frozenset({"RoomInAConstruction", "Room", "DesignedRoom"})
_WALL_CLASS_NAMES = frozenset({"WallOfAConstruction", "Wall"})
_MIN_WALL_HEIGHT_M = 0.3
"""Of the lower walls in some maps only the base is described."""


@dataclass(frozen=True, slots=True)
class _Robot:
    """The robot that a question is about."""

    radius: float
    height: float
    reach: float

    @classmethod
    def from_arguments(cls, radius: float | None, height: float | None, reach: float | None) -> _Robot:
        values = {"radius": (radius, _RADIUS_M), "height": (height, _HEIGHT_M), "reach": (reach, _REACH_M)}
        found = {name: default if given is None else given for name, (given, default) in values.items()}
        for name, value in found.items():
            if not 0.0 <= value < 100.0:
                raise InvalidArgumentError(name, cause=f"{value:g} m is no {name} of a robot", remedy="from 0 to 100 m")
        return cls(**found)


class _Floor:
    """The floor plan of one state, with the ends of a way."""

    def __init__(self, state: WorldState, robot: _Robot, start: Iri | None, position: Array | None) -> None:
        self.state, self.robot = state, robot
        self.bodies = PlacedBodies.of(state)
        world = state.world
        self.scene = state.derived(_shape_scene, _moved_shape_scene)
        self.start = self._world_row(start) if start is not None else None
        placed = self.bodies.placed
        below = None
        if self.start is not None and (row := self.bodies.row_of(world.bodies[self.start].iri)) is not None:
            below = float(placed.boxes.center[row, 2])
        elif position is not None and len(position) == 3:
            below = float(position[2])
        level, floor_rows = find_floor(placed, below=below)
        floor = [state.row_of_id[placed.bodies[row].id] for row in floor_rows]
        self.ground = frozenset(floor)
        ignored = [state.row_of_id[id] for id in state.relations.enclosing_bodies]
        if self.start is not None and world.bodies[self.start].physics.is_dynamic and below is not None:
            own = self.bodies.group_of(self.bodies.row_of(world.bodies[self.start].iri) or 0)
            ignored += [row for each in own if (row := self._world_row(each)) is not None]
        self.plan = FloorPlan(
            state.rigid_groups,
            self.scene,
            radius=robot.radius,
            height=robot.height,
            level=level,
            floor=floor,
            ignored=ignored,
        )
        self._prints = footprints(self.scene.shape_boxes)
        self.position = position[:2] if position is not None else None

    def _world_row(self, iri: Iri) -> int | None:
        id = self.state.id_of_iri.get(iri)
        return None if id is None else self.state.row_of_id[id]

    def row(self, iri: Iri) -> int | None:
        """The body of an individual that has shapes."""
        row = self._world_row(iri)
        return row if row is not None and len(self.footprint(row)) else None

    def footprint(self, row: int) -> Array:
        """The footprints of the shapes of a body."""
        start, end = np.searchsorted(self.scene.owner, (row, row + 1)).tolist()
        return np.asarray(self._prints[start:end])

    def start_cells(self, *, free: bool = True) -> Indices:
        """Where the robot can stand at the start."""
        if self.position is not None:
            cell = self.plan.nearest_cell(self.position, free=free)
            return np.zeros(0, dtype=np.intp) if cell is None else np.array([cell])
        if self.start is None:
            return np.zeros(0, dtype=np.intp)
        if self.state.world.bodies[self.start].physics.is_dynamic:  # a robot: it stands where it is
            center = self.footprint(self.start).reshape(-1, 2).mean(axis=0)
            cell = self.plan.nearest_cell(center, free=free)
            if cell is not None:
                return np.array([cell])
        return self.cells_beside(self.start, free=free)

    def start_gap(self, found: FloorPath) -> float:
        """How far a way begins from the position of the start."""
        start = self.position
        if start is None and self.start is not None and self.state.world.bodies[self.start].physics.is_dynamic:
            start = self.footprint(self.start).reshape(-1, 2).mean(axis=0)
        return 0.0 if start is None else float(np.linalg.norm(found.points[0] - start))

    def cells_beside(self, row: int, *, free: bool = True) -> Indices:
        """Where the robot can stand to reach a body."""
        return self.plan.cells_near(self.footprint(row), self.robot.radius + self.robot.reach, free=free)

    def lengths(self) -> Array:
        """The length of the shortest way from the start to each body [m], in the order of the world."""
        found = np.full(len(self.state.world.bodies), np.inf)
        to_shapes = self.plan.lengths_to(self.start_cells(), self._prints, self.robot.radius + self.robot.reach)
        np.minimum.at(found, self.scene.owner, to_shapes)
        return found

    def goal_cells(self, goal: Iri | None, position: Array | None, *, free: bool = True) -> Indices:
        """Where the robot can stand at the goal."""
        if position is not None:
            cell = self.plan.nearest_cell(position[:2], free=free)
            return np.zeros(0, dtype=np.intp) if cell is None else np.array([cell])
        row = self.row(goal) if goal is not None else None
        return np.zeros(0, dtype=np.intp) if row is None else self.cells_beside(row, free=free)

    def blockers(self, goal: Iri | None, position: Array | None) -> tuple[Iri, ...]:
        """The bodies in the way, from the start to the goal."""
        starts, goals = self.start_cells(free=False), self.goal_cells(goal, position, free=False)
        rows = self.plan.blockers(starts, goals)
        return tuple(self.state.world.bodies[row].iri for row in rows)


def _shape_scene(state: WorldState) -> ShapeScene:
    return ShapeScene(state.world.bodies, state.geometry)


def _moved_shape_scene(before: ShapeScene, state: WorldState, rows: Indices) -> ShapeScene:
    return _shape_scene(state)


_KEPT_PLANS = 3
"""Number of floor plans that are kept for one state."""


class _FloorPlans:
    """The last floor plans of a state."""

    def __init__(self, state: WorldState) -> None:
        self._plans: dict[Hashable, _Floor] = {}

    def of_moved(self, state: WorldState, rows: Indices) -> _FloorPlans:
        """Those of a later state: none."""
        return _FloorPlans(state)

    def plan(self, key: Hashable, make: Callable[[], _Floor]) -> _Floor:
        """The plan for a robot and a start."""
        plan = self._plans.get(key) or make()
        self._plans = dict([*self._plans.items()][-_KEPT_PLANS:]) | {key: plan}
        return plan


def _position(text: str | None, name: str) -> Array | None:
    return None if text is None else np.array(parse_numbers(text, name, (2, 3)))


def _floors(
    present: StateAccess, map: Iri | None, robot: _Robot, start: Iri | None, start_position: str | None
) -> Iterator[_Floor]:
    """The floor plans of the states that have the start."""
    position = _position(start_position, "start_position")
    for state in present.states(map):
        if position is not None or start in state.id_of_iri:
            plans = state.derived(_FloorPlans, _FloorPlans.of_moved)
            yield plans.plan((robot, start, start_position), partial(_Floor, state, robot, start, position))


# -- paths -------------------------------------------------------------------------------------------------------------


class FloorPathRow(AnswerRow, frozen=True, kw_only=True):
    """A way on the floor."""

    start: IndividualName | None
    """None for a position."""
    goal: IndividualName | None
    """None for a position."""
    length: float
    """[m]."""
    clearance: float | None
    """The smallest free distance beside the robot on the way [m]; None if there are no obstacles."""
    points: tuple[tuple[float, float], ...]
    """The corners of the way of the robot's center, x and y in the map's frame [m]."""
    level: float
    """Height of the floor [m]."""
    radius: float
    """Radius of the robot [m]."""
    cell: float
    """Resolution of the floor plan [m]."""
    start_gap: float
    """Distance of the given position, or of a dynamic start, to the first point of the way [m]; else 0."""
    map: MapName
    source: str
    """Where the poses and shapes come from: the name of the engine, or "map, bounding boxes"."""


@question(
    needs="start or start_position, and goal or goal_position: all ways are not listed",
    sentences=(
        "how do i get from {start} to {goal} [with [a] radius [of] {radius}]",
        "what is the [shortest] (way|path) from {start} to {goal} [with [a] radius [of] {radius}]",
        "can (i|robot) (go|drive|get) from {start} to {goal} [with [a] radius [of] {radius}]",
        "what (blocks|is in) the way from {start} to {goal}",
        "what is the [shortest] (way|path) from the position {start_position} to {goal}",
    ),
)
def path(
    kb: QuestionContext,
    start: IndividualName | None = None,
    goal: IndividualName | None = None,
    map: MapName | None = None,
    radius: Length | None = None,
    height: Length | None = None,
    reach: Length | None = None,
    start_position: str | None = None,
    goal_position: str | None = None,
    *,
    present: StateAccess,
) -> Iterator[FloorPathRow]:
    """The shortest way of a robot on the floor, with its length and clearance; without one, what blocks it.

    Each end is a body or a position "x y" [m]. The robot is a disc of `radius` (0.3 m if it is left out) and `height`
    (1.5 m): obstacles are the footprints of all collision shapes between 0.03 m above the floor and its height, or the
    bounding boxes of bodies where no simulation has shapes. At a body it stands at most `reach` (0.6 m) from the body's
    footprint; a dynamic start is the robot itself, which is no obstacle. The floor is the highest level slab of at
    least 4 m² below the start, or else the plane at the lowest point of all bodies, with 1 m around them.

    The way is the shortest on a grid of 0.05 m with eight neighbors (Dijkstra), shortened by straight lines. It keeps
    the robot's radius from every footprint; passages that are less than 2 mm wider than the robot may be missed.

    Examples:
        path chair_1 fridge radius=0.2
        path start_position='1.5 0' goal=oven radius=0.2
    """
    robot, end = _Robot.from_arguments(radius, height, reach), _position(goal_position, "goal_position")
    for floor in _floors(present, map, robot, start, start_position):
        found = floor.plan.path(floor.start_cells(), floor.goal_cells(goal, end))
        if found is not None:
            yield _path_row(floor, found, start, goal if end is None else None)


def _path_row(floor: _Floor, found: FloorPath, start: Iri | None, goal: Iri | None) -> FloorPathRow:
    points = tuple((round(x, 6), round(y, 6)) for x, y in found.points.tolist())
    return FloorPathRow(
        start=start if floor.position is None else None,
        goal=goal,
        length=round(found.length, 6),
        clearance=round(found.clearance, 6) if np.isfinite(found.clearance) else None,
        points=points,
        level=round(floor.plan.level, 6),
        radius=floor.robot.radius,
        cell=round(floor.plan.cell, 6),
        start_gap=round(floor.start_gap(found), 6),
        map=floor.state.spawned[0].iri if floor.state.spawned else floor.state.world.iri,
        source=floor.state.shape_source,
    )


@path.explain
def _explain_path(kb: QuestionContext, row: FloorPathRow) -> Iterator[str]:
    yield f"{row.length:g} m by {len(row.points)} points on the floor at {row.level:g} m, with {row.radius:g} m radius"
    free = "there are no obstacles" if row.clearance is None else f"at least {row.clearance:g} m are free beside it"
    yield f"{free}; cells of {row.cell:g} m"
    if row.start_gap > row.cell:
        yield f"the way begins {row.start_gap:g} m from the start, where the robot has room"
    yield source_text(row.source)


@path.missing
@unless_bodies_are_missing("start", "goal")
def _missing_path(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    robot, end = (
        _Robot.from_arguments(*(asked.plain(each, float) for each in ("radius", "height", "reach"))),
        _position(asked.goal_position, "goal_position"),
    )
    for floor in _floors(asked.present, asked.map, robot, asked.start, asked.start_position):
        blockers = floor.blockers(asked.goal, end)
        cls = kb.reasoner.class_of(blockers[0]) if blockers else None
        claims = body_claims((asked.start, asked.goal, *blockers), asked.present.states(asked.map), asked.map)
        yield MissingKnowledge(cls or THING, HAS_POSE, _blocked_text(floor, blockers, asked.goal), claims=claims)


def _blocked_text(floor: _Floor, blockers: Sequence[Iri], goal: Iri | None) -> str:
    to = f"to {local_name(goal)}" if goal is not None else "to the position"
    robot = f"a robot of {floor.robot.radius:g} m radius"
    if blockers:
        return f"no way {to} for {robot}: {', '.join(map(local_name, blockers))} in the way"
    return f"no way {to} for {robot}: an end is not on the floor at {floor.plan.level:g} m, or the floor has a gap"


class ReachabilityRow(AnswerRow, frozen=True, kw_only=True):
    """Whether a robot can go to a body."""

    start: IndividualName | None
    """None for a position."""
    goal: IndividualName
    reachable: bool
    length: float | None
    """Length of the shortest way on the grid [m]; None if there is none."""
    blocked_by: tuple[IndividualName, ...]
    """The bodies in the way, movable ones preferred; empty if there is a way, or no floor."""
    map: MapName
    source: str
    """Where the poses and shapes come from: the name of the engine, or "map, bounding boxes"."""


@question(
    needs="start or start_position: a way begins somewhere",
    sentences=(
        "what can (i|robot) reach from {start} {reachable=true}",
        "what is reachable from {start} {reachable=true}",
        "what is not reachable from {start} {reachable=false}",
        "is {goal} reachable from {start}",
        "can (i|robot) reach {goal} from {start}",
        "(what|which things) can be reached from {start} {reachable=true}",
    ),
)
def reachable(
    kb: QuestionContext,
    start: IndividualName | None = None,
    goal: IndividualName | None = None,
    reachable: bool | None = None,
    map: MapName | None = None,
    radius: Length | None = None,
    height: Length | None = None,
    reach: Length | None = None,
    start_position: str | None = None,
    *,
    present: StateAccess,
) -> Iterator[ReachabilityRow]:
    """Which bodies a robot can go to from a start, and what blocks the way to the others; the nearest first.

    Definitions and defaults are those of the question `path`. A body is reachable if the robot can stand at most
    `reach` from its footprint, at any height: whether an arm gets to it is not asked here. What blocks a way is
    computed for a given `goal` only.

    Examples:
        reachable start_position='1.5 0' goal=fridge radius=0.2
        reachable chair_1 reachable=true radius=0.2
    """
    robot = _Robot.from_arguments(radius, height, reach)
    for floor in _floors(present, map, robot, start, start_position):
        lengths, skipped = floor.lengths().tolist(), {floor.start, *floor.ground}
        rows = [
            (lengths[row], row)
            for row, body in enumerate(floor.state.world.bodies)
            if goal in {None, body.iri} and row not in skipped and floor.row(body.iri) == row
        ]
        for way, row in sorted(rows):
            body = floor.state.world.bodies[row]
            is_open = bool(np.isfinite(way))
            yield ReachabilityRow(
                start=start if start_position is None else None,
                goal=body.iri,
                reachable=is_open,
                length=round(way, 6) if is_open else None,
                blocked_by=() if is_open or goal is None else floor.blockers(body.iri, None),
                map=floor.state.map_of_body[body.id],
                source=floor.state.shape_source,
            )


@reachable.explain
def _explain_reachable(kb: QuestionContext, row: ReachabilityRow) -> Iterator[str]:
    if row.reachable:
        yield f"a way of {row.length:g} m leads to {local_name(row.goal)}"
    elif row.blocked_by:
        yield f"{', '.join(map(local_name, row.blocked_by))} in the way to {local_name(row.goal)}"
    else:
        yield f"no way leads to {local_name(row.goal)}; ask for it alone to see what blocks it"
    yield source_text(row.source)


@reachable.missing
@unless_bodies_are_missing("start", "goal")
def _missing_reachable(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    wanted = asked.plain("reachable", bool)
    if asked.goal is not None and wanted:
        yield from _missing_path(kb, asked)
    elif asked.goal is not None and wanted is False:
        reason = f"{individual_text(kb.reasoner, asked.goal)} is reachable: ask for the path"
        yield missing_about(kb, asked.goal, reason, asked.start, present=asked.present, map=asked.map)


# -- rooms -------------------------------------------------------------------------------------------------------------


class RoomBasis(StrEnum):
    """How the room of a thing is determined."""

    STATED = "stated"
    """The map states that the thing is a part of the room, or in it."""
    BOX = "box"
    """The center of the thing is in the box of an individual of a class of rooms."""
    ENCLOSURE = "enclosure"
    """The center of the thing is in the box of a body that encloses all others, such as the walls as one body."""
    WALLS = "walls"
    """The center of the thing is in a region that the footprints of walls surround."""


class RoomRow(AnswerRow, frozen=True, kw_only=True):
    """The room of a thing."""

    thing: IndividualName
    room: IndividualName | None
    """The individual that is the room; None for a region that walls surround."""
    region: str
    """The name of the room; regions within walls are "room 1" and so on, in decreasing order of their areas."""
    basis: RoomBasis
    area: float | None
    """Area of the floor [m²]; None where it is unknown."""
    walls: tuple[IndividualName, ...]
    """The walls around a region."""
    map: MapName
    source: str
    """Where the poses come from: the name of the engine, or "map"."""


@question(
    sentences=(
        "(which|what) room is {thing} in",
        "in which room is {thing}",
        "(which|what) room (has|contains) {thing}",
        "what is in {room:RoomInAConstruction,Room}",
        "what is in the region {region}",
        "is {thing} in {room:RoomInAConstruction,Room}",
        "which {thing} is in {room:RoomInAConstruction,Room}",
    )
)
def in_room(
    kb: QuestionContext,
    thing: IndividualName | None = None,
    room: IndividualName | None = None,
    region: str | None = None,
    map: MapName | None = None,
    *,
    present: StateAccess,
) -> Iterator[RoomRow]:
    """Which room a thing is in, and what is in a room.

    Rooms are, in this order: individuals of a class of rooms (knowrob:RoomInAConstruction, or a class named Room) that
    the thing is stated to be a part of, or whose box contains its center; a body that encloses all others; or the
    regions that walls surround. Only the first kind that a map has is used. For regions, gaps of less than 1.3 m
    between walls are doors (morphological segmentation, Bormann et al. 2016); walls are of a class of walls
    (WallOfAConstruction, or a class named Wall) and at least 0.3 m high. Answers are sorted by the region, then by the
    name of the thing; the walls of a region by their names.

    Examples:
        in_room milk_carton_1
        in_room region='room 1'
    """
    for bodies in placed_states(present, map):
        yield from _rooms_in(kb, bodies, thing)


def _rooms_in(kb: QuestionContext, bodies: PlacedBodies, thing: Iri | None) -> Iterator[RoomRow]:
    rooms = bodies.rows_of_classes(lambda cls: _is_named(kb, cls, _ROOM_NAMES))
    asked = None if thing is None else bodies.row_of(thing)
    if thing is not None and asked is None:
        return
    only = range(len(bodies.placed.bodies)) if asked is None else [asked]
    stated_rooms = {
        member for name in _ROOM_NAMES for cls in _classes_named(kb, name) for member in kb.reasoner.members(cls)
    }
    if rooms or stated_rooms:  # without rooms with boxes, one that anything is stated to be in decides
        found = list(_individual_rooms(kb, bodies, rooms, stated_rooms, only if rooms else None))
        is_decided = bool(rooms or found)
    else:
        found, is_decided = [], False
    if not is_decided:
        kind = _enclosing_rooms if bodies.state.relations.enclosing_bodies else partial(_walled_rooms, kb)
        found = list(kind(bodies, only))
    found.sort(key=lambda row: (len(row.region), row.region, row.thing))
    yield from (row for row in found if thing in {None, row.thing})


def _is_named(kb: QuestionContext, cls: Iri, names: frozenset[str]) -> bool:
    known: dict[Iri, bool] = kb.cached(("is named", names), dict)
    if cls not in known:
        known[cls] = any(local_name(above) in names for above in (cls, *kb.reasoner.classes.above(cls)))
    return known[cls]


def _room_row(bodies: PlacedBodies, row: int, basis: RoomBasis, **fields: object) -> RoomRow:
    defaults: dict[str, object] = {"room": None, "area": None, "walls": ()}
    return RoomRow(
        thing=bodies.iri(row),
        basis=basis,
        map=bodies.map(row),
        source=bodies.state.source,
        **(defaults | fields),  # type: ignore[arg-type]
    )


def _individual_rooms(
    kb: QuestionContext,
    bodies: PlacedBodies,
    room_rows: Collection[int],
    stated_rooms: Set[Iri],
    only: Sequence[int] | None,
) -> Iterator[RoomRow]:
    """Rooms that are individuals: stated first, then by their boxes; the smallest of several."""
    placed, is_room = bodies.placed, set(room_rows)
    rooms = {row: bodies.iri(row) for row in room_rows if placed.bodies[row].size is not None}
    sizes = {row: float(np.prod(2 * placed.boxes.half_extents[row])) for row in rooms}
    order = sorted(rooms, key=lambda row: (sizes[row], row))
    inside = {row: _contains_points(placed, row, placed.boxes.center) for row in order}
    for row in range(len(placed.bodies)) if only is None else only:
        if row in is_room:
            continue
        stated = next(
            (step.individual for step in kb.reasoner.wholes(bodies.iri(row)) if step.individual in stated_rooms), None
        )
        if stated is not None:
            yield _room_row(bodies, row, RoomBasis.STATED, room=stated, region=local_name(stated))
            continue
        holder = next((room for room in order if inside[room][row]), None)
        if holder is not None:
            x, y, _ = (2 * placed.boxes.half_extents[holder]).tolist()
            area = round(x * y, 6)
            yield _room_row(bodies, row, RoomBasis.BOX, room=rooms[holder], region=local_name(rooms[holder]), area=area)


def _classes_named(kb: QuestionContext, name: str) -> list[Iri]:
    def by_name() -> Mapping[str, list[Iri]]:
        found: dict[str, list[Iri]] = {}
        for cls in kb.reasoner.declared_classes():
            found.setdefault(local_name(cls), []).append(cls)
        return found

    return kb.cached("classes by local name", by_name).get(name, [])


def _contains_points(placed: BodyBoxes, row: int, points: Array) -> Array:
    local = (points - placed.boxes.center[row]) @ placed.boxes.rotation[row]
    return np.asarray(np.all(np.abs(local) <= placed.boxes.half_extents[row] + 1e-9, axis=1))


def _enclosing_rooms(bodies: PlacedBodies, only: Sequence[int]) -> Iterator[RoomRow]:
    placed = bodies.placed
    rows = [placed.row_by_id[id] for id in bodies.state.relations.enclosing_bodies]
    rows.sort(key=lambda row: (float(np.prod(placed.boxes.half_extents[row])), row))
    inside = {row: _contains_points(placed, row, placed.boxes.center) for row in rows}
    for row in only:
        holder = next((each for each in rows if inside[each][row] and each != row), None)
        if holder is not None and row not in rows:
            x, y, _ = (2 * placed.boxes.half_extents[holder]).tolist()
            iri = bodies.iri(holder)
            yield _room_row(bodies, row, RoomBasis.ENCLOSURE, room=iri, region=local_name(iri), area=round(x * y, 6))


def _walled_rooms(kb: QuestionContext, bodies: PlacedBodies, only: Sequence[int]) -> Iterator[RoomRow]:
    placed = bodies.placed
    height = placed.high[:, 2] - placed.low[:, 2]
    of_walls = bodies.rows_of_classes(lambda cls: _is_named(kb, cls, _WALL_CLASS_NAMES))
    walls = [row for row in of_walls if placed.bodies[row].size is not None and height[row] >= _MIN_WALL_HEIGHT_M]
    rooms, is_wall = wall_rooms(footprints(placed.boxes.rows(np.array(walls, dtype=np.intp)))), set(walls)
    numbers = rooms.room_at(placed.boxes.center[list(only), :2])
    for row, number in zip(only, numbers.tolist(), strict=True):
        if number and row not in is_wall:
            around = tuple(sorted(bodies.iri(walls[each]) for each in rooms.walls[number - 1]))
            area = round(rooms.areas[number - 1], 2)
            yield _room_row(bodies, row, RoomBasis.WALLS, region=f"room {number}", area=area, walls=around)


@in_room.explain
def _explain_room(kb: QuestionContext, row: RoomRow) -> Iterator[str]:
    thing = local_name(row.thing)
    match row.basis:
        case RoomBasis.STATED:
            for step in kb.reasoner.wholes(row.thing):
                if step.individual == row.room:
                    yield from map(statement_line, step.path)
        case RoomBasis.BOX:
            yield f"the center of {thing} is in the box of {row.region}, which is a room"
        case RoomBasis.ENCLOSURE:
            yield f"the center of {thing} is in the box of {row.region}, which encloses everything else"
        case RoomBasis.WALLS:
            yield f"{thing} is in a region of {row.area:g} m² within {', '.join(map(local_name, row.walls))}"
    yield source_text(row.source)


@in_room.missing
@unless_bodies_are_missing("thing")
def _missing_room(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    rows = [row for bodies in placed_states(asked.present, asked.map) for row in _rooms_in(kb, bodies, asked.thing)]
    claims = body_claims((asked.thing, asked.room), asked.present.states(asked.map), asked.map)
    if not rows:
        what = individual_text(kb.reasoner, asked.thing) if asked.thing is not None else "nothing"
        reason = f"{what} is in no room: no individual of a class of rooms, enclosing body or walls surround it"
        yield MissingKnowledge(knowrob("RoomInAConstruction"), HAS_POSE, reason, claims=claims)
    elif asked.thing is not None:
        yield MissingKnowledge(THING, HAS_POSE, f"{local_name(asked.thing)} is in {rows[0].region}", claims=claims)
    else:
        wanted = local_name(asked.room) if asked.room is not None else asked.region
        regions = ", ".join(sorted({row.region for row in rows}))
        yield MissingKnowledge(THING, HAS_POSE, f"nothing is in {wanted}: there is {regions}", claims=claims)
