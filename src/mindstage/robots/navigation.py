"""Ways of a robot's base on the floor.

The way is found on the grid of `scene.floor_plan`, for a disc that contains the base. Then the whole robot, with its
arms and what it holds, is tested along the way. Where the disc has no way, or the rest of the robot would touch
something, OMPL searches in positions and headings of the whole robot.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import cached_property
from itertools import pairwise
from math import atan2, ceil, hypot
from typing import Any

import numpy as np
from msgspec.structs import replace

from mindstage.errors import InvalidArgumentError, UnreachableError
from mindstage.ranges import Finite, Index, Length, Point, Seed, WallTime, checked
from mindstage.robots.base_motion import differential_path
from mindstage.robots.collisions import CollisionChecker
from mindstage.robots.floor_poses import BasePose, wrapped
from mindstage.robots.models.robot_model import BaseType
from mindstage.robots.planning import load_ompl, termination
from mindstage.robots.robot import Robot
from mindstage.robots.search_limits import CPU_S, SearchLimit
from mindstage.scene import BodyId, PoseLike
from mindstage.scene.bounding_boxes import Indices
from mindstage.scene.floor_plan import FloorPlan, find_floor
from mindstage.scene.joint_kinematics import RigidGroups
from mindstage.scene.proximity import BodyBoxes
from mindstage.scene.ray_casting import ShapeScene
from mindstage.scene.spatial import SpatialRelations
from mindstage.scene.transforms import Array

__all__ = ["BasePath", "FloorMap", "plan_base"]

BasePath = tuple[BasePose, ...]
"""Poses of the base in the world frame: x, y [m], yaw [rad]."""

_MARGIN_M = 0.01
"""Added to the radius of the base."""
_CLEARANCE_M, _NARROW_CLEARANCE_M = 0.01, 0.004
"""Distance that the whole robot keeps from the place while it drives [m]; the second one on a way that begins where the
disc around its base has no room, as behind a door that it has opened."""
_STEP_M, _STEP_RAD = 0.04, 0.1
"""Distance between two poses that are tested."""
_CORNER_M = 0.3
"""Largest distance from a corner at which its rounding begins [m]."""
_CORNER_POINTS = 7
"""Number of points of a rounded corner."""
_START_M = 1.0
"""Where the disc has no room around the base, ways begin at the free cells that are so near: the base itself, which is
smaller than the disc, may get there, which `plan_base` tests."""
_NEAR_CELLS = 1.6
"""A place is reachable if a free cell is so near, in cells."""
_TURN_M = 0.15
"""Length of an arc by which OMPL turns a differential base [m]."""
_NO_WAY_TESTS = 12_000
"""Number of poses that the search tests where the disc has no way at all."""
_SHORTCUT_TESTS = 1500
"""Number of poses that are tested for shortcuts after a path was found."""


class FloorMap:
    """Where the base of a robot can stand, and which way leads there; a copy of the present state."""

    def __init__(
        self,
        robot: Robot,
        *,
        ignore: Collection[BodyId] = (),
        moved: Mapping[BodyId, PoseLike] | None = None,
        start: BasePose | None = None,
    ) -> None:
        """Computes the free floor for a disc around the base.

        Args:
            ignore: bodies that are no obstacles.
            moved: poses of bodies that are to be somewhere else than now, such as a door that will be open.
            start: where the base is to be: x, y [m] and yaw [rad] in the world frame; None for where it is now.
        """
        self.robot = robot
        session, base = robot.session, robot.model.base
        world, geometry = session.snapshot(), session.geometry
        own = {*robot.placed.link_ids.values(), *robot.held.values(), *(body.id for body in robot.placed.world.bodies)}
        bottom = float(robot.link_pose(base.link)[2]) - base.height_m
        if moved:
            placed = [replace(body, pose=moved.get(body.id, body.pose)) for body in world.bodies]
            world = replace(world, bodies=tuple(placed))
        bodies = world.bodies
        scene = ShapeScene(bodies, geometry)
        owned = np.isin(scene.owner, [row for row, body in enumerate(bodies) if body.id in own])
        low, high = scene.shape_boxes.bounds()
        self.height_m = float(high[owned, 2].max(initial=bottom + 0.3)) - bottom
        self.radius_m = base.radius_m or _radius(low[owned], high[owned], robot.base_pose())
        others = BodyBoxes.from_bodies([body for body in bodies if body.id not in own])
        level, floor = find_floor(others, below=bottom)
        slabs = {others.bodies[row].id for row in floor}
        left_out = own | set(ignore) | set(SpatialRelations(world).enclosing_bodies)
        self._ids = tuple(body.id for body in bodies)
        self.plan = FloorPlan(
            RigidGroups.from_world(world),
            scene,
            radius=self.radius_m + _MARGIN_M,
            height=self.height_m,
            level=level,
            floor=[row for row, body in enumerate(bodies) if body.id in slabs],
            ignored=[row for row, body in enumerate(bodies) if body.id in left_out],
        )
        self.start = start or robot.base_pose()
        self._has_floor = bool(slabs)

    def is_floor(self, x: float, y: float) -> bool:
        """Whether there is floor at a place [m]; everywhere, if the world has no body that is the floor."""
        if not self._has_floor:
            return True
        cell = self.plan.nearest_cell(np.array([x, y]), free=False)
        return cell is not None and bool(self.plan.is_floor.reshape(-1)[cell])

    @cached_property
    def lengths(self) -> Array:
        """The length of the shortest way from the base to each cell of the grid, flat [m]; infinite without one."""
        return self.plan.lengths(self._start_cells)

    def is_reachable(self, x: float, y: float) -> bool:
        """Whether the base can drive to a place [m], or to one that is nearer to it than a cell of the grid."""
        return self.length_to(x, y) is not None

    def length_to(self, x: float, y: float) -> float | None:
        """The length of the shortest way to a place [m]; None without one."""
        lengths = self.lengths[self._near(x, y)]
        best = float(lengths.min(initial=np.inf))
        return best if np.isfinite(best) else None

    def corners(self, x: float, y: float) -> Array | None:
        """The corners of the shortest way from the base to a place, n x 2 [m]; None without one."""
        goals = self._near(x, y)
        goals = goals[np.isfinite(self.lengths[goals])]
        if not len(goals):
            return None
        centers = self.plan.centers(goals)
        nearest = goals[np.argmin(np.hypot(*(centers - (x, y)).T))]
        found = self.plan.path(self._start_cells, np.array([nearest]))
        if found is None:
            return None
        return np.vstack([self.start[:2], found.points, (x, y)])

    def blockers(self, x: float, y: float) -> tuple[BodyId, ...]:
        """The bodies on the easiest way to a place, if there is no free one; movable ones are easier than others."""
        ends = [self.plan.nearest_cell(np.array(point), free=False) for point in (self.start[:2], (x, y))]
        cells = [np.array([] if cell is None else [cell], dtype=np.intp) for cell in ends]
        return tuple(self._ids[row] for row in self.plan.blockers(cells[0], cells[1]))

    @cached_property
    def _start_cells(self) -> Indices:
        """The free cells at which ways begin."""
        point = np.array(self.start[:2])
        cell = self.plan.nearest_cell(point, free=True)
        return self.plan.cells_near(np.tile(point, (1, 6, 1)), _START_M) if cell is None else np.array([cell], np.intp)

    def _near(self, x: float, y: float) -> Indices:
        """The free cells whose centers are near a point."""
        point = np.tile(np.array([x, y]), (1, 6, 1))
        return self.plan.cells_near(point, _NEAR_CELLS * self.plan.cell)


def _radius(low: Array, high: Array, base: BasePose) -> float:
    """The radius about the base that contains some boxes [m]."""
    far = np.maximum(np.abs(low[:, :2] - base[:2]), np.abs(high[:, :2] - base[:2]))
    return float(np.hypot(far[:, 0], far[:, 1]).max(initial=0.3))


@checked
def plan_base(
    robot: Robot,
    goal: Point,
    *,
    ignore: Collection[BodyId] = (),
    clearance_m: Length | None = None,
    max_tests: Index = 40_000,
    cpu_s: WallTime = CPU_S,
    part_of: SearchLimit | None = None,
    floor: FloorMap | None = None,
    joints: Mapping[BodyId, Finite] | None = None,
    seed: Seed = 1,
) -> BasePath:
    """Plans a way of the base around all obstacles.

    Args:
        robot: the robot; its arms stay as they are, so that it is best to fold them before.
        goal: x, y [m] and yaw [rad] of the base in the world frame.
        ignore: bodies that are no obstacles.
        clearance_m: the distance that the whole robot keeps from the place [m]; None for 1 cm, or 4 mm if it
            begins in a narrow place.
        max_tests: number of poses that are tested for collisions before the search ends; 0 for a straight way only.
        cpu_s: processor time after which it ends in any case [s].
        part_of: the limit of a larger search, in which the tests count, too.
        floor: the free floor without `ignore`, if it is known; the way begins at its start.
        joints: positions of joints of the place that are to be somewhere else than now; see
            `CollisionChecker.set_joint`.
        seed: of the random numbers; the same one gives the same path.

    Returns:
        The poses after the present one, the goal last; between them a planar base moves straight while it turns evenly,
        and a differential one turns, drives and turns.

    Raises:
        InvalidArgumentError: the base is fixed.
        UnreachableError: there is no way, or not room enough at the goal; with what is in the way.
    """
    if robot.model.base.type is BaseType.FIXED:
        cause, remedy = f"the base of {robot.name} is fixed", "use a robot that drives"
        raise InvalidArgumentError("goal", cause=cause, remedy=remedy)
    limit = SearchLimit(max_tests, cpu_s=cpu_s, part_of=part_of)
    floor = floor or FloorMap(robot, ignore=ignore)
    if clearance_m is None:
        clearance_m = _CLEARANCE_M if floor.is_reachable(*floor.start[:2]) else _NARROW_CLEARANCE_M
    way = _Way(robot, goal, ignore, clearance_m, floor, limit)
    for joint, position in (joints or {}).items():
        way.checker.set_joint(joint, position)
    way.check_goal()
    if way.first_obstacle([way.goal]) is None:
        return (way.goal,)
    corners = way.floor.corners(goal[0], goal[1])
    blocked: tuple[str, BodyId | None] | None = None
    if corners is not None:
        for path in way.candidates(corners):
            found = way.first_obstacle(path)
            if found is None:
                return tuple(path)
            blocked = blocked or found
    else:
        limit.steps = min(max_tests, limit.done + _NO_WAY_TESTS)
    if (searched := _search(way, limit, seed)) is not None:
        return searched
    if limit.ended_by_time:
        raise way.unreachable(f"no way was found {limit}")
    names = way.floor.blockers(goal[0], goal[1]) if corners is None else ()
    if names:
        raise way.unreachable(f"{', '.join(names)} in the way of its base", names[0])
    if blocked is not None:
        raise way.unreachable(f"on the way {blocked[0]}", blocked[1])
    raise way.unreachable("no part of the floor leads there")


class _Way:
    """The task of driving to a goal."""

    def __init__(
        self,
        robot: Robot,
        goal: BasePose,
        ignore: Collection[BodyId],
        clearance_m: float,
        floor: FloorMap,
        limit: SearchLimit,
    ) -> None:
        self.robot, self.floor, self.limit = robot, floor, limit
        self.start = floor.start
        self.goal = (float(goal[0]), float(goal[1]), self.start[2] + wrapped(goal[2] - self.start[2]))
        self.is_differential = robot.model.base.type is BaseType.DIFFERENTIAL
        self.checker = CollisionChecker(robot, joints=(), base_moves=True, ignore=ignore, clearance_m=clearance_m)

    def check_goal(self) -> None:
        """Checks that the base can stand at the goal.

        Raises:
            UnreachableError: it cannot; with what is there.
        """
        if (found := self.obstacle_at(self.goal)) is not None:
            raise self.unreachable(f"there {found[0]}", found[1])

    def obstacle_at(self, pose: BasePose) -> tuple[str, BodyId | None] | None:
        """Why the robot cannot be at a pose, and the body that is there; None if it can."""
        if not self.floor.is_floor(pose[0], pose[1]):
            return "is no floor", None
        self.limit.count()
        collision = self.checker.find((), pose)
        return None if collision is None else (str(collision), collision.obstacle)

    def unreachable(self, reason: str, obstacle: BodyId | None = None) -> UnreachableError:
        x, y, yaw = self.goal
        return UnreachableError(
            self.robot.name, target=f"({x:.2f}, {y:.2f}, {yaw:.2f})", reason=reason, obstacle=obstacle
        )

    def first_obstacle(self, path: Sequence[BasePose]) -> tuple[str, BodyId | None] | None:
        """The first obstacle on a path from the start; see `obstacle_at`."""
        for a, b in pairwise([self.start, *path]):
            for pose in self._between(a, b):
                if (found := self.obstacle_at(pose)) is not None:
                    return found
        return None

    def _between(self, a: BasePose, b: BasePose) -> Iterator[BasePose]:
        """The poses between two poses of a path, without the first one."""
        ends = differential_path([np.array(a), np.array(b)]) if self.is_differential else [np.array(a), np.array(b)]
        for start, end in pairwise(ends):
            x, y, yaw = end - start
            count = max(1, ceil(max(hypot(x, y) / _STEP_M, abs(yaw) / _STEP_RAD)))
            yield from map(tuple, np.linspace(start, end, count + 1)[1:].tolist())

    def candidates(self, corners: Array) -> Iterator[list[BasePose]]:
        """Paths along corners, with different headings."""
        without_cells = np.vstack([corners[:1], corners[2:-2], corners[-1:]])  # of the ends, which are near cells
        variants = [_distinct(each) for each in (without_cells, corners)]
        if len(variants[-1]) < 2:
            yield [self.goal]
            return
        for points in (shape for each in variants if len(each) > 1 for shape in (self._rounded(each), each)):
            steps = np.diff(points, axis=0)
            lengths = np.hypot(steps[:, 0], steps[:, 1])
            headings = np.arctan2(steps[:, 1], steps[:, 0])
            if self.is_differential:
                yield self._path(points, headings)
                continue
            share = np.cumsum(lengths) / lengths.sum()
            turn = wrapped(self.goal[2] - self.start[2])
            yield self._path(points, self.start[2] + share * turn)
            yield self._path(points, headings)
            yield self._path(points, np.full(len(steps), self.start[2]))
            yield self._path(points, np.full(len(steps), self.goal[2]), turn_first=True)

    def _path(self, points: Array, yaws: Array, *, turn_first: bool = False) -> list[BasePose]:
        path = [(self.start[0], self.start[1], float(yaws[0]))] if turn_first else []
        before = self.start[2]
        for (x, y), yaw in zip(points[1:].tolist(), yaws.tolist(), strict=True):
            before += wrapped(yaw - before)
            path.append((x, y, before))
        last = before + wrapped(self.goal[2] - before)
        if abs(last - before) > 1e-6:
            path.append((self.goal[0], self.goal[1], last))
        return path

    def _rounded(self, corners: Array) -> Array:
        """The corners replaced by parabolas, as far as the base has room on them."""
        steps = np.diff(corners, axis=0)
        lengths = np.hypot(steps[:, 0], steps[:, 1])
        points = [corners[:1]]
        for number in range(1, len(corners) - 1):
            corner, radius = corners[number], min(_CORNER_M, 0.45 * float(lengths[number - 1 : number + 1].min()))
            before, after = steps[number - 1] / lengths[number - 1], steps[number] / lengths[number]
            if before @ after > 0.999:
                points.append(corner[None])
                continue
            share = np.linspace(0.0, 1.0, _CORNER_POINTS)[:, None]
            while True:
                arc = corner - radius * before * (1 - share) ** 2 + radius * after * share**2
                if radius < 0.02:
                    arc = corner[None]
                    break
                yaw = atan2(before[1], before[0]) if self.is_differential else self.start[2]
                if all(self.obstacle_at((x, y, yaw)) is None for x, y in arc.tolist()):
                    break
                radius /= 2
            points.append(arc)
        points.append(corners[-1:])
        return np.vstack(points)


def _search(way: _Way, limit: SearchLimit, seed: int) -> BasePath | None:
    """A path of the whole robot in positions and headings, by RRT-Connect; None if none was found."""
    ompl = load_ompl(seed)
    space: Any = ompl.base.ReedsSheppStateSpace(_TURN_M) if way.is_differential else ompl.base.SE2StateSpace()
    bounds = ompl.base.RealVectorBounds(2)
    floor = np.array([way.start[:2], way.goal[:2]])
    for row in range(2):
        bounds.setLow(row, float(floor[:, row].min()) - 3.0)
        bounds.setHigh(row, float(floor[:, row].max()) + 3.0)
    space.setBounds(bounds)
    setup = ompl.geometric.SimpleSetup(space)

    def pose_of(state: Any) -> BasePose:
        return state.getX(), state.getY(), state.getYaw()

    def is_valid(state: Any) -> bool:
        return way.obstacle_at(pose_of(state)) is None

    setup.setStateValidityChecker(is_valid)
    setup.getSpaceInformation().setStateValidityCheckingResolution(_STEP_M / space.getMaximumExtent())
    ends = []
    for pose in (way.start, way.goal):
        state = space.allocState()
        state.setX(pose[0])
        state.setY(pose[1])
        state.setYaw(wrapped(pose[2]))
        ends.append(state)
    setup.setStartAndGoalStates(*ends)
    planner = ompl.geometric.RRTConnect(setup.getSpaceInformation())
    planner.setRange(0.7)
    setup.setPlanner(planner)
    setup.solve(termination(limit))
    if not setup.haveExactSolutionPath():
        return None
    limit.extend(_SHORTCUT_TESTS)
    setup.simplifySolution(termination(limit, limit.done + _SHORTCUT_TESTS))
    path = setup.getSolutionPath()
    if way.is_differential:
        path.interpolate(max(2, ceil(path.length() / _STEP_M)))
    found, before = [], way.start[2]
    for row in range(1, path.getStateCount()):
        x, y, yaw = pose_of(path.getState(row))
        before += wrapped(yaw - before)
        found.append((x, y, before))
    found[-1] = (way.goal[0], way.goal[1], before + wrapped(way.goal[2] - before))
    return tuple(found) if way.first_obstacle(found) is None else None


def _distinct(points: Array) -> Array:
    """Points without those that are equal to the one before."""
    return np.array([points[0], *(b for a, b in pairwise(points) if np.hypot(*(b - a)) > 1e-6)])
