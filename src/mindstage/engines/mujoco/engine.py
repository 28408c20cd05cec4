"""MujocoEngine: a world in MuJoCo.

Static bodies are fixed to the world, and so are kinematic ones until one of them is moved; then they are mocap bodies.
Dynamic ones move freely, and constraints make kinematic trees of them. An edit only marks the model as stale; the next
call that needs physics builds it once, and what was running goes on (see `carry`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

import mujoco
import numpy as np

from mindstage.engines.contract import Ability, Note, NoteKind, Poses, SpawnReport, State, Statistics
from mindstage.engines.inventory import placeable
from mindstage.engines.joints import place_of
from mindstage.engines.mujoco.carry import coordinates, put, wake
from mindstage.engines.mujoco.live import Live
from mindstage.engines.mujoco.scene import SceneKeeper
from mindstage.engines.travelling import require_reachable
from mindstage.errors import EngineClosed, PoseUnreachable, SimulationUnstable
from mindstage.world import NO_FORMS, BodyId, Colour, Forms, Material, Physics, Pose, Vector, World
from mindstage.world.geometry import Array, compose, invert, pose_array, pose_from, rotation_angle, unit_pose

__all__ = ["MujocoEngine"]

_SAME = 1e-12
"""A pose that differs by less from the described one is the described one [m, rad]; larger numbers round more."""


class MujocoEngine:
    """The contract, kept by MuJoCo."""

    name = "mujoco"
    abilities = frozenset({Ability.SAVE, Ability.JOINTS, Ability.STATISTICS})

    def __init__(self, *, timestep_s: float = 0.002) -> None:
        """An empty world.

        Args:
            timestep_s: MuJoCo's time step [s].
        """
        self._keeper = SceneKeeper(timestep_s)
        self._timestep_s = timestep_s
        self._owed_s = 0.0
        self._pushes: list[tuple[BodyId, Array, Array | None]] = []
        self._closed = False

    @property
    def time_s(self) -> float:
        """See the contract, here and below."""
        return self._open().time_s

    def spawn(self, world: World, *, forms: Forms = NO_FORMS) -> SpawnReport:
        return self._open().add(world, forms=forms)

    def delete(self, ids: Iterable[BodyId]) -> None:
        self._open().remove(tuple(ids))

    def clear(self) -> None:
        self._keeper = SceneKeeper(self._timestep_s, time_s=self._open().time_s)
        self._pushes.clear()

    def attach(self, parent: BodyId, child: BodyId) -> None:
        self._open().attach(parent, child)

    def detach(self, child: BodyId) -> None:
        self._open().detach(child)

    def set_pose(self, id: BodyId, pose: Pose) -> None:
        keeper = self._open()
        keeper.inventory.body(id)
        if reason := placeable(pose):
            raise PoseUnreachable(id, reason=reason)
        target = unit_pose(pose)
        if id in keeper.forest.branches:
            keeper.live()  # how far a joint goes is known to the model
        if not keeper.stale and self._move_in_place(keeper, id, target):
            keeper.inventory.replace(id, pose=pose)
            return
        keeper.move(id, target)
        keeper.inventory.replace(id, pose=pose)

    def set_physics(self, id: BodyId, physics: Physics) -> None:
        self._open().set_physics(id, physics)

    def set_materials(self, id: BodyId, materials: tuple[Material, ...]) -> None:
        self._open().inventory.replace(id, materials=materials)

    def highlight(self, ids: Iterable[BodyId], colour: Colour | None) -> None:
        self._open().inventory.highlight(ids, colour)

    def highlights(self) -> Mapping[BodyId, Colour]:
        return MappingProxyType(self._open().inventory.lit)

    def push(self, id: BodyId, force: Vector, at: Vector | None = None) -> None:
        self._open().inventory.body(id)
        self._pushes.append((id, np.asarray(force, dtype=float), None if at is None else np.asarray(at, dtype=float)))

    def step(self, duration_s: float) -> None:
        keeper = self._open()
        self._owed_s += duration_s
        steps = int(self._owed_s / self._timestep_s + 1e-6)
        if steps <= 0:
            return
        self._owed_s = max(0.0, self._owed_s - steps * self._timestep_s)
        live = keeper.live()
        if self._pushes:
            self._apply_pushes(live)
        mujoco.mj_step(live.model, live.data, nstep=steps)
        mujoco.mj_kinematics(live.model, live.data)
        if self._pushes:
            live.data.xfrc_applied[:] = 0.0
            self._pushes.clear()
        keeper.late_notes.extend(_check(live))

    def poses(self) -> tuple[tuple[BodyId, ...], Poses]:
        keeper = self._open()
        return keeper.inventory.ids, keeper.where()

    def joint_positions(self) -> Mapping[BodyId, tuple[float, ...]]:
        keeper = self._open()
        live, where = keeper.live(), keeper.where_by_id()
        positions = {}
        for id, joint in live.joints.items():
            constraint = joint.branch.constraint
            of_parent, of_child = keeper.planner.ends[id]
            fixed = compose(where[constraint.parent], of_parent)
            moving = compose(where[constraint.child], of_child)
            positions[id] = tuple(place_of(compose(invert(fixed), moving), joint.axes).tolist())
        return positions

    def statistics(self) -> Statistics:
        live = self._open().last_live
        sleep = np.zeros(0) if live is None else live.data.body_awake
        return Statistics(
            movable=int(np.count_nonzero(sleep >= int(mujoco.mjtSleepState.mjS_ASLEEP))),
            awake=int(np.count_nonzero(sleep == int(mujoco.mjtSleepState.mjS_AWAKE))),
            contacts=0 if live is None else int(live.data.ncon),
            timestep_s=self._timestep_s,
        )

    def log(self) -> World:
        keeper = self._open()
        keeper.live()  # a log tells what the physics has, not what it is about to be given
        now = keeper.where()
        given = pose_array(body.pose for body in keeper.inventory.bodies.values())
        scale = np.maximum(1.0, np.abs(given[:, :3]).max(axis=1, initial=1.0))
        stayed = (np.abs(now[:, :3] - given[:, :3]).max(axis=1, initial=0.0) <= _SAME * scale) & (
            rotation_angle(given[:, 3:], now[:, 3:]) <= _SAME
        )
        rows = np.flatnonzero(~stayed).tolist()
        return keeper.inventory.world({keeper.inventory.ids[row]: pose_from(now[row]) for row in rows})

    def save(self) -> State:
        return State(self._open().copy())

    def restore(self, state: State) -> None:
        self._open()
        if not isinstance(state, SceneKeeper):
            raise TypeError(f"a state that MujocoEngine.save made is needed, not {type(state).__name__}")
        self._keeper = state.copy()
        self._pushes.clear()
        self._owed_s = 0.0

    def close(self) -> None:
        self._closed = True

    @property
    def notes(self) -> tuple[Note, ...]:
        """What had to be decided because of edits, and what the physics warned of (a spawn's own are in its report)."""
        return tuple(self._open().late_notes)

    def _open(self) -> SceneKeeper:
        if self._closed:
            raise EngineClosed(self.name)
        return self._keeper

    def _apply_pushes(self, live: Live) -> None:
        for id, force, at in self._pushes:
            number = live.numbers.get(id)
            if number is None:
                continue
            live.data.xfrc_applied[number, :3] += force
            if at is not None:
                live.data.xfrc_applied[number, 3:] += np.cross(at - live.data.xipos[number], force)

    def _move_in_place(self, keeper: SceneKeeper, id: BodyId, target: Array) -> bool:
        """Moves what needs no new model: what is free, kinematic, or on a joint. False for the rest."""
        keeper.drive(id)
        live = keeper.live()
        moving = keeper.planner.reach(id)
        if id in live.free:
            position, velocity = live.free[id]
            live.data.qpos[position : position + 7] = target
            live.data.qvel[velocity : velocity + 6] = 0.0
        elif id in live.mocap:
            live.data.mocap_pos[live.mocap[id]] = target[:3]
            live.data.mocap_quat[live.mocap[id]] = target[3:]
        elif (branch := keeper.forest.branches.get(id)) is not None:
            self._turn_joint(keeper, id, branch.constraint.id, target)
        else:
            return False
        before = keeper.bounds(moving)
        mujoco.mj_kinematics(live.model, live.data)
        wake(live, np.stack([before, keeper.bounds(moving)]))
        return True

    def _turn_joint(self, keeper: SceneKeeper, id: BodyId, constraint: BodyId, target: Array) -> None:
        """Puts a body on a joint where it is asked to be.

        Raises:
            PoseUnreachable: its joint does not go there.
        """
        live, where = keeper.live(), keeper.where_by_id()
        require_reachable(keeper.planner, id, target, where)
        joint = live.joints[constraint]
        child_from_top = compose(invert(where[id]), where[joint.branch.child])
        asked = {**where, joint.branch.child: compose(target, child_from_top)}
        put(live, joint, coordinates(joint, asked, keeper.planner.ends[constraint]))


_BROKEN = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)


def _check(live: Live) -> list[Note]:
    """What MuJoCo warned of since the last call.

    Raises:
        SimulationUnstable: it saw numbers that mean nothing.
    """
    notes = []
    for kind in range(int(mujoco.mjtWarning.mjNWARNING)):
        entry = live.data.warning[kind]
        if not entry.number:
            continue
        entry.number = 0
        warning = mujoco.mjtWarning(kind)
        if warning in _BROKEN:
            body = live.model.body(int(live.model.dof_bodyid[entry.lastinfo])).name.removeprefix("body:")
            quantity = warning.name.removeprefix("mjWARN_BAD").lower()
            what = f"the {quantity} of {body!r} is not a number or far too large"
            raise SimulationUnstable(time_s=float(live.data.time), what=what)
        text = f"at {live.data.time:.3f} s MuJoCo warned: {mujoco.mju_warningText(kind, entry.lastinfo)}"
        notes.append(Note(NoteKind.SOLVER, (), text))
    return notes


# MuJoCo counts its warnings, and `_check` tells them; the file that it would write them to as well has no place in
# the folder from which somebody happens to work.
mujoco.set_mju_user_warning(lambda text: None)
