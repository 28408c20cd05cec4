"""Referees of places, and of what robots do in them: MuJoCo and NumPy only, nothing of the code under test.

Shapes are compared whatever their contact filters say, and motion is compared with the forces of MuJoCo's own state.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum

import mujoco
import numpy as np
from numpy.typing import NDArray

__all__ = ["Intervention", "InterventionKind", "PlaceReferee", "Shapes", "SkillReferee"]

TOUCHING_M = 0.0005
JUMP_M = 1e-6
"""A position that changes by more than its velocity explains has jumped."""
SPEED_JUMP = 1e-4
"""A velocity that changes by more between two time steps was set [m/s]."""
DEEP_M = 0.005
"""The robot passes through what it is inside of by more; contacts of MuJoCo are softer than nothing."""
KEPT_MODELS = 2
"""The number of models before the present one that are not read again; engines change to and fro between some."""
SAMPLE_STEPS = 10
"""The number of time steps between two measurements of distances."""
NEAR_M = 0.02
"""Distances from the robot are measured up to here."""
AROUND_M = 0.05
"""How far an obstacle may be from what it stops."""
LEAST_LEVER_M = 0.05
MAX_SLIDE_M = 2.0
SWEEP_POSES = 9
LIFTED_M, REST_M, REST_SPEED = 0.02, 0.003, 0.05
"""How far a thing that was picked up is lifted; how far one that rests is from its support [m], and its speed [m/s]."""
STATED_ERROR = 0.05
"""By how much an openness that is stated may differ from that which is measured."""
PRESSED = re.compile(r"\S+ is pressed [\d.]+ mm into (\S+)")
INSIDE = re.compile(r"(\S+) is [\d.]+ mm (?:inside|from) (\S+)")
STATED = re.compile(r"(\S+) is (\d+)% open instead of")

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]


class Shapes:
    """The collision shapes of a model in the poses of `data`, and the distances between them."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, owners: Sequence[str] | None = None) -> None:
        """Reads nothing of `data` yet.

        Args:
            owners: the name of the thing that each geom is part of; by default that of its body.
        """
        self.model, self.data = model, data
        self.owners = np.array(
            [model.body(int(body)).name for body in model.geom_bodyid] if owners is None else list(owners), dtype=object
        )
        self.solid: Ints = np.flatnonzero(model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE)
        self.low = self.high = np.zeros((model.ngeom, 3))

    def update(self) -> None:
        """Computes the poses of all bodies and the world-aligned boxes of all shapes from the positions of joints."""
        mujoco.mj_kinematics(self.model, self.data)
        turned = self.data.geom_xmat.reshape(-1, 3, 3)
        center = self.data.geom_xpos + np.einsum("nij,nj->ni", turned, self.model.geom_aabb[:, :3])
        half = np.einsum("nij,nj->ni", np.abs(turned), self.model.geom_aabb[:, 3:])
        self.low, self.high = center - half, center + half

    def pairs(self, first: Ints, second: Ints, within_m: float) -> Iterator[tuple[int, int, float]]:
        """The pairs of shapes, one of each group, that are not farther apart, with their distance [m].

        Within one group, which is then given twice, each pair comes once.
        """
        gap = np.maximum(self.low[first][:, None] - self.high[second], self.low[second] - self.high[first][:, None])
        is_near = gap.max(axis=2) <= within_m
        for row, column in np.argwhere(np.triu(is_near, 1) if first is second else is_near).tolist():
            a, b = int(first[row]), int(second[column])
            distance = mujoco.mj_geomDistance(self.model, self.data, a, b, within_m, None)
            if distance < within_m:
                yield a, b, float(distance)

    def of(self, *names: str) -> Ints:
        """The solid shapes of some things."""
        return self.solid[np.isin(self.owners[self.solid], names)]


