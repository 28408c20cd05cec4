"""Random edits of a running simulation, with undo as an invariant.

A run is a world and a list of steps, each the name of an edit and a number that seeds its choices, so that a part of a
list can be run, too. What is compared shares no code with undo: the snapshot, and the joint anchors and axes, masses
and actuators of the MuJoCo model, also with those of a new engine in which the snapshot is spawned.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack
from math import pi
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
from msgspec.structs import replace

from mindstage import KnowledgeBase, MujocoEngine, NullEngine, Simulation
from mindstage.engines import Engine
from mindstage.episodes import Episode, Recorder
from mindstage.errors import InvalidArgumentError, MindstageError
from mindstage.robots import add_robot, find_robot
from mindstage.scene import Body, BodyGeometry, BodyId, Iri, Material, Mobility, Pose, World
from mindstage.scene.edits import Spawn, edit_from_json, edit_to_json
from mindstage.scene.transforms import (
    Array,
    normalized_pose_array,
    pose_from_array,
    pose_multiply,
    quat_angle,
    quat_conjugate,
    quat_rotate,
)
from mindstage.simulation import JointHandle, SpawnRecord
from mindstage.simulation.body_groups import BodyGroup, paste_group
from tests.kitchenette import kitchenette

__all__ = ["STARTS", "RandomEdits", "Start", "Step", "random_steps", "run", "shrunk"]

_ROBOT_PLACES = ((0.3, -1.5, 0.0), (0.5, 2.2, 0.0), (-1.5, 0.2, 0.0))
_POSE_TOLERANCE = 1e-6
"""[m, rad]."""
_SETTLED_TOLERANCE_M = 2e-3
"""A body that a spawn moved out of others, and that rests there, is shown where it was described [m, rad]."""
_STEP_S = 0.06
_NOT_IN_HISTORY = ("step", "tell", "reset_to_start", "saved_state", "drive", "world", "replace_world")


class Step(NamedTuple):
    """One edit of a run."""

    name: str
    seed: int


class Start(NamedTuple):
    """What a run begins with."""

    world: Callable[[], World | str]
    engine: Callable[[], Engine]
    robot: str = ""
    watched: bool = False
    """Whether a copy is made, and an episode recorded, which must not be affected by the edits."""


def _loose_kitchenette() -> World:
    """The kitchenette with a fridge that can be moved by physics, a lamp on a ball joint, and a mimicking drawer."""
    world = kitchenette()
    loose = {"Fridge"}
    bodies = tuple(
        replace(body, physics=replace(body.physics, mobility=Mobility.DYNAMIC, gravity=True, mass_kg=40.0))
        if body.id in loose
        else body
        for body in world.bodies
    )
    return replace(world, bodies=bodies)


STARTS: Mapping[str, Start] = {
    "kitchenette": Start(kitchenette, NullEngine),
    "kitchenette with a robot": Start(kitchenette, MujocoEngine, robot="mobile_manipulator", watched=True),
    "loose kitchenette": Start(_loose_kitchenette, MujocoEngine, watched=True),
    "kitchen": Start(lambda: "bundled:kitchen", MujocoEngine, robot="mobile_manipulator", watched=True),
}


class _Seen(NamedTuple):
    """The state of a simulation, as a user sees it and as it is simulated."""

    world: World
    model: Mapping[str, Mapping[str, Array]]
    bits: bytes = b""
    """All that MuJoCo continues from: positions, velocities, sleep."""


class _JsonCheck:
    """An observer that reads each edit from its JSON again."""

    interval_s = 0.1

    def __init__(self) -> None:
        self.geometry: dict[str, BodyGeometry] = {}
        self.count = 0

    def on_state(self, state: object, engine: Engine, *, edited: bool, rebuild_pending: bool) -> None:
        pass

    def on_edit(self, kind: str, *, client: str, ids: object, details: Mapping[str, Any]) -> None:
        for edit in (*((details["edit"],) if "edit" in details else ()), *details.get("edits", ())):
            self.geometry |= {each.key: each for each in edit.geometries()}
            text = edit_to_json(edit)
            assert edit_to_json(edit_from_json(text, geometry=self.geometry.values())) == text, edit.label
            self.count += 1


class RandomEdits:
    """A simulation that is edited at random."""

    def __init__(self, start: Start, folder: Path) -> None:
        """Spawns the world.

        Args:
            start: what to begin with.
            folder: where the episode is written.
        """
        self._stack, self._folder = ExitStack(), folder
        self.log: list[str] = []
        world = start.world()
        self._knowledge = KnowledgeBase(bundled_ontology=isinstance(world, str))
        if isinstance(world, str):
            self._knowledge.load(world)
        is_bundled = isinstance(world, str)
        self.sim = self._stack.enter_context(
            Simulation(self._knowledge, start.engine(), primitive_shapes=not is_bundled, timeout_s=120.0)
        )
        self.sim.spawn(None if is_bundled else world)
        self.json_check = _JsonCheck()
        self.sim.observers.add(self.json_check)
        self._robot = start.robot
        if start.robot:
            self._add_robot(random.Random(1))
        self._copy: Simulation | None = None
        if start.watched:
            self._copy = self._stack.enter_context(self.sim.fork())
            self._copied = seen(self._copy)
            self._episode = folder / "soak.mcap"
            self._episode.unlink(missing_ok=True)
            self._recorder = Recorder(self.sim, self._episode, rate_hz=10.0)

    @property
    def edits(self) -> Mapping[str, Callable[[random.Random], object]]:
        """All edits by name."""
        return {
            name.removeprefix("edit_"): getattr(self, name) for name in sorted(dir(self)) if name.startswith("edit_")
        }

    def do(self, step: Step) -> None:
        """Makes one edit, and checks that it can be undone and redone, if it is one of the history."""
        rng, edits = random.Random(step.seed), self.sim.edits
        before, version, count = seen(self.sim), edits.version, len(edits.history.undo)
        try:
            done = self.edits[step.name](rng)
        except MindstageError as error:
            self.log.append(f"{step.name}: refused: {error}")
            if edits.version == version:
                check(before, seen(self.sim), f"{step.name} was refused, but has changed something")
            return
        self.log.append(f"{step.name}: {done}")
        self._check_fresh("after")
        if len(edits.history.undo) != count + 1:
            return
        after = seen(self.sim)
        if rng.random() < 0.7:
            self.log.append("undo, redo")
            edits.undo()
            check(before, seen(self.sim), f"undo of {step.name}", exactly=True)
            self._check_fresh("after undo of")
            edits.redo()
            check(after, seen(self.sim), f"redo of {step.name}")
        if rng.random() < 0.3:
            self.sim.step(_STEP_S)
            self.log.append(f"step, undo of {step.name}")
            stepped = self.sim.snapshot()
            edits.undo()
            self._check_after_step(before.world, after.world, stepped, step.name)
            self._check_fresh("after a step and undo of")
        elif rng.random() < 0.3:
            self.log.append("undo")
            edits.undo()
            check(before, seen(self.sim), f"second undo of {step.name}", exactly=True)

    def undo_all(self) -> None:
        """Undoes and redoes the last edits, each of which was made without a step in between."""
        edits = self.sim.edits
        edits.clear()
        start, rng = seen(self.sim), random.Random(len(self.log))
        names = [name for name in self.edits if name not in _NOT_IN_HISTORY]
        for _ in range(8):
            name = rng.choice(names)
            try:
                self.log.append(f"{name}: {self.edits[name](rng)}")
            except MindstageError as error:
                self.log.append(f"{name}: refused: {error}")
        end, count = seen(self.sim), len(edits.history.undo)
        self.log.append(f"undo of {count} edits")
        edits.go_to(0)
        check(start, seen(self.sim), "undo of all edits", exactly=True)
        edits.go_to(count)
        check(end, seen(self.sim), "redo of all edits")

    def finish(self) -> None:
        """Checks the copy and the episode, and closes the simulation."""
        try:
            if self._copy is not None:
                check(self._copied, seen(self._copy), "the copy has changed")
                world = self.sim.snapshot()
                self._recorder.stop()
                with Episode(self._episode) as episode:
                    recorded = episode.frame_at(episode.end_s)
                    assert set(recorded.ids) == {body.id for body in world.bodies}, "the episode lacks bodies"
        finally:
            self.close()

    def close(self) -> None:
        """Closes the simulation, its copy and the recording."""
        self._stack.close()

    # -- edits of the history ----------------------------------------------------------------------------------

    def edit_move(self, rng: random.Random) -> object:
        body = self._body(rng)
        pose = self._near(body, rng)
        self.sim.edits.move(body.id, pose)
        return body.id, pose

    def edit_move_all(self, rng: random.Random) -> object:
        world = self.sim.snapshot()
        bodies = rng.sample(world.bodies, k=min(3, len(world.bodies)))
        self.sim.edits.move_all({body.id: self._near(body, rng) for body in bodies})
        return [body.id for body in bodies]

    def edit_delete(self, rng: random.Random) -> object:
        world = self.sim.snapshot()
        bodies = rng.sample(world.bodies, k=min(rng.choice((1, 1, 1, 2, 3)), len(world.bodies)))
        return self.sim.edits.delete(
            [body.id for body in bodies], parts=rng.random() < 0.4, contents=rng.random() < 0.4
        )

    def edit_delete_joint_end(self, rng: random.Random) -> object:
        world = self.sim.snapshot()
        if not world.joints:
            return "no joint"
        joint = rng.choice(world.joints)
        return self.sim.edits.delete([rng.choice((joint.parent, joint.child))], parts=rng.random() < 0.3)

    def edit_attach(self, rng: random.Random) -> object:
        parent, child = self._body(rng).id, self._body(rng).id
        if self._are_connected(parent, child):
            return "joints connect them already"
        self.sim.edits.attach(parent, child)
        return parent, child

    def edit_detach(self, rng: random.Random) -> object:
        attachments = self.sim.snapshot().attachments
        if not attachments:
            return "nothing is attached"
        child = rng.choice(attachments).child
        self.sim.edits.detach(child)
        return child

    def edit_material(self, rng: random.Random) -> object:
        body, color = self._body(rng), (rng.random(), rng.random(), rng.random())
        materials = [Material(name=rng.choice(("paint", "oak", "steel")), color=color)] if rng.random() < 0.8 else []
        self.sim.edits.set_materials(body.id, materials)
        return body.id, materials

    def edit_physics(self, rng: random.Random) -> object:
        body = self._body(rng)
        changes = rng.choice(
            (
                {"mass_kg": rng.uniform(0.1, 20.0)},
                {"gravity": rng.random() < 0.5},
                {"mobility": rng.choice(tuple(Mobility))},
                {"overlap_events": rng.random() < 0.5},
            )
        )
        self.sim.edits.set_physics(body.id, replace(body.physics, **changes))
        return body.id, changes

    def edit_rename(self, rng: random.Random) -> object:
        body, label = self._body(rng), rng.choice(("", "cup of Ann", "<b>x</b>", "näme"))
        self.sim.edits.set_label(body.id, label)
        return body.id, label

    def edit_joint(self, rng: random.Random) -> object:
        world = self.sim.snapshot()
        bodies = {body.id: body for body in world.bodies}
        handles = [JointHandle(joint, bodies, SpawnRecord.from_worlds(self.sim.worlds)) for joint in world.joints]
        handles = [each for each in handles if each.axes]
        if not handles:
            return "no joint moves"
        handle = rng.choice(handles)
        axis = rng.choice(handle.axes)
        low, high = (-1.0 if axis.lower is None else axis.lower), (1.0 if axis.upper is None else axis.upper)
        value = rng.uniform(low, high)
        poses = {id: normalized_pose_array(body.pose) for id, body in bodies.items()}
        self.sim.edits.move(handle.moving_body, handle.pose_for(axis.name, value, poses))
        return handle.joint.id, axis.name, value

    def edit_add(self, rng: random.Random) -> object:
        example = self._body(rng)
        body = replace(_renamed(example, f"Added{rng.randrange(10**6)}"), pose=self._near(example, rng))
        world = World(iri=Iri("http://x.org/added.owl#map"), bodies=(body,))
        self.sim.spawn(world, persistent=rng.random() < 0.3, title=f"{body.id} added")
        return body.id

    def edit_paste(self, rng: random.Random) -> object:
        return paste_group(self.sim, BodyGroup.from_world(self.sim.snapshot(), (self._body(rng).id,)))

    def edit_place(self, rng: random.Random) -> object:
        bodies = self.sim.snapshot().bodies
        loose = [body for body in bodies if body.physics.is_dynamic]
        if not loose:
            return "nothing is loose"
        item, holder = rng.choice(loose), rng.choice(bodies)
        placed = self.sim.place(_renamed(item, f"Placed{rng.randrange(10**6)}"), on=holder.id, title="placed")
        return placed.id, holder.id

    def edit_one_step(self, rng: random.Random) -> object:
        with self.sim.edits.one_step("tidy up"):
            return [self.edit_rename(rng), self.edit_move(rng), self.edit_delete(rng)]

    def edit_reset(self, rng: random.Random) -> object:
        self.sim.edits.reset()
        return "reset"

    def edit_replace_world(self, rng: random.Random) -> object:
        if rng.random() < 0.7:
            return "not this time"
        self.sim.replace_world(self.sim.worlds[0])
        return "replaced"

    # -- what is not in the history ----------------------------------------------------------------------------

    def edit_step(self, rng: random.Random) -> object:
        duration_s = rng.choice((0.01, _STEP_S, 0.2))
        self.sim.step(duration_s)
        return duration_s

    def edit_tell(self, rng: random.Random) -> object:
        number = rng.randrange(100)
        return self._knowledge.tell(f"http://x.org/a.owl#thing{number}", "type", "http://x.org/a.owl#Thing")

    def edit_reset_to_start(self, rng: random.Random) -> object:
        if rng.random() < 0.7:
            return "not this time"
        self.sim.reset(to_start=True, keep_spawned=rng.random() < 0.5)
        return "reset to start"

    def edit_saved_state(self, rng: random.Random) -> object:
        before = seen(self.sim)
        state = self.sim.engine.run(lambda engine: engine.save_state())
        self.sim.edits.move(self._body(rng).id, Pose((0.0, 0.0, 3.0)))
        self.sim.step(0.02)
        self.sim.engine.run(lambda engine: engine.restore_state(state), edits=True)
        check(before, seen(self.sim), "a restored state")
        self.sim.edits.clear()
        return "restored"

    def edit_robot(self, rng: random.Random) -> object:
        if not self._robot:
            return "no robot"
        if self.sim.robots and rng.random() < 0.5:
            robot = find_robot(self.sim, rng.choice(sorted(self.sim.robots)))
            robot.remove()
            return f"{robot.name} removed"
        if len(self.sim.robots) > 1:
            return "enough robots"
        return self._add_robot(rng)

    def edit_drive(self, rng: random.Random) -> object:
        if not self.sim.robots:
            return "no robot"
        robot = self.sim.robots[rng.choice(sorted(self.sim.robots))]
        x, y, yaw = robot.base_pose()
        place = (x + rng.uniform(-0.1, 0.1), y + rng.uniform(-0.1, 0.1), yaw + rng.uniform(-1.0, 1.0))
        robot.set_base_pose(*place)
        return robot.name, place

    def edit_hold(self, rng: random.Random) -> object:
        """Attaches a body to a link of a robot, as if it were held."""
        if not self.sim.robots:
            return "no robot"
        robot = self.sim.robots[rng.choice(sorted(self.sim.robots))]
        child = self._body(rng).id
        if child in robot.body_ids:
            return "a part of the robot"
        link = robot.link_ids[robot.gripper().link]
        if self._are_connected(link, child):
            return "joints connect them already"
        self.sim.edits.attach(link, child)
        return link, child

    def edit_world(self, rng: random.Random) -> object:
        """Adds another world, or removes all and spawns it again."""
        if rng.random() < 0.8:
            return "not this time"
        worlds = self.sim.worlds
        self.sim.clear()
        self.sim.spawn(worlds[0])
        if self._robot:
            self._add_robot(rng)
        return "replaced"

    # -- parts ---------------------------------------------------------------------------------------------------

    def _body(self, rng: random.Random) -> Body:
        bodies = self.sim.snapshot().bodies
        if not bodies:
            raise InvalidArgumentError("body", cause="the world is empty")
        loose = [body for body in bodies if body.physics.is_dynamic]
        return rng.choice(loose if loose and rng.random() < 0.4 else bodies)

    def _are_connected(self, a: BodyId, b: BodyId) -> bool:
        """Whether an attachment would close a loop of joints and attachments."""
        world = self.sim.snapshot()
        links = [{each.parent, each.child} for each in (*world.joints, *world.attachments)]
        reached, before = {a}, set[BodyId]()
        while reached != before:
            before = set(reached)
            reached = reached.union(*(link for link in links if link & reached))
        return b in reached

    def _near(self, body: Body, rng: random.Random) -> Pose:
        angle = rng.choice((0.0, 0.0, pi / 2, rng.uniform(-pi, pi)))
        turn = [0.0, 0.0, 0.0, np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)]
        pose = pose_multiply(normalized_pose_array(body.pose), turn)
        scale = rng.choice((0.05, 0.5, 2.0))
        pose[:3] += [rng.uniform(-scale, scale), rng.uniform(-scale, scale), rng.uniform(0.0, scale)]
        return pose_from_array(pose)

    def _add_robot(self, rng: random.Random) -> str:
        x, y, yaw = rng.choice(_ROBOT_PLACES)
        return add_robot(self.sim, self._robot, Pose((x, y, 0.0), (np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)))).name

    def _check_fresh(self, when: str) -> None:
        """Compares the joints of the running model with those of a new engine that has the snapshot."""
        if self.sim.engine.name != "mujoco":
            return
        fresh = MujocoEngine()
        world, immovable = self.sim.snapshot(), self.sim.immovable
        fresh.apply(Spawn(world, geometry=self.sim.geometry, immovable=immovable, settle=False))
        running, new = self.sim.engine.run(joint_axes), joint_axes(fresh)
        assert running.keys() == new.keys(), f"{when} {self.log[-1]}: joints {running.keys() ^ new.keys()}"
        for id, (anchor, axis) in running.items():
            assert np.abs(anchor - new[id][0]).max() < 1e-5, f"{when} {self.log[-1]}: the anchor of {id}"
            assert np.abs(np.abs(axis @ new[id][1]) - 1.0) < 1e-6, f"{when} {self.log[-1]}: the axis of {id}"
        fresh.close()

    def _check_after_step(self, before: World, after: World, stepped: World, name: str) -> None:
        """What physics has not moved is where it was before the edit; what was deleted is there again."""
        now, then = _by_id(self.sim.snapshot()), _by_id(before)
        assert now.keys() == then.keys(), f"step and undo of {name}: {sorted(now.keys() ^ then.keys())[:5]}"
        edited, passed = _by_id(after), _by_id(stepped)
        parents = {each.child: each.parent for each in before.attachments}
        parents |= {joint.child: joint.parent for joint in before.joints}
        holders = {id: set(_chain(id, parents)) for id in then}
        resting = {
            id for id in edited if id in passed and pose_error(edited[id].pose, passed[id].pose) < _POSE_TOLERANCE
        }
        for id, body in then.items():
            unmoved = holders[id] & edited.keys() <= resting and (id in resting or id not in edited)
            assert replace(body, pose=now[id].pose) == now[id], f"step and undo of {name}: {id}"
            if unmoved:
                error = pose_error(body.pose, now[id].pose)
                assert error < _SETTLED_TOLERANCE_M, f"step and undo of {name}: {id} is off by {error:.3g}"
        world = self.sim.snapshot()
        assert set(world.attachments) == set(before.attachments), f"step and undo of {name}: attachments"
        assert {joint.id for joint in world.joints} == {joint.id for joint in before.joints}, name


def _renamed(body: Body, id: str) -> Body:
    return replace(body, id=BodyId(id), iri=Iri(f"http://x.org/added.owl#{id}"), facts=())


def _by_id(world: World) -> dict[BodyId, Body]:
    return {body.id: body for body in world.bodies}


def _chain(id: BodyId, parents: Mapping[BodyId, BodyId]) -> Iterator[BodyId]:
    seen_ids = {id}
    while id in parents and parents[id] not in seen_ids:
        id = parents[id]
        seen_ids.add(id)
        yield id


def seen(sim: Simulation) -> _Seen:
    """The state of a simulation."""
    if sim.engine.name != "mujoco":
        return _Seen(sim.snapshot(), {})
    return sim.engine.run(lambda engine: _Seen(engine.snapshot(), _model(engine), _bits(engine)))


def _bits(engine: Engine) -> bytes:
    data = engine.compiled().data  # type: ignore[attr-defined]
    names = ("qpos", "qvel", "qacc_warmstart", "ctrl", "tree_asleep", "body_awake", "time")
    return b"".join(np.asarray(getattr(data, name)).tobytes() for name in names)


def _model(engine: Engine) -> Mapping[str, Mapping[str, Array]]:
    """What is simulated, by kind and id."""
    compiled = engine.compiled()  # type: ignore[attr-defined]
    model = compiled.model
    masses = {id: np.array([model.body_mass[body]]) for id, body in compiled.body_ids.items()}
    commands = {name: np.array([each.command]) for name, each in engine.actuator_states().items()}
    axes = {id: np.concatenate(each) for id, each in joint_axes(engine).items()}
    positions = {id: np.array(values) for id, values in engine.joint_positions().items()}
    weightless = {id: np.array([model.body_gravcomp[body]]) for id, body in compiled.body_ids.items()}
    return {
        "mass": masses, "command": commands, "axis": axes, "joint position": positions, "weight": weightless,
    }  # fmt: skip


def joint_axes(engine: Engine) -> dict[BodyId, tuple[Array, Array]]:
    """Anchor and axis of each joint of the model that moves along or about one axis, in the frame of its parent."""
    compiled = engine.compiled()  # type: ignore[attr-defined]
    compiled.update_poses()
    poses = dict(zip(*engine.poses(), strict=True))
    found = {}
    for id, joint in compiled.joints.items():
        if len(joint.axes) == 1:
            number = compiled.model.dof_jntid[joint.dof_address]
            kind = compiled.model.jnt_type[number]
            parent = poses[joint.tree_joint.parent]
            anchor = quat_rotate(quat_conjugate(parent[3:]), compiled.data.xanchor[number] - parent[:3])
            axis = quat_rotate(quat_conjugate(parent[3:]), compiled.data.xaxis[number])
            if kind == mujoco.mjtJoint.mjJNT_SLIDE:
                anchor = np.zeros(3)  # a line of no place
            elif kind == mujoco.mjtJoint.mjJNT_BALL:
                axis = np.array([0.0, 0.0, 1.0])
            found[id] = anchor, axis
    return found


def pose_error(a: Pose, b: Pose) -> float:
    """The distance of two poses: the larger one of meters and radians."""
    one, other = normalized_pose_array(a), normalized_pose_array(b)
    return max(float(np.abs(one[:3] - other[:3]).max()), float(quat_angle(one[3:], other[3:])))


def check(wanted: _Seen, found: _Seen, what: str, *, exactly: bool = False) -> None:
    """Compares two states; the order of bodies, joints and attachments is not compared, unless exactly."""
    if exactly:
        assert wanted.world == found.world, f"{what}: the snapshot is another one"
        assert wanted.bits == found.bits, f"{what}: positions, velocities or sleep are others"
    a, b = wanted.world, found.world
    for kind in ("bodies", "joints", "lights"):
        then, now = ({each.id: each for each in getattr(world, kind)} for world in (a, b))
        assert then.keys() == now.keys(), f"{what}: {kind} {sorted(then.keys() ^ now.keys())[:5]}"
        for id, each in then.items():
            if kind == "lights":
                assert each == now[id], f"{what}: {id}"
                continue
            error = pose_error(each.pose, now[id].pose)
            assert error < _POSE_TOLERANCE, f"{what}: the pose of {id} in {kind} is off by {error:.3g}"
            assert replace(each, pose=now[id].pose) == now[id], f"{what}: {id}: {each} is not {now[id]}"
    assert set(a.attachments) == set(b.attachments), f"{what}: {set(a.attachments) ^ set(b.attachments)}"
    assert set(a.facts) == set(b.facts), f"{what}: statements"
    for kind, wanted_values in wanted.model.items():
        values = found.model[kind]
        if kind not in ("mass", "weight"):  # what is part of the scenery, which has neither, is an optimization
            assert wanted_values.keys() == values.keys(), f"{what}: {kind} of {wanted_values.keys() ^ values.keys()}"
        for id, value in wanted_values.items():
            if id not in values:
                continue
            error = np.abs(value - values[id]).max()
            assert error < 1e-5, f"{what}: the {kind} of {id} is {values[id]} and not {value}"


def random_steps(rng: random.Random, count: int) -> tuple[Step, ...]:
    """A random list of edits."""
    names = [name.removeprefix("edit_") for name in sorted(dir(RandomEdits)) if name.startswith("edit_")]
    return tuple(Step(rng.choice(names), rng.randrange(2**31)) for _ in range(count))


def run(start: str, steps: Iterable[Step], folder: Path) -> None:
    """Makes the edits of a list.

    Raises:
        AssertionError: an undo has not restored the world; with the list, and what was done.
    """
    edits = RandomEdits(STARTS[start], folder)
    done: list[Step] = []
    try:
        for step in steps:
            done.append(step)
            edits.do(step)
        edits.undo_all()
        edits.finish()
    except BaseException as error:
        text = f"{type(error).__name__}: {error}\nrun({start!r}, {tuple(map(tuple, done))})\n" + "\n".join(edits.log)
        raise AssertionError(text) from error
    finally:
        edits.close()


def shrunk(start: str, steps: tuple[Step, ...], folder: Path, *, runs: int = 40) -> tuple[Step, ...]:
    """A shorter list of edits that fails, too, found within some runs."""

    def fails(part: tuple[Step, ...]) -> bool:
        try:
            run(start, part, folder)
        except AssertionError:
            return True
        return False

    size = len(steps) // 2
    while size and runs:
        at = 0
        while at < len(steps) and runs:
            part, runs = steps[:at] + steps[at + size :], runs - 1
            if part and fails(part):
                steps = part
            else:
                at += size
        size //= 2
    return steps
