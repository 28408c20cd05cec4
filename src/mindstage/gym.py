"""Environments of Gymnasium in which a robot opens, picks, places and puts away things of any map.

    import gymnasium

    id = "mindstage:mindstage/Open-v0"  # Gymnasium imports the module before the colon
    env = gymnasium.make(id, map="bundled:kitchen", robot="mobile_manipulator", thing="fridge_door")

Rewards are computed from the answers to declared questions about the current state, such as `articulated_parts` and
`where_is`, and nothing else of the simulation: the same questions can be asked about a real place. Each episode begins
in the same state, except that the robot stands elsewhere, near what it has to handle.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import Any, ClassVar

import gymnasium
import msgspec
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from mindstage import api
from mindstage.engines.base import SavedState
from mindstage.errors import CommandRefusedError, InvalidArgumentError, SimulationDivergedError
from mindstage.ranges import Count, Fraction, Length, NotNegative, Point, Positive, Seed, checked
from mindstage.rdf.graphs import local_name
from mindstage.robots.control import MotionGoal
from mindstage.robots.edits import add_robot
from mindstage.robots.floor_poses import planar_pose
from mindstage.robots.models.robot_model import BaseType, RobotJoint
from mindstage.robots.robot import Robot
from mindstage.robots.skill_declaration import SkillResult
from mindstage.robots.skill_performance import start_skill
from mindstage.robots.trajectories import JointTrajectory, TrajectoryPoint
from mindstage.scene import Body, BodyId, Iri
from mindstage.scene.edits import SetPoses
from mindstage.scene.floor_plan import free_floor_place
from mindstage.scene.transforms import Array, pose_from_array, pose_inverse, pose_multiply
from mindstage.simulation.simulation import Simulation
from mindstage.simulation.state import poses_in

__all__ = [
    "EpisodeScore",
    "OpenEnv",
    "PickEnv",
    "PlaceEnv",
    "PutAwayEnv",
    "RobotTaskEnv",
    "TaskProgress",
    "play_randomly",
    "play_skill",
    "success_rate",
]

__dir__ = __all__.copy

Observation = NDArray[np.float32]
Action = NDArray[np.float32]

_SPEED = 0.8
"""Share of the velocity limits that an action of 1 commands."""
_DEFAULT_VELOCITY = 1.0
"""Velocity of joints whose description has no limit [m/s or rad/s]."""
_TOLERANCES = {True: 0.005, False: 0.02}
"""A prismatic [m] or revolute joint [rad] that is farther from its command starts from where it is."""
_GRIPPER_STEP_M = 1e-3
_SETTLE_S = 0.5
_FLOOR_RADIUS_M = 0.3
_ROBOT_HEIGHT_M = 1.6
_FRONT_M = 0.65
"""Distance from a handle at which a robot rather stands [m]."""
_LOWEST_M, _HIGHEST_M = 0.1, 1.9
"""Heights of handles that a robot may reach [m]."""
_GRASPABLE_M = 0.09
"""Largest width of a thing that the gripper can hold [m]."""
_MIN_SUPPORT_HEIGHT_M = 0.3
_FAR_AWAY_M = 3.0
"""Distance from which on bringing a thing nearer counts as progress [m]."""
_FAR = 100.0
"""Bound of numbers that have none."""
_POSE_PARTS = ("x", "y", "z", "qw", "qx", "qy", "qz")
_SHOWN_NAMES = 10
"""Number of things that an error names at most."""
_LIFTED_M = 0.05
"""Distance from where a thing stood from which on it is picked up [m]."""
_PROGRESS_REWARD = 10.0
"""Reward for the whole task; for a part of it the same share."""
_APPROACH_REWARD = 1.0
"""Reward for each meter by which the gripper comes nearer [1/m]."""
_SUCCESS_REWARD = 10.0
"""Reward for having done the task."""
_ACTION_COST = 0.01
"""Loss for the mean of the squared actions."""


class TaskProgress(msgspec.Struct, frozen=True, kw_only=True):
    """How far a task is done, by answers to questions."""

    share: float
    """From 0 to 1."""
    gap_m: float
    """Distance of the gripper from what it has to handle, box to box [m]."""
    done: bool
    why: str
    """The answers, in words."""


class EpisodeScore(msgspec.Struct, frozen=True, kw_only=True):
    """The result of an episode."""

    success: bool
    reward: float
    """Sum of all rewards; 0 if it was not played by actions."""
    duration_s: float
    """Simulated time [s]."""
    reason: str


class RobotTaskEnv(gymnasium.Env[Observation, Action]):
    """One task of one robot in a map; the base of all environments.

    An action has a number from -1 to 1 for each joint of the arms and the head (velocity, as a share of its largest
    one), each gripper (-1 closed, 1 open), and each velocity of the base: forward, left (not of differential bases) and
    turn. `action_names` and `observation_names` say what each number is. Lengths are in meters, angles in radians;
    `base.` is the frame of the base link, `grasp.` that of the gripper.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}  # type: ignore[misc]

    @checked
    def __init__(
        self,
        map: str = "bundled:kitchen",
        robot: str = "mobile_manipulator",
        *,
        thing: str = "",
        pose: Point | None = None,
        period_s: Positive = 0.1,
        position_noise_m: Length = 0.05,
        yaw_noise_rad: NotNegative = 0.1,
        render_mode: str | None = None,
    ) -> None:
        """Opens the map and adds the robot.

        Args:
            map: a file, or "bundled:kitchen".
            robot: a name of the catalog, or the path of a description.
            thing: what the task is about, by id; empty for another one in each episode.
            pose: where the robot stands, x, y [m] and yaw [rad]; None for a free place near the thing. A robot with a
                fixed base needs one.
            period_s: simulated time of an action [s].
            position_noise_m: standard deviation of where the robot starts [m].
            yaw_noise_rad: standard deviation of its direction [rad].
            render_mode: only None; `mindstage.view(env.unwrapped.simulation)` shows the simulation.

        Raises:
            RobotNotFoundError: there is no such robot.
            InvalidArgumentError: the map has nothing for this task, or the robot cannot do it.
        """
        if render_mode is not None:
            raise InvalidArgumentError(
                render_mode, cause="no picture is rendered", remedy="use `mindstage.view(env.unwrapped.simulation)`"
            )
        self.render_mode = None
        self.simulation: Simulation = api.open(map)
        """The simulation; it is closed with the environment."""
        try:
            self._open(robot, thing, pose)
        except BaseException:
            self.simulation.close()
            raise
        self._period_s, self._noise = period_s, (position_noise_m, position_noise_m, yaw_noise_rad)
        self.action_names: tuple[str, ...] = tuple(self._action_names())
        self.observation_names: tuple[str, ...] = tuple(self._observation_names())
        self.action_space = spaces.Box(-1.0, 1.0, (len(self.action_names),), np.float32)
        low, high = np.array([self._bounds(name) for name in self.observation_names], np.float32).T
        self.observation_space = spaces.Box(low, high, dtype=np.float32)
        self._progress = TaskProgress(share=0.0, gap_m=0.0, done=False, why="")
        self._openings: dict[str, float] = {}
        self._start_s = 0.0
        self._targets: dict[str, float] = {}
        """Where the joints were commanded to be."""
        self._motion: MotionGoal | None = None

    # -- tasks ---------------------------------------------------------------------------------------------------------

    @abstractmethod
    def things(self) -> Iterator[BodyId]:
        """The things of the map that the task can be about."""

    @abstractmethod
    def goal(self, thing: BodyId) -> BodyId:
        """What the gripper has to go to, such as the handle of a door."""

    @abstractmethod
    def progress(self) -> TaskProgress:
        """How far the task is done now."""

    @abstractmethod
    def skill(self) -> tuple[str, dict[str, str]]:
        """The skill that does the task, and its arguments."""

    def prepare(self, thing: BodyId) -> bool:
        """Changes the map before the first episode about a thing; returns whether it did."""
        return False

    def front(self, thing: BodyId) -> Array | None:
        """The horizontal direction from the goal in which the robot rather stands; None for any."""
        return None

    # -- Gymnasium -----------------------------------------------------------------------------------------------------

    @checked
    def reset(
        self, *, seed: Seed | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins an episode.

        Args:
            seed: of the thing and of where the robot stands.
            options: `thing` chooses what the episode is about.
        """
        super().reset(seed=seed)
        chosen = (options or {}).get("thing") or self._thing
        self.thing = (
            self._checked(chosen) if chosen else self._candidates[self.np_random.integers(len(self._candidates))]
        )
        """What the current episode is about."""
        self._restore_start(self.thing)
        noise = self.np_random.normal(size=3) * self._noise
        if self.robot.model.base.type is not BaseType.FIXED:
            self.robot.set_base_pose(*(self._stand(self.thing) + noise).tolist())
        self._openings = {each.name: self.robot.opening(each.name) for each in self.robot.model.grippers}
        self._targets, self._motion = {}, None
        self._start_s = self.simulation.state.time_s
        self._start_position = self._poses([self.thing])[0][:3]
        self._progress = self.progress()
        return self._observation(), self._info()

    def step(self, action: Action) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Commands the robot for one period; see `action_names`."""
        before, values = self._progress, np.clip(np.asarray(action, dtype=float), -1.0, 1.0)
        refused = ""
        try:
            try:
                self._command(dict(zip(self.action_names, values.tolist(), strict=True)))
            except CommandRefusedError as error:
                refused = str(error)
            self.simulation.step(self._period_s)
        except SimulationDivergedError as error:
            return self._observation(), 0.0, False, True, self._info() | {"reason": str(error)}
        now = self._progress = self.progress()
        reward = _PROGRESS_REWARD * (now.share - before.share) + _APPROACH_REWARD * (before.gap_m - now.gap_m)
        reward += _SUCCESS_REWARD * now.done - _ACTION_COST * float(values @ values) / len(values)
        return self._observation(), float(reward), now.done, False, self._info() | {"refused": refused}

    def close(self) -> None:
        """Closes the simulation."""
        self.simulation.close()

    def _info(self) -> dict[str, Any]:
        return {
            "thing": self.thing,
            "progress": self._progress.share,
            "is_success": self._progress.done,
            "reason": self._progress.why,
            "time_s": self.simulation.state.time_s - self._start_s,
            "refused": "",
        }

    # -- the robot -----------------------------------------------------------------------------------------------------

    def _open(self, robot: str, thing: str, pose: tuple[float, float, float] | None) -> None:
        self.simulation.step(_SETTLE_S)
        self._find_names()
        self._candidates = tuple(self.things())
        if not self._candidates:
            raise InvalidArgumentError(type(self).__name__, cause="the map has nothing that it could be about")
        self._thing = self._checked(thing) if thing else ""
        self.thing = BodyId(self._thing or self._candidates[0])
        self._empty = self.simulation.fork(threaded=False)
        """The place without the robot."""
        self.simulation.on_close(self._empty.close)
        self._starts: dict[BodyId, SavedState | None] = {}
        """The state in which episodes about a thing begin; None for the start of the simulation."""
        self._stands: dict[BodyId, Array] = {}
        self._pose = None if pose is None else np.array(pose)
        self.robot: Robot = add_robot(self.simulation, robot, planar_pose(tuple(self._stand(self.thing).tolist())))
        model = self.robot.model
        if not model.arms or not model.grippers:
            raise InvalidArgumentError(
                self.robot.name, cause="it has no arm with a gripper", remedy="use another robot"
            )
        self._arm = next((arm for arm in model.arms if arm.gripper is not None), model.arms[0])
        self._gripper = next(each for each in model.grippers if each.name == (self._arm.gripper or each.name))
        names = dict.fromkeys(name for arm in model.arms for name in arm.joints)
        names |= dict.fromkeys(model.head.joints if model.head else ())
        self._joints: tuple[RobotJoint, ...] = tuple(model.joint(name) for name in names)
        self._find_names()
        self._links = frozenset(self.robot.link_ids.values())
        self.simulation.step(_SETTLE_S)
        self.simulation.mark_start()

    def _find_names(self) -> None:
        bodies = self.simulation.snapshot().bodies
        self._ids = {body.iri: body.id for body in bodies}
        self._iris: dict[str, str] = {body.id: body.iri for body in bodies}

    def _stand(self, thing: BodyId) -> Array:
        """Where the robot stands to handle a thing: x, y [m] and yaw [rad].

        Raises:
            InvalidArgumentError: no place near it is free.
        """
        if self._pose is not None:
            return self._pose
        if thing not in self._stands:
            goal = self.goal(thing)
            (pose,) = self._poses((goal,))
            self._empty.apply(SetPoses({goal: pose_from_array(pose)}))
            self._stands[thing] = _free_stand(self._empty, goal, self.front(thing))
        return self._stands[thing]

    def _restore_start(self, thing: BodyId) -> None:
        self.simulation.reset()
        if thing not in self._starts:
            changed = self.prepare(thing)
            if changed:
                self.simulation.step(_SETTLE_S)
                self._stands.pop(thing, None)  # the thing is elsewhere now
            self._starts[thing] = self.simulation.engine.run(lambda engine: engine.save_state()) if changed else None
        elif (state := self._starts[thing]) is not None:
            self.simulation.engine.run(lambda engine: engine.restore_state(state), edits=True)

    def _command(self, action: dict[str, float]) -> None:
        """Commands joints, grippers and base.

        Raises:
            CommandRefusedError: a velocity would be beyond its limit, since a joint is not where it was commanded.
        """
        robot, model, targets = self.robot, self.robot.model, self._reference()
        for joint in self._joints:
            step = action[joint.name] * _SPEED * (joint.velocity or _DEFAULT_VELOCITY) * self._period_s
            low, high = joint.limits
            targets[joint.name] = min(max(targets[joint.name] + step, low), high)
        point = TrajectoryPoint(positions=tuple(targets.values()), time_s=self._period_s)
        self._targets = {}
        self._motion = robot.start_trajectory(JointTrajectory(tuple(targets), (point,)))
        self._targets = targets
        for gripper in model.grippers:
            opening = (action[gripper.name] + 1.0) / 2.0 * gripper.max_opening_m
            if abs(opening - self._openings[gripper.name]) > _GRIPPER_STEP_M:
                self._openings[gripper.name] = opening
                robot.start_gripping(gripper.name, opening)
        if model.base.type is not BaseType.FIXED:
            direction = np.array([action["base.forward"], action.get("base.left", 0.0)])
            vx, vy = (model.base.velocity * direction / max(1.0, float(np.linalg.norm(direction)))).tolist()
            robot.drive(vx, vy, action["base.turn"] * model.base.turn_velocity)

    def _reference(self) -> dict[str, float]:
        """Where each joint is commanded to be, from which the next command starts; where it is, if it is elsewhere."""
        now, is_moving = self.robot.joint_positions(), self._motion is not None and self._motion.result is None
        found = {}
        for joint in self._joints:
            position = now[joint.name]
            target = self._targets.get(joint.name, position)
            tolerance = _TOLERANCES[joint.is_prismatic]
            found[joint.name] = target if is_moving or abs(target - position) <= tolerance else position
        return found

    # -- spaces --------------------------------------------------------------------------------------------------------

    def _action_names(self) -> Iterator[str]:
        yield from (joint.name for joint in self._joints)
        yield from (each.name for each in self.robot.model.grippers)
        if self.robot.model.base.type is not BaseType.FIXED:
            yield "base.forward"
            if self.robot.model.base.type is BaseType.PLANAR:
                yield "base.left"
            yield "base.turn"

    def _observation_names(self) -> Iterator[str]:
        for quantity in ("position", "velocity"):
            yield from (f"{joint.name}.{quantity}" for joint in self._joints)
        yield from (f"{each.name}.opening" for each in self.robot.model.grippers)
        for frame, what in (("base", "gripper"), ("base", "thing"), ("base", "goal"), ("grasp", "goal")):
            yield from (f"{frame}.{what}.{part}" for part in _POSE_PARTS)
        yield from ("progress", "gap", "holds")

    def _bounds(self, name: str) -> tuple[float, float]:
        what, _, part = name.rpartition(".")
        joint = next((each for each in self._joints if each.name == what), None)
        if joint is not None and part == "position":
            low, high = joint.limits
            return max(low, -_FAR), min(high, _FAR)
        if part in {"qw", "qx", "qy", "qz"}:
            return -1.0, 1.0
        return (0.0, 1.0) if name in {"progress", "holds"} else (-_FAR, _FAR)

    def _observation(self) -> Observation:
        robot = self.robot
        positions, velocities = robot.joint_positions(), robot.joint_velocities()
        names = [joint.name for joint in self._joints]
        poses = self._poses((self.thing, self.goal(self.thing)))
        base, grasp = robot.link_pose(robot.model.base.link), robot.grasp_pose(self._gripper.name)
        relative = (
            pose_multiply(pose_inverse(base), grasp),
            pose_multiply(pose_inverse(base), poses[0]),
            pose_multiply(pose_inverse(base), poses[1]),
            pose_multiply(pose_inverse(grasp), poses[1]),
        )
        values = [
            *(positions[name] for name in names),
            *(velocities[name] for name in names),
            *(robot.opening(each.name) for each in robot.model.grippers),
            *(number for pose in relative for number in _upper_half(pose).tolist()),
            self._progress.share,
            self._progress.gap_m,
            float(bool(robot.held)),
        ]
        space = self.observation_space
        assert isinstance(space, spaces.Box)
        return np.clip(np.array(values, dtype=np.float32), space.low, space.high)

    # -- questions -----------------------------------------------------------------------------------------------------

    def _ask(self, question: str, **args: str) -> list[Any]:
        """The answers to a question; bodies are named by their IRIs, which need not be searched for."""
        return list(self.simulation.ask(question, **{name: self._iris.get(text, text) for name, text in args.items()}))

    def _gap(self, thing: BodyId) -> float:
        """The distance of the gripper from a thing, box to box [m]; 0 if they overlap."""
        rows = self._ask("distance", thing=self.robot.link_ids[self._gripper.link], other=thing)
        return max(0.0, min((row.gap for row in rows), default=0.0))

    def _holds(self) -> bool:
        """Whether a gripper holds the thing, by its contacts."""
        return self.thing in self.robot.held.values()

    def _body(self, iri: str) -> BodyId:
        """The body of an answer."""
        return self._ids[Iri(iri)]

    def _poses(self, ids: Sequence[BodyId]) -> list[Array]:
        found = poses_in(self.simulation.state, set(ids))
        return [found[id] for id in ids]

    def _checked(self, thing: str) -> BodyId:
        if thing not in self._candidates:
            remedy = f"choose one of {', '.join(self._candidates[:_SHOWN_NAMES])}"
            raise InvalidArgumentError(thing, cause=f"{type(self).__name__} cannot be about it", remedy=remedy)
        return BodyId(thing)

    def perform(self) -> SkillResult:
        """Performs the skill that does the task, instead of actions."""
        name, args = self.skill()
        motion = start_skill(self.robot, name, args)
        try:
            while True:
                self.simulation.step(next(motion))
        except StopIteration as end:
            result: SkillResult = end.value
        self._progress = self.progress()
        return result


class OpenEnv(RobotTaskEnv):
    """Opening a door or a drawer."""

    @checked
    def __init__(self, map: str = "bundled:kitchen", *, share: Fraction = 0.8, **options: Any) -> None:
        """See `RobotTaskEnv`.

        Args:
            map: see `RobotTaskEnv`.
            share: how far it has to be opened, as a share of its range.
            **options: see `RobotTaskEnv`; `thing` is a door or a drawer.
        """
        self._share = share
        super().__init__(map, **options)

    def things(self) -> Iterator[BodyId]:
        """The closed doors and drawers with a handle that is not too high."""
        self._handles: dict[BodyId, BodyId] = {}
        self._holders: dict[BodyId, BodyId] = {}
        for row in self._ask("articulated_parts", state="closed"):
            for found in self._ask("handle_of", individual=row.part):
                front, handle = self._body(row.part), self._body(found.handle)
                if _LOWEST_M <= self._poses((handle,))[0][2] <= _HIGHEST_M and front not in self._handles:
                    self._handles[front], self._holders[front] = handle, self._body(row.thing)
                    yield front

    def goal(self, thing: BodyId) -> BodyId:
        """Its handle."""
        return self._handles[thing]

    def front(self, thing: BodyId) -> Array | None:
        """From what it closes to its handle."""
        handle, holder = self._poses((self._handles[thing], self._holders[thing]))
        return handle[:2] - holder[:2]

    def progress(self) -> TaskProgress:
        """By `articulated_parts` and `distance`."""
        (row,) = self._ask("articulated_parts", part=self.thing)[:1]
        share = 0.0 if row.share is None else min(1.0, row.share / self._share)
        why = f"{self.thing} is {row.share or 0.0:.0%} open"
        return TaskProgress(share=share, gap_m=self._gap(self.goal(self.thing)), done=share >= 1.0, why=why)

    def skill(self) -> tuple[str, dict[str, str]]:
        """`open`."""
        return "open", {"thing": self.thing}


class PickEnv(RobotTaskEnv):
    """Picking up a thing that stands somewhere in the open."""

    def things(self) -> Iterator[BodyId]:
        """The loose bodies that the gripper can hold and that stand on something, not in anything that is closed."""
        yield from self._loose_things()

    def _loose_things(self) -> Iterator[BodyId]:
        inside = {row.thing for row in self._ask("where_is", relation="inside")}
        parts = {self._body(row.part) for row in self._ask("articulated_parts")}
        bodies = {body.id: body for body in self.simulation.snapshot().bodies}
        for row in self._ask("where_is", relation="on"):
            body = bodies[self._body(row.thing)]
            if row.thing not in inside and body.id not in parts and _is_graspable(body):
                yield body.id

    def goal(self, thing: BodyId) -> BodyId:
        """The thing itself."""
        return thing

    def progress(self) -> TaskProgress:
        """By `where_is`, `pose_of` and `distance`: the gripper holds it, on nothing, 5 cm from where it stood."""
        gap = self._gap(self.thing)
        rows = self._ask("where_is", thing=self.thing, relation="on")
        on = [row for row in rows if self._ids.get(row.other) not in self._links]
        if on or not self._holds():
            why = f"on {local_name(on[0].other)}" if on else "not held"
            return TaskProgress(share=0.0, gap_m=gap, done=False, why=f"{self.thing} is {why}")
        (row,) = self._ask("pose_of", thing=self.thing)
        moved = float(np.linalg.norm(row.position - self._start_position))
        why = f"{self.thing} is held {moved:.2f} m from where it stood"
        return TaskProgress(share=min(1.0, moved / _LIFTED_M), gap_m=gap, done=moved >= _LIFTED_M, why=why)

    def skill(self) -> tuple[str, dict[str, str]]:
        """`pick`."""
        return "pick", {"thing": self.thing}


class PlaceEnv(PickEnv):
    """Bringing a thing onto something else."""

    def __init__(self, map: str = "bundled:kitchen", *, on: str = "", **options: Any) -> None:
        """See `RobotTaskEnv`.

        Args:
            map: see `RobotTaskEnv`.
            on: what the thing has to be placed on; by default what most things of the map are on.
            **options: see `RobotTaskEnv`; `thing` is a loose body.
        """
        self._on = on
        super().__init__(map, **options)

    def things(self) -> Iterator[BodyId]:
        """The things of `PickEnv` that are not on the target already."""
        rows = [(self._body(row.thing), self._body(row.other)) for row in self._ask("where_is", relation="on")]
        self.target = BodyId(self._on) if self._on else _best_support(self.simulation, rows)
        """What the thing has to be placed on."""
        on_target = {thing for thing, support in rows if support == self.target}
        yield from (id for id in self._loose_things() if id not in on_target and id != self.target)

    def progress(self) -> TaskProgress:
        """By `where_is` and `distance`: it is on the target, and the gripper has released it."""
        gap = self._gap(self.thing)
        rows = self._ask("where_is", thing=self.thing, relation="on")
        is_there = any(self._ids.get(row.other) == self.target for row in rows)
        (apart,) = self._ask("distance", thing=self.thing, other=self.target)[:1]
        near = max(0.0, 1.0 - max(0.0, apart.gap) / _FAR_AWAY_M)
        share = 1.0 if is_there and not self._holds() else 0.9 if is_there else 0.8 * near
        others = ", ".join(local_name(row.other) for row in rows) or "nothing"
        return TaskProgress(share=share, gap_m=gap, done=share >= 1.0, why=f"{self.thing} is on {others}")

    def skill(self) -> tuple[str, dict[str, str]]:
        """`place`."""
        return "place", {"thing": self.thing, "on": self.target}


class PutAwayEnv(PickEnv):
    """Bringing a thing to where its kind belongs, and closing what was opened for that."""

    def __init__(self, map: str = "bundled:kitchen", *, start_on: str = "", **options: Any) -> None:
        """See `RobotTaskEnv`.

        Args:
            map: see `RobotTaskEnv`.
            start_on: what the thing is on at the start; by default what most things of the map are on.
            **options: see `RobotTaskEnv`; `thing` is a loose body.
        """
        self._start_on = start_on
        super().__init__(map, **options)

    def things(self) -> Iterator[BodyId]:
        """The loose bodies that the gripper can hold, and whose kind belongs into something of the map."""
        bodies = {body.id: body for body in self.simulation.snapshot().bodies}
        self._places: dict[BodyId, BodyId] = {}
        rows = [(self._body(row.thing), self._body(row.other)) for row in self._ask("where_is", relation="on")]
        self._counter = BodyId(self._start_on) if self._start_on else _best_support(self.simulation, rows)
        closable = {self._body(row.thing) for row in self._ask("articulated_parts")}
        parts = {self._body(row.part) for row in self._ask("articulated_parts")}
        for body in bodies.values():
            if body.id in parts or not _is_graspable(body):
                continue
            found = [self._body(row.individual) for row in self._ask("storage_place_in_environment", item=body.cls)]
            for place in [place for place in found if place in closable][:1]:
                self._places[body.id] = place
                yield body.id

    def prepare(self, thing: BodyId) -> bool:
        """Puts the thing onto where it is at the start."""
        self.simulation.place(thing, on=self._counter)
        return True

    def progress(self) -> TaskProgress:
        """By `where_is`, `articulated_parts` and `distance`: inside its place, released, and everything closed."""
        place, gap = self._places[self.thing], self._gap(self.thing)
        is_inside = bool(self._ask("where_is", thing=self.thing, relation="inside", other=place))
        shares = [row.share or 0.0 for row in self._ask("articulated_parts", thing=place)]
        is_open = bool(self._ask("articulated_parts", thing=place, state="open"))
        if is_inside and not self._holds():
            share = 1.0 if not is_open else 0.9 - 0.2 * max(shares)
        elif is_inside:
            share = 0.65
        else:
            (apart,) = self._ask("distance", thing=self.thing, other=place)[:1]
            share = 0.3 * max(shares, default=0.0) + 0.3 * max(0.0, 1.0 - max(0.0, apart.gap) / _FAR_AWAY_M)
        why = f"{self.thing} is {'in' if is_inside else 'not in'} {place}, which is {'open' if is_open else 'closed'}"
        return TaskProgress(share=share, gap_m=gap, done=share >= 1.0, why=why)

    def skill(self) -> tuple[str, dict[str, str]]:
        """`put_away`."""
        return "put_away", {"thing": self.thing}


# -- baselines ---------------------------------------------------------------------------------------------------------


@checked
def play_randomly(env: gymnasium.Env[Observation, Action], *, seed: Seed) -> EpisodeScore:
    """Plays an episode with random actions.

    Args:
        env: an environment of `gymnasium.make`, whose number of steps is limited.
        seed: of the episode and the actions.
    """
    _, info = env.reset(seed=seed)
    env.action_space.seed(seed)
    total, ended = 0.0, False
    while not ended:
        _, reward, terminated, truncated, info = env.step(env.action_space.sample())
        total, ended = total + float(reward), terminated or truncated
    return EpisodeScore(success=info["is_success"], reward=total, duration_s=info["time_s"], reason=info["reason"])


@checked
def play_skill(env: gymnasium.Env[Observation, Action], *, seed: Seed) -> EpisodeScore:
    """Plays an episode with the skill that does the task; the success is that of the task, not that of the skill.

    Args:
        env: an environment.
        seed: of the episode.
    """
    env.reset(seed=seed)
    task = env.unwrapped
    assert isinstance(task, RobotTaskEnv)
    result = task.perform()
    progress = task.progress()
    reason = progress.why if progress.done else result.reason or progress.why
    return EpisodeScore(success=progress.done, reward=0.0, duration_s=result.duration_s, reason=reason)


@checked
def success_rate(
    env: gymnasium.Env[Observation, Action], play: Callable[..., EpisodeScore], *, episodes: Count, seed: Seed = 0
) -> tuple[float, tuple[EpisodeScore, ...]]:
    """The share of episodes in which a policy does the task.

    Args:
        env: an environment of `gymnasium.make`.
        play: `play_randomly`, `play_skill`, or another function of an environment and a seed.
        episodes: the number of episodes.
        seed: the seed of the first one; the others follow.

    Returns:
        The share, and the scores of the episodes.
    """
    scores = tuple(play(env, seed=seed + number) for number in range(episodes))
    return sum(score.success for score in scores) / max(len(scores), 1), scores


# -- geometry ----------------------------------------------------------------------------------------------------------


def _upper_half(pose: Array) -> Array:
    """The pose with the quaternion of positive w, so that equal poses have equal numbers."""
    return np.concatenate([pose[:3], pose[3:] if pose[3] >= 0.0 else -pose[3:]])


def _is_graspable(body: Body) -> bool:
    """Whether a loose body is small enough for the gripper of most robots."""
    return body.physics.is_dynamic and body.size is not None and sorted(body.size)[0] <= _GRASPABLE_M


def _best_support(simulation: Simulation, rows: Sequence[tuple[BodyId, BodyId]]) -> BodyId:
    """What most loose things are on, other than the floor."""
    bodies = {body.id: body for body in simulation.snapshot().bodies}
    counts = Counter(
        support
        for thing, support in rows
        if bodies[thing].physics.is_dynamic and bodies[support].pose.position[2] > _MIN_SUPPORT_HEIGHT_M
    )
    if not counts:
        raise InvalidArgumentError("the map", cause="nothing stands on anything", remedy="name a support")
    return counts.most_common(1)[0][0]


def _free_stand(simulation: Simulation, goal: BodyId, front: Array | None) -> Array:
    """The free place on the floor nearest to a body: x, y [m] and the yaw towards the body.

    Args:
        simulation: the place, without the robot.
        front: the horizontal direction from the body in which a robot rather stands; None for any.

    Raises:
        InvalidArgumentError: there is none.
    """
    center = poses_in(simulation.state, {goal})[goal][:2]
    x, y = (center if front is None else center + _FRONT_M * front / max(float(np.linalg.norm(front)), 1e-6)).tolist()
    place = free_floor_place(
        simulation.snapshot(), simulation.geometry, radius=_FLOOR_RADIUS_M, height=_ROBOT_HEIGHT_M, near=(x, y)
    )
    if place is None:
        cause = "no robot has room on the floor"
        raise InvalidArgumentError(goal, cause=cause, remedy="give the pose of the robot")
    stand = np.array(place[:2])
    return np.array([*stand, math.atan2(*(center - stand)[::-1])])