class PlaceReferee:
    """A place without a robot: whether it rests, overlaps and opens."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model = model
        self.model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
        self.data = mujoco.MjData(self.model)
        self._shapes = Shapes(self.model, self.data)
        self._shapes.update()
        shown = (self.model.geom_contype > 0) | (self.model.geom_conaffinity > 0)
        self._solid = np.intersect1d(np.flatnonzero(shown), self._shapes.solid)
        self._body = self.model.geom_bodyid
        joints = self.model.jnt_type == mujoco.mjtJoint.mjJNT_FREE
        self.loose = {int(body) for body in self.model.jnt_bodyid[joints]}
        self.hinged = [int(joint) for joint in np.flatnonzero(~joints)]

    def moved(self, seconds: float) -> dict[str, float]:
        """How far bodies move [m], those that move by more than 1 cm."""
        start = self.data.xpos.copy()
        while self.data.time < seconds:
            mujoco.mj_step(self.model, self.data)
        distance = np.linalg.norm(self.data.xpos - start, axis=1)
        return {self.model.body(int(body)).name: float(distance[body]) for body in np.flatnonzero(distance > 0.01)}

    def overlaps(self) -> set[tuple[str, str]]:
        """The pairs of bodies whose shapes overlap in the current pose."""
        return set(self._overlapping(self._solid, self._solid))

    def hit_while_opening(self) -> set[tuple[str, str]]:
        """The fronts that hit something that is not loose, with what they hit."""
        found = set()
        parents = self.model.body_parentid
        fixed = np.array([shape for shape in self._solid if int(self._body[shape]) not in self.loose])
        for joint in self.hinged:
            root = self.model.jnt_bodyid[joint]
            own = (self._body[fixed] == root) | (parents[self._body[fixed]] == root)
            low, high = self.model.jnt_range[joint]
            for position in np.linspace(low, high, 6):
                self.data.qpos[:] = self.model.qpos0
                self.data.qpos[self.model.jnt_qposadr[joint]] = position
                self._shapes.update()
                found |= set(self._overlapping(fixed[own], fixed[~own]))
        return found

    def _overlapping(self, first: Ints, second: Ints) -> Iterator[tuple[str, str]]:
        for a, b, distance in self._shapes.pairs(first, second, 1e-9):
            if distance < -TOUCHING_M and self._body[a] != self._body[b]:
                yield self._shapes.owners[a], self._shapes.owners[b]


class InterventionKind(StrEnum):
    """What moves things other than gravity, contacts, and the limits, the friction and the damping of joints."""

    EQUALITY = "equality constraint"
    """A weld, a common point, or a coupling of joints."""
    EXTERNAL_FORCE = "external force"
    """`xfrc_applied`."""
    JOINT_FORCE = "applied joint force"
    """`qfrc_applied`."""
    ACTUATOR = "actuator"
    SPRING = "spring"
    """Of a tendon, or of a joint that had none at the beginning."""
    ADHESION = "adhesion"
    WEIGHT = "gravity compensation"
    """Of a body that had its weight at the beginning."""
    JUMP = "jump"
    """A position changed by more than 1 µm beyond its velocity."""
    SPEED_JUMP = "jump of the velocity"
    MOCAP = "motion of a mocap body"
    FIXED = "fixed to the robot"
    """It became a part of the robot's kinematic tree."""
    OVERLAP = "inside the robot"
    """The robot passed through it."""


@dataclass(slots=True)
class Intervention:
    """What acted on a body, over the whole time."""

    kind: InterventionKind
    body: str
    begin_s: float
    impulse_ns: float = 0.0
    """The sum of the absolute impulses at its center of mass [N s]; for a jump that of moving so far in a time step."""
    steps: int = 0
    largest_m: float = 0.0
    """The largest jump, or the largest depth [m]."""

    def __str__(self) -> str:
        length = f", {self.largest_m * 1000:.3g} mm" if self.largest_m else ""
        return f"{self.kind} on {self.body}: {self.impulse_ns:.3g} N s in {self.steps} steps{length}"


@dataclass(slots=True)
class _Watched:
    """A model, and which parts of it are the robot and the place."""

    model: mujoco.MjModel
    names: list[str]
    shapes: Shapes
    robot_geoms: Ints
    place_geoms: Ints
    fixed: list[int]
    """Bodies of the place that are part of the robot's kinematic tree."""
    bodies: Ints
    """Bodies of the place that move."""
    dofs: Ints
    """Their degrees of freedom."""
    body_of_dof: Ints
    levers: Floats
    """By what a velocity is multiplied for that of the center of mass, for each degree of freedom."""
    masses: Floats
    """The mass that each degree of freedom moves."""
    coordinates: dict[tuple[str, int], tuple[slice, slice]]
    """The addresses in `qpos` and `qvel` of each joint, by its body and number."""
    equalities: Ints
    """The equality constraints that act on the place."""
    mocap: Ints
    sprung: NDArray[np.bool_]
    """Whether a degree of freedom of the place has had a spring of its own from the beginning."""
    floating: NDArray[np.bool_]
    """Whether one has been of a body without weight from the beginning."""


@dataclass(slots=True)
class _State:
    watched: _Watched
    time_s: float
    qpos: Floats
    qvel: Floats
    mocap: Floats


class SkillReferee:
    """Watches what a robot does, at each time step of MuJoCo.

    ::

        referee = SkillReferee(robot=["hand", "finger"])
        with referee.watching():
            ...  # whatever calls mujoco.mj_step
        referee.interventions
    """

    def __init__(
        self,
        robot: Collection[str],
        *,
        name_of: Callable[[str], str] = str,
        owners: Callable[[mujoco.MjModel], Sequence[str] | None] = lambda model: None,
    ) -> None:
        """Watches nothing yet.

        Args:
            robot: the names of its bodies.
            name_of: the name of a body by that of the MuJoCo body.
            owners: the name of the thing that each geom of a model is part of, where bodies of the place are geoms of
                the world body.
        """
        self.robot = frozenset(robot)
        self.interventions: list[Intervention] = []
        self.deepest: dict[tuple[str, str], float] = {}
        """The deepest overlap of each part of the robot with each thing [m]."""
        self.nearest_m: dict[str, float] = {}
        """The least distance of each thing from the robot, where it was below 2 cm [m]."""
        self.first: Mapping[str, Floats] = {}
        """The pose of each body at the beginning."""
        self.reach_m = 0.0
        """No part of the robot is ever farther from the origin of its first body, by the lengths of its links."""
        self._name_of, self._owners = name_of, owners
        self._models: list[_Watched] = []
        self._sprung: frozenset[str] | None = None
        self._floating: frozenset[str] = frozenset()
        self._last: _State | None = None
        self._before: _State | None = None
        self._call: _State | None = None
        self._pending: list[tuple[InterventionKind, str, float, float, float]] = []
        self._initial: dict[str, float] | None = None
        self._velocities: dict[str, tuple[Floats, Floats | None]] = {}
        self._steps = 0
        self._data: mujoco.MjData | None = None

    # -- watching ------------------------------------------------------------------------------------------------------

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Watches all time steps within the context, one by one; to be entered once."""
        step = mujoco.mj_step

        def watched(model: mujoco.MjModel, data: mujoco.MjData, nstep: int = 1) -> None:
            self._begin_call(model, data)
            for _ in range(nstep):
                self._begin_step(model, data)
                step(model, data)
                self._end_step(model, data)

        mujoco.mj_step = watched
        try:
            yield
        finally:
            mujoco.mj_step = step
            if self._last is not None:
                self._sample(self._last)
            self._commit()

    def look(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Takes a state without a time step; as the first one, before anything has moved."""
        state = self._state(model, data)
        self._sample(state)
        self._last = state

    def _begin_call(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Forgets the steps of the last call if they are repeated from where they began, as for want of memory."""
        call, repeated = self._call, self._call is not None and data.time <= self._call.time_s
        if call is not None and repeated and np.array_equal(call.qpos, data.qpos):
            self._pending.clear()
            self._last = call
        self._commit()
        self._call = self._state(model, data)

    def _commit(self) -> None:
        for kind, body, at_s, impulse, length in self._pending:
            found = next((each for each in self.interventions if (each.kind, each.body) == (kind, body)), None)
            if found is None:
                found = Intervention(kind, body, at_s)
                self.interventions.append(found)
            found.impulse_ns += impulse
            found.largest_m = max(found.largest_m, length)
            found.steps += 1
        self._pending.clear()

    def _note(self, kind: InterventionKind, body: str, at_s: float, impulse: float, length_m: float = 0.0) -> None:
        self._pending.append((kind, body, at_s, impulse, length_m))

    def _state(self, model: mujoco.MjModel, data: mujoco.MjData) -> _State:
        watched = next((each for each in self._models if each.model is model), None)
        if watched is None:
            watched = self._read(model)
            self._models = [watched, *self._models[:KEPT_MODELS]]
        self._data = data
        return _State(watched, float(data.time), data.qpos.copy(), data.qvel.copy(), data.mocap_pos.copy())

    def _begin_step(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        state = self._state(model, data)
        if self._last is None:
            self._sample(state)
        else:
            self._compare(self._last, state)
        self._before = state

    def _end_step(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        before = self._before
        assert before is not None
        state = self._state(model, data)
        self._last = state
        self._audit(before, state, data)
        self._steps += 1
        if self._steps % SAMPLE_STEPS == 0:
            self._sample(state)

    # -- forces --------------------------------------------------------------------------------------------------------

    def _compare(self, last: _State, now: _State) -> None:
        """Notes what was changed between two time steps."""
        model, watched = now.watched.model, now.watched
        then = now
        if last.watched is watched:
            for row in watched.mocap[np.abs(now.mocap - last.mocap).max(axis=1)[watched.mocap] > JUMP_M].tolist():
                body, length = int(np.flatnonzero(model.body_mocapid == row)[0]), now.mocap[row] - last.mocap[row]
                impulse = float(model.body_mass[body] * np.linalg.norm(length) / model.opt.timestep)
                name = watched.names[body]
                self._note(InterventionKind.MOCAP, name, now.time_s, impulse, float(np.linalg.norm(length)))
            if np.array_equal(last.qpos, now.qpos) and np.array_equal(last.qvel, now.qvel):
                return
            then = last
        else:
            then = _State(watched, last.time_s, now.qpos.copy(), now.qvel.copy(), now.mocap)
            for key, (positions, velocities) in watched.coordinates.items():
                old = last.watched.coordinates.get(key)
                if old is not None and old[0].stop - old[0].start == positions.stop - positions.start:
                    then.qpos[positions], then.qvel[velocities] = last.qpos[old[0]], last.qvel[old[1]]
        moved = np.zeros(model.nv)
        mujoco.mj_differentiatePos(model, moved, 1.0, then.qpos, now.qpos)
        self._note_lengths(InterventionKind.JUMP, watched, np.abs(moved) * watched.levers, JUMP_M, now.time_s)
        changed = np.abs(now.qvel - then.qvel) * watched.levers
        self._note_lengths(InterventionKind.SPEED_JUMP, watched, changed, SPEED_JUMP, now.time_s)

    def _note_lengths(
        self, kind: InterventionKind, watched: _Watched, lengths: Floats, least: float, at_s: float
    ) -> None:
        for dof in watched.dofs[lengths[watched.dofs] > least].tolist():
            name, length, step_s = watched.names[watched.body_of_dof[dof]], float(lengths[dof]), 1.0
            if kind is InterventionKind.JUMP:
                step_s = float(watched.model.opt.timestep)
            jumped = length if kind is InterventionKind.JUMP else 0.0
            self._note(kind, name, at_s, float(watched.masses[dof]) * length / step_s, jumped)

    def _audit(self, before: _State, now: _State, data: mujoco.MjData) -> None:
        """Notes what acted within a time step, of which `data` has the forces and the state after it."""
        watched, model, step_s, at_s = now.watched, now.watched.model, float(now.watched.model.opt.timestep), now.time_s
        dofs = watched.dofs
        for kind, forces in (
            (InterventionKind.JOINT_FORCE, data.qfrc_applied[dofs]),
            (InterventionKind.ACTUATOR, data.qfrc_actuator[dofs]),
            (InterventionKind.ADHESION, data.qfrc_adhesion[dofs]),
            (InterventionKind.SPRING, np.where(watched.sprung, 0.0, data.qfrc_spring[dofs])),
            (InterventionKind.WEIGHT, np.where(watched.floating, 0.0, data.qfrc_gravcomp[dofs])),
        ):
            if forces.any():
                self._note_forces(kind, watched, forces, at_s)
        if len(watched.equalities) and data.eq_active[watched.equalities].any():
            self._note_forces(InterventionKind.EQUALITY, watched, self._equality_forces(watched, data)[dofs], at_s)
        pushes = data.xfrc_applied[watched.bodies]
        if pushes.any():
            for body, push in zip(watched.bodies.tolist(), pushes, strict=True):
                if push.any():
                    force = float(np.linalg.norm(push[:3]) + np.linalg.norm(push[3:]) / self._size(model, body))
                    self._note(InterventionKind.EXTERNAL_FORCE, watched.names[body], at_s, force * step_s)
        moved = np.zeros(model.nv)
        mujoco.mj_differentiatePos(model, moved, 1.0, before.qpos, now.qpos)
        # A tree that falls asleep at the end of a step has moved by its velocity before that.
        speed = np.where(now.qvel == 0.0, before.qvel, now.qvel)
        missed = np.minimum(np.abs(moved - now.qvel * step_s), np.abs(moved - speed * step_s)) * watched.levers
        self._note_lengths(InterventionKind.JUMP, watched, missed, JUMP_M, at_s)
        for body in watched.fixed:
            self._note_fixed(watched, body, data, step_s, at_s)

    @staticmethod
    def _equality_forces(watched: _Watched, data: mujoco.MjData) -> Floats:
        """The forces of the equality constraints of the place on all degrees of freedom."""
        rows = (data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)) & np.isin(data.efc_id, watched.equalities)
        forces = np.zeros(watched.model.nv)
        mujoco.mj_mulJacTVec(watched.model, data, forces, np.where(rows, data.efc_force, 0.0))
        return forces

    def _note_forces(self, kind: InterventionKind, watched: _Watched, forces: Floats, at_s: float) -> None:
        """Notes the forces on the degrees of freedom of the place, those of each body together."""
        forces = np.abs(forces) / watched.levers[watched.dofs]
        bodies = watched.body_of_dof[watched.dofs]
        for body in np.unique(bodies[forces > 0.0]).tolist():
            force = float(np.linalg.norm(forces[bodies == body]))
            self._note(kind, watched.names[body], at_s, force * float(watched.model.opt.timestep))

    def _note_fixed(self, watched: _Watched, body: int, data: mujoco.MjData, step_s: float, at_s: float) -> None:
        """Notes the impulse that moves what is fixed to the robot, against its weight."""
        name, position = watched.names[body], data.xipos[body].copy()
        last, velocity = self._velocities.get(name, (position, None))
        now = (position - last) / step_s
        self._velocities[name] = position, now
        acceleration = np.zeros(3) if velocity is None else (now - velocity) / step_s
        force = float(watched.model.body_mass[body]) * np.linalg.norm(acceleration - watched.model.opt.gravity)
        self._note(InterventionKind.FIXED, name, at_s, float(force) * step_s)

    @staticmethod
    def _size(model: mujoco.MjModel, body: int) -> float:
        geoms = np.flatnonzero(model.geom_bodyid == body)
        return max(LEAST_LEVER_M, float(model.geom_rbound[geoms].max(initial=0.0)))

    # -- distances -----------------------------------------------------------------------------------------------------

    def _sample(self, state: _State) -> None:
        """Measures the distances of the robot from everything that is near it."""
        shapes = state.watched.shapes
        shapes.data.qpos[:], shapes.data.mocap_pos[:] = state.qpos, state.mocap
        if self._data is not None:
            shapes.data.mocap_quat[:] = self._data.mocap_quat
        shapes.update()
        robot, place = state.watched.robot_geoms, state.watched.place_geoms
        if not self.first:
            self.first = self.poses()
        depths: dict[tuple[str, str], float] = {}
        for a, b, distance in shapes.pairs(robot, place, NEAR_M):
            part, thing = shapes.owners[a], shapes.owners[b]
            self.nearest_m[thing] = min(distance, self.nearest_m.get(thing, NEAR_M))
            depths[part, thing] = max(-distance, depths.get((part, thing), 0.0))
        if self._initial is None:
            self._initial = {}
            for (_, thing), depth in depths.items():
                self._initial[thing] = max(depth, self._initial.get(thing, 0.0))
        for pair, depth in depths.items():
            self.deepest[pair] = max(depth, self.deepest.get(pair, 0.0))
            if depth > DEEP_M + self._initial.get(pair[1], 0.0):
                self._note(InterventionKind.OVERLAP, pair[1], state.time_s, 0.0, depth)

    def poses(self) -> dict[str, Floats]:
        """The pose of each body, seven numbers, when distances were last measured."""
        shapes, names = self._watched().shapes, self._watched().names
        poses = np.concatenate([shapes.data.xpos, shapes.data.xquat], axis=1)
        return {name: poses[row].copy() for row, name in enumerate(names) if name}

    # -- what a skill promises -----------------------------------------------------------------------------------------

    def position(self, body: str) -> tuple[float, float, float]:
        """The position of the joint of a front, and its limits [m or rad]; for a joint without limits infinities."""
        state, model = self._state_now(), self._watched().model
        number = self._watched().names.index(body)
        joint = int(model.body_jntadr[number])
        assert joint >= 0, f"{body} has no joint"
        low, high = model.jnt_range[joint].tolist() if model.jnt_limited[joint] else (-np.inf, np.inf)
        return float(state.qpos[model.jnt_qposadr[joint]]), low, high

    def speeds(self) -> dict[str, float]:
        """How fast each loose body is [m/s]."""
        state, model = self._state_now(), self._watched().model
        return {
            self._watched().names[model.jnt_bodyid[joint]]: float(
                np.linalg.norm(state.qvel[model.jnt_dofadr[joint] : model.jnt_dofadr[joint] + 3])
            )
            for joint in np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
        }

    def openness(self, body: str, closed: float) -> float:
        """How far a front is open, from 0 to 1, between its closed position and the limit that is farther from it."""
        position, low, high = self.position(body)
        return abs(position - closed) / max(high - closed, closed - low)

    def why_not_lifted(self, body: str) -> str:
        """Why a thing is not held above where it was; empty if it is."""
        shapes, watched = self._watched().shapes, self._watched()
        if body not in watched.names:
            return f"{body} is fixed to the world"
        own, rise = shapes.of(body), self.poses()[body][2] - self.first[body][2]
        touching = {shapes.owners[b] for _, b, _ in shapes.pairs(own, np.setdiff1d(watched.place_geoms, own), REST_M)}
        is_fixed = any(watched.names[each] == body for each in watched.fixed)
        gap = min((each for _, _, each in shapes.pairs(own, watched.robot_geoms, NEAR_M)), default=np.inf)
        if not is_fixed and gap > REST_M:
            return f"the robot is {gap * 1000:.1f} mm from {body}"
        if rise < LIFTED_M and touching:
            return f"{body} was lifted by {rise * 1000:.1f} mm and touches {', '.join(sorted(touching))}"
        return ""

    def why_not_on(self, body: str, support: str) -> str:
        """Why a thing does not rest on a support, directly or on other things; empty if it does."""
        shapes, watched, state = self._watched().shapes, self._watched(), self._state_now()
        if body not in watched.names:
            return f"{body} is fixed to the world"
        number = watched.names.index(body)
        speeds = state.qvel[np.flatnonzero(watched.model.dof_bodyid == number)[:3]]
        if not len(speeds):
            return f"{body} is fixed to {watched.names[watched.model.body_parentid[number]]}"
        if np.linalg.norm(speeds) > REST_SPEED:
            return f"{body} moves by {np.linalg.norm(speeds):.2f} m/s"
        own = shapes.of(body)
        if any(True for _ in shapes.pairs(own, watched.robot_geoms, TOUCHING_M)):
            return f"the robot touches {body}"
        reached, frontier = {body}, [body]
        while frontier:
            own = shapes.of(frontier.pop())
            others = np.setdiff1d(watched.place_geoms, shapes.of(*reached))
            below = others[shapes.low[others, 2] <= shapes.high[own, 2].max()]
            found = {shapes.owners[b] for _, b, _ in shapes.pairs(own, below, REST_M)} - reached
            if support in found:
                return ""
            moving = {watched.names[each] for each in watched.bodies}
            reached |= found
            frontier += sorted(found & moving)
        return f"{body} rests on {', '.join(sorted(reached - {body})) or 'nothing'}"

    def false_reasons(self, reason: str, target: str, closed: float | None = None) -> list[str]:
        """What a stated reason of a failure says against the geometry; nothing where it cannot be judged.

        Judged are: the openness of a front, if its closed position is given; that the robot was pressed into something
        it never was within 2 cm of; that what the robot has touched is beyond its reach; and an obstacle that is more
        than 5 cm from all that the target sweeps over its range, if the target would hit it, or farther from it than
        the robot is long, if the robot would.

        Args:
            target: the front or the thing that the skill was about.
        """
        found, own = [], self._moving_with(target)
        for front, percent in STATED.findall(reason):
            if closed is not None and front == target:
                openness = self.openness(front, closed)
                if abs(openness - int(percent) / 100) > STATED_ERROR:
                    found.append(f"{front} is {openness:.0%} open, not {percent}%")
        for thing in PRESSED.findall(reason):
            if thing in self.first and thing not in self.nearest_m:
                found.append(f"the robot was never within {NEAR_M * 1000:.0f} mm of {thing}")
        touched = [name for name in own if self.nearest_m.get(name, 1.0) < TOUCHING_M]
        if "beyond the reach" in reason and touched:
            found.append(f"the robot has touched {touched[0]}")
        for part, obstacle in INSIDE.findall(reason):
            obstacle = obstacle.rstrip(",;.:")
            allowed = AROUND_M if part in own else self.reach_m
            if not self._watched().shapes.of(obstacle).size or obstacle in own | self.robot:
                continue
            if part in own | self.robot and not self._is_around_sweep(target, obstacle, allowed):
                found.append(f"{obstacle} is more than {allowed:.2f} m from all that {target} sweeps")
        return found

    def _moving_with(self, body: str) -> set[str]:
        """A thing and what is fixed to it, such as its handle."""
        watched = self._watched()
        if body not in watched.names:
            return {body}
        group = watched.model.body_weldid[watched.names.index(body)]
        return {watched.names[each] for each in np.flatnonzero(watched.model.body_weldid == group)}

    def _is_around_sweep(self, body: str, obstacle: str, within_m: float) -> bool:
        """Whether an obstacle is near to what a thing passes over its whole range, or where it is."""
        watched, state = self._watched(), self._state_now()
        shapes, model = watched.shapes, watched.model
        own, other = shapes.of(*self._moving_with(body)), shapes.of(obstacle)
        joint = int(model.body_jntadr[watched.names.index(body)]) if body in watched.names else -1
        hinged = joint >= 0 and model.jnt_limited[joint] and model.jnt_type[joint] in (2, 3)
        try:
            low, high = model.jnt_range[joint].tolist()
            for position in np.linspace(low, high, SWEEP_POSES) if hinged else (None,):
                shapes.data.qpos[:] = state.qpos
                if position is not None:
                    shapes.data.qpos[model.jnt_qposadr[joint]] = position
                shapes.update()
                if any(True for _ in shapes.pairs(own, other, within_m)):
                    return True
            return False
        finally:
            shapes.data.qpos[:] = state.qpos
            shapes.update()

    def _state_now(self) -> _State:
        assert self._last is not None, "nothing was watched"
        return self._last

    def _watched(self) -> _Watched:
        assert self._models, "nothing was watched"
        return self._models[0] if self._last is None else self._last.watched

    # -- models --------------------------------------------------------------------------------------------------------

    def _read(self, model: mujoco.MjModel) -> _Watched:
        names = [self._name_of(model.body(body).name) for body in range(model.nbody)]
        is_robot = np.array([name in self.robot for name in names])
        for body in range(1, model.nbody):  # a parent comes before its children
            is_robot[body] |= is_robot[model.body_parentid[body]]
        fixed = [body for body in range(1, model.nbody) if is_robot[body] and names[body] not in self.robot]
        owners = self._owners(model)
        shapes = Shapes(model, mujoco.MjData(model), owners)
        if owners is None:
            shapes.owners = np.array([names[body] for body in model.geom_bodyid], dtype=object)
        of_robot = np.isin(model.geom_bodyid, [body for body in np.flatnonzero(is_robot) if body not in fixed])
        of_place = ~np.isin(model.geom_bodyid, np.flatnonzero(is_robot))
        dofs = np.flatnonzero(~is_robot[model.dof_bodyid])
        bodies = np.array([body for body in range(1, model.nbody) if not is_robot[body] and model.body_weldid[body]])
        mocap = [int(model.body_mocapid[body]) for body in range(model.nbody) if not is_robot[body]]
        levers, masses = _levers(model)
        if self._sprung is None:
            self.reach_m = _reach_m(model, is_robot)
            self._sprung = frozenset(names[model.jnt_bodyid[joint]] for joint in np.flatnonzero(model.jnt_stiffness))
            self._floating = frozenset(names[body] for body in np.flatnonzero(model.body_gravcomp))
        names_of_dofs = np.array([names[model.dof_bodyid[dof]] for dof in dofs], dtype=str)
        return _Watched(
            model=model,
            names=names,
            shapes=shapes,
            robot_geoms=np.intersect1d(np.flatnonzero(of_robot), shapes.solid),
            place_geoms=np.intersect1d(np.flatnonzero(of_place), shapes.solid),
            fixed=fixed,
            bodies=bodies.astype(np.intp),
            dofs=dofs,
            body_of_dof=np.asarray(model.dof_bodyid, dtype=np.intp),
            levers=levers,
            masses=masses,
            coordinates=_coordinates(model, names),
            equalities=np.array(list(_equalities(model, is_robot)), dtype=np.intp),
            mocap=np.array([row for row in mocap if row >= 0], dtype=np.intp),
            sprung=np.isin(names_of_dofs, sorted(self._sprung)),
            floating=np.isin(names_of_dofs, sorted(self._floating)),
        )


def _reach_m(model: mujoco.MjModel, is_robot: NDArray[np.bool_]) -> float:
    """By the lengths of links and the ranges of slides; slides of more than 2 m are those of a base that drives."""
    lengths, found = np.zeros(model.nbody), 0.0
    for body in np.flatnonzero(is_robot).tolist():
        parent = int(model.body_parentid[body])
        slides = [
            float(np.abs(model.jnt_range[joint]).max())
            for joint in np.flatnonzero((model.jnt_bodyid == body) & (model.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE))
            if model.jnt_limited[joint] and np.abs(model.jnt_range[joint]).max() < MAX_SLIDE_M
        ]
        if is_robot[parent]:
            lengths[body] = lengths[parent] + float(np.linalg.norm(model.body_pos[body]))
        lengths[body] += sum(slides)
        for geom in np.flatnonzero(model.geom_bodyid == body):
            own = float(np.linalg.norm(model.geom_pos[geom]) + model.geom_rbound[geom])
            found = max(found, float(lengths[body]) + own)
    return found


def _coordinates(model: mujoco.MjModel, names: Sequence[str]) -> dict[tuple[str, int], tuple[slice, slice]]:
    sizes = {0: (7, 6), 1: (4, 3), 2: (1, 1), 3: (1, 1)}
    found: dict[tuple[str, int], tuple[slice, slice]] = {}
    for joint in range(model.njnt):
        body = int(model.jnt_bodyid[joint])
        position, velocity = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
        long, short = sizes[int(model.jnt_type[joint])]
        key = names[body], joint - int(model.body_jntadr[body])
        found[key] = slice(position, position + long), slice(velocity, velocity + short)
    return found


def _levers(model: mujoco.MjModel) -> tuple[Floats, Floats]:
    """The distance of the center of mass from the axis of each degree of freedom that turns, else 1; and the mass."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    levers, masses = np.ones(model.nv), np.zeros(model.nv)
    for dof in range(model.nv):
        joint, body = int(model.dof_jntid[dof]), int(model.dof_bodyid[dof])
        masses[dof] = model.body_subtreemass[body]
        match model.jnt_type[joint]:
            case mujoco.mjtJoint.mjJNT_HINGE:
                arm = np.cross(data.xaxis[joint], data.subtree_com[body] - data.xanchor[joint])
                levers[dof] = max(LEAST_LEVER_M, float(np.linalg.norm(arm)))
            case mujoco.mjtJoint.mjJNT_SLIDE:
                pass
            case _ if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_BALL or dof - model.jnt_dofadr[joint] >= 3:
                levers[dof] = SkillReferee._size(model, body)
            case _:
                pass
    return levers, masses


def _equalities(model: mujoco.MjModel, is_robot: NDArray[np.bool_]) -> Iterator[int]:
    """The equality constraints that act on something of the place, those of tendons included."""
    for row in range(model.neq):
        ends = [int(each) for each in (model.eq_obj1id[row], model.eq_obj2id[row]) if each >= 0]
        match model.eq_type[row]:
            case mujoco.mjtEq.mjEQ_CONNECT | mujoco.mjtEq.mjEQ_WELD:
                if model.eq_objtype[row] == mujoco.mjtObj.mjOBJ_SITE:
                    ends = [int(model.site_bodyid[end]) for end in ends]
            case mujoco.mjtEq.mjEQ_JOINT:
                ends = [int(model.jnt_bodyid[end]) for end in ends]
            case _:
                yield row
                continue
        if any(end and not is_robot[end] for end in ends):
            yield row
