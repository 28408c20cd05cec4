"""Undo and redo of edits, in an engine without physics and in one with physics."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from math import pi
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage.engines import Engine, NullEngine
from mindstage.engines.base import Capability
from mindstage.engines.mujoco import MujocoEngine
from mindstage.errors import (
    AttachmentError,
    BodyExistsError,
    BodyNotFoundError,
    InvalidArgumentError,
    NothingToUndoError,
    PoseUnreachableError,
    RobotModelError,
    WorldError,
)
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import write_map
from mindstage.robots import add_robot, find_robot
from mindstage.scene import BodyId, BodyPhysics, Iri, Material, Mobility, Pose, World, diff
from mindstage.scene.edits import Attach, Delete, SetPoses, Spawn, edit_from_json, edit_to_json
from mindstage.scene.transforms import Array
from mindstage.simulation import JointHandle, Simulation, SpawnRecord
from mindstage.simulation.replacing import KeptWorld, ReplaceWorld
from tests.kitchenette import kitchenette

MUG, DRAWER, HANDLE = BodyId("Mug"), BodyId("Drawer"), BodyId("DrawerHandle")
FRIDGE, DOOR, GRIP = BodyId("Fridge"), BodyId("FridgeDoor"), BodyId("FridgeHandle")
THERE = Pose((0.5, -2.0, 0.05))


@pytest.fixture(params=[NullEngine, MujocoEngine])
def sim(request: pytest.FixtureRequest) -> Iterator[Simulation]:
    with Simulation(KnowledgeBase(bundled_ontology=False), request.param(), primitive_shapes=True) as sim:
        sim.spawn(kitchenette())
        yield sim


def poses(sim: Simulation) -> dict[BodyId, Array]:
    return dict(zip(sim.state.ids, sim.state.poses, strict=True))


def hinge(sim: Simulation) -> JointHandle:
    world = sim.snapshot()
    joint = next(each for each in world.joints if each.id == "FridgeHinge")
    return JointHandle(joint, {body.id: body for body in world.bodies}, SpawnRecord.from_worlds(sim.worlds))


def is_same(a: World, b: World) -> bool:
    return diff(a, b).identical(1e-6)


def test_each_edit_can_be_undone_and_redone(sim: Simulation) -> None:
    edits, before = sim.edits, sim.snapshot()
    calls = {
        "pose of Mug": lambda: edits.move(MUG, THERE),
        "mass of Mug": lambda: edits.set_physics(
            MUG, BodyPhysics(mobility=Mobility.DYNAMIC, gravity=True, overlap_events=False, mass_kg=7.0), label="mass"
        ),
        "materials of Mug": lambda: edits.set_materials(MUG, [Material(name="gold", color=(1.0, 0.8, 0.0))]),
        "label of Mug": lambda: edits.set_label(MUG, " cup of Ann "),
        "Mug attached to Drawer": lambda: edits.attach(DRAWER, MUG),
        "DrawerHandle detached": lambda: edits.detach(HANDLE),
        "Mug deleted": lambda: edits.delete([MUG]),
    }
    for label, call in calls.items():
        call()
        after = sim.snapshot()
        assert not is_same(before, after), label
        assert edits.undo() == label
        assert is_same(before, sim.snapshot()), label
        assert edits.redo() == label
        assert is_same(after, sim.snapshot()), label
        assert edits.undo() == label
    assert is_same(before, sim.snapshot())


def test_edits_are_undone_in_reverse_order_and_a_new_edit_clears_the_redo_history(sim: Simulation) -> None:
    edits = sim.edits
    edits.move(MUG, THERE)
    edits.set_materials(MUG, [Material(name="gold")])
    assert edits.history.undo == ("materials of Mug", "pose of Mug")
    edits.undo()
    assert (edits.history.undo, edits.history.redo) == (("pose of Mug",), ("materials of Mug",))
    edits.delete([HANDLE])
    assert edits.history.redo == ()
    edits.undo()
    edits.undo()
    with pytest.raises(NothingToUndoError, match="there is nothing to undo"):
        edits.undo()
    edits.redo()
    edits.redo()
    with pytest.raises(NothingToUndoError, match="there is nothing to redo"):
        edits.redo()


def test_the_steps_of_a_drag_are_undone_together(sim: Simulation) -> None:
    before = sim.snapshot()
    for step in range(5):
        sim.edits.move(MUG, Pose((0.1 * step, -2.0, 0.05)), continues_last=step > 0)
    assert sim.edits.history.undo == ("pose of Mug",)
    sim.edits.undo()
    assert is_same(before, sim.snapshot())


def test_a_rejected_edit_is_not_recorded(sim: Simulation) -> None:
    before = sim.snapshot()
    with pytest.raises(BodyNotFoundError):
        sim.edits.move(BodyId("Mugg"), THERE)
    with pytest.raises(BodyNotFoundError):
        sim.edits.delete([MUG, BodyId("Mugg")])
    with pytest.raises(AttachmentError):
        sim.edits.attach(MUG, MUG)
    with pytest.raises(PoseUnreachableError):
        sim.edits.move(MUG, Pose((float("nan"), 0.0, 0.0)))
    assert sim.edits.history.undo == ()
    assert sim.snapshot() == before


@pytest.mark.parametrize("deleted", [[DOOR], [FRIDGE], [GRIP], [DOOR, FRIDGE], [FRIDGE, GRIP], [DOOR, FRIDGE, GRIP]])
def test_a_deleted_door_is_restored_with_its_joint_position(sim: Simulation, deleted: list[BodyId]) -> None:
    joint = hinge(sim)
    sim.edits.move(DOOR, joint.pose_for("swing1", -0.5, poses(sim)))
    before = sim.snapshot()
    sim.edits.delete(deleted)
    assert not set(deleted) & set(sim.state.ids)
    sim.edits.undo()
    assert is_same(before, sim.snapshot())
    assert joint.positions(poses(sim))["swing1"] == pytest.approx(-0.5, abs=1e-6)
    sim.edits.move(DOOR, joint.pose_for("swing1", -0.7, poses(sim)))
    assert joint.positions(poses(sim))["swing1"] == pytest.approx(-0.7, abs=1e-6)
    if sim.engine.name == "mujoco":
        for out_of_range in (-0.8, 0.5):  # the latter is in the map's range, but in the fridge
            with pytest.raises(PoseUnreachableError):
                sim.edits.move(DOOR, joint.pose_for("swing1", out_of_range, poses(sim)))


def test_a_door_is_restored_at_the_current_pose_of_its_fridge(sim: Simulation) -> None:
    joint = hinge(sim)
    sim.edits.move(DOOR, joint.pose_for("swing1", -0.5, poses(sim)))
    sim.edits.delete([DOOR, GRIP])
    sim.engine.run(
        lambda engine: engine.apply(SetPoses({FRIDGE: Pose((-2.0, 1.0, 0.9), (0.0, 0.0, 0.0, 1.0))})), edits=True
    )
    sim.edits.undo()
    assert joint.positions(poses(sim))["swing1"] == pytest.approx(-0.5, abs=1e-6)
    frame = next(each for each in sim.snapshot().joints if each.id == "FridgeHinge").pose
    assert frame.position == pytest.approx((-1.68, 0.7, 0.9))


def test_a_detached_body_is_restored_at_its_relative_pose_after_its_parent_moved(sim: Simulation) -> None:
    sim.edits.detach(HANDLE)
    sim.engine.run(lambda engine: engine.apply(SetPoses({DRAWER: Pose((1.75, 0.0, 0.65))})), edits=True)
    sim.edits.undo()
    assert poses(sim)[HANDLE][:3] == pytest.approx((1.48, 0.0, 0.65), abs=1e-6)
    assert [each.child for each in sim.snapshot().attachments if each.parent == DRAWER] == [HANDLE]


def test_moving_an_attached_body_to_another_parent_is_undone_and_redone_at_both_poses(sim: Simulation) -> None:
    stack, place = sim.edits, (1.95, 0.1, 0.7)
    stack.move(MUG, Pose(place))
    stack.attach(DRAWER, MUG)
    before = sim.snapshot()
    stack.attach(FRIDGE, MUG)
    after = sim.snapshot()
    for _ in range(2):
        stack.undo()
        assert is_same(before, sim.snapshot())
        assert poses(sim)[MUG][:3] == pytest.approx(place, abs=1e-6)
        stack.redo()
        assert is_same(after, sim.snapshot())
        assert poses(sim)[MUG][:3] == pytest.approx(place, abs=1e-6)


def test_an_edit_that_cannot_be_undone_is_removed_from_the_history(sim: Simulation) -> None:
    sim.edits.delete([MUG])
    mug = kitchenette().body("Mug")
    sim.spawn(replace(kitchenette(), bodies=(mug,), joints=(), attachments=()), persistent=False)
    with pytest.raises(BodyExistsError):
        sim.edits.undo()
    assert sim.edits.history.undo == ()


def test_a_failed_undo_changes_nothing(sim: Simulation) -> None:
    sim.edits.attach(DRAWER, MUG)
    sim.edits.undo()
    sim.edits.redo()
    sim.engine.run(lambda engine: engine.apply(Delete((MUG,))), edits=True)
    before = sim.snapshot()
    with pytest.raises(WorldError):
        sim.edits.undo()
    assert sim.snapshot() == before


def test_a_spawn_can_be_undone_and_redone(sim: Simulation) -> None:
    before = sim.snapshot()
    cup = replace(kitchenette().body("Mug"), id=BodyId("Cup"), pose=THERE)
    world = replace(kitchenette(), bodies=(cup,), joints=(), attachments=())
    sim.spawn(world, persistent=False, title="Cup added")
    assert sim.edits.undo() == "Cup added"
    assert {body.id for body in sim.snapshot().bodies} == {body.id for body in before.bodies}
    sim.edits.redo()
    assert sim.snapshot().body("Cup").pose == THERE


def test_a_reset_restores_the_spawned_world_and_can_be_undone(sim: Simulation) -> None:
    before = sim.snapshot()
    sim.edits.move(MUG, THERE)
    cup = replace(kitchenette().body("Mug"), id=BodyId("Cup"), pose=Pose((1.0, -2.0, 0.05)))
    sim.spawn(replace(kitchenette(), bodies=(cup,), joints=(), attachments=()), persistent=False)
    sim.edits.delete([HANDLE])
    changed = sim.snapshot()
    sim.edits.reset()
    assert is_same(before, sim.snapshot()), "the mug is at its spawned pose, and the cup is removed"
    assert sim.edits.undo() == "reset"
    assert is_same(changed, sim.snapshot())


def test_a_cleared_simulation_has_nothing_to_undo(sim: Simulation) -> None:
    sim.edits.move(MUG, THERE)
    sim.clear()
    assert sim.edits.history.undo == ()


# -- other worlds ------------------------------------------------------------------------------------------------------

CUP = BodyId("Cup")


def room(name: str, *ids: str) -> World:
    """A world with loose cups next to each other."""
    mug = kitchenette().body("Mug")
    cups = (
        replace(mug, id=BodyId(id), iri=Iri(f"http://example.org/{name}.owl#{id}"), pose=Pose((row, -2.0, 0.05)))
        for row, id in enumerate(ids)
    )
    return World(iri=Iri(f"http://example.org/{name}.owl#{name}"), name=name, bodies=tuple(cups))


@pytest.fixture
def maps(tmp_path: Path) -> Iterator[Callable[[World], KnowledgeBase]]:
    with ExitStack() as opened:

        def read(world: World) -> KnowledgeBase:
            path = tmp_path / f"{world.name}.owl"
            path.write_text(write_map(world), encoding="utf-8")
            knowledge = opened.enter_context(KnowledgeBase())
            knowledge.load(path)
            return knowledge

        yield read


def shown(sim: Simulation) -> tuple[object, ...]:
    """What a user sees of a simulation; of poses and positions every bit."""
    answers = {name: sim.ask(name).to_dicts() for name in ("pose_of", "where_is", "analyze")}
    positions = sim.engine.run(lambda engine: repr(engine.actuator_states() if sim.robots else {}))
    poses = sim.state.ids, sim.state.poses.tobytes(), sim.state.time_s
    maps = sim.knowledge.maps(), tuple(sim.worlds), dict(sim.geometry), sim.immovable
    return (*poses, sim.snapshot(), *maps, tuple(sim.robots), positions, answers, sim.state.highlight_groups)


def test_a_loaded_map_is_one_step_and_what_it_replaced_comes_back(maps: Callable[[World], KnowledgeBase]) -> None:
    first, second = maps(replace(kitchenette(), name="first")), maps(room("second", "Cup", "Bowl"))
    with Simulation(first, MujocoEngine()) as sim:
        sim.spawn()
        robot = add_robot(sim, "mobile_manipulator", Pose((0.3, -1.5, 0.0)))
        sim.edits.move(MUG, Pose((0.5, -2.0, 0.4)))
        sim.highlight(["Fridge"], "green", label="cold")
        sim.step(0.2)
        before, history = shown(sim), sim.edits.history.undo
        assert sim.replace_world(knowledge=second).bodies == 2
        assert sim.edits.history.undo == ("second loaded", *history)
        assert (sim.knowledge, sorted(sim.state.ids), sim.robots) == (second, ["Bowl", "Cup"], {})
        assert not robot.exists
        sim.step(0.3)
        sim.edits.move(CUP, THERE)
        moved = shown(sim)
        assert [sim.edits.undo(), sim.edits.undo()] == ["pose of Cup", "second loaded"]
        assert shown(sim) == before
        assert find_robot(sim) is robot
        assert [sim.edits.redo(), sim.edits.redo()] == ["second loaded", "pose of Cup"]
        assert shown(sim) == moved
        sim.edits.go_to(len(history))
        assert shown(sim) == before
        sim.step(0.5)
        assert robot.exists
        assert robot.link_pose("head_pan_link")[2] > 0.5, "its drives hold it"
        assert sim.edits.undo() == "pose of Mug"
        assert sim.snapshot().body("Mug").pose.position == pytest.approx(kitchenette().body("Mug").pose.position)
        assert sim.edits.undo() == "robot mobile_manipulator added"
        assert sim.robots == {}


def test_a_reset_is_about_the_world_that_is_there(sim: Simulation) -> None:
    sim.edits.move(MUG, THERE)
    sim.replace_world(room("other", "Cup"))
    sim.edits.move(CUP, THERE)
    sim.reset()
    assert is_same(sim.snapshot(), room("other", "Cup"))
    sim.edits.go_to(1)
    assert sim.snapshot().body("Mug").pose == THERE
    sim.reset()
    assert is_same(sim.snapshot(), kitchenette())


def test_the_last_three_replaced_worlds_are_kept(sim: Simulation) -> None:
    sim.edits.move(MUG, THERE)
    for name in "abc":
        sim.replace_world(room(name, f"Cup_{name}"))
    assert [sim.edits.undo() for _ in range(4)] == ["c loaded", "b loaded", "a loaded", "pose of Mug"]
    with pytest.raises(NothingToUndoError, match=r"there is nothing to undo$"):
        sim.edits.undo()
    assert [sim.edits.redo() for _ in range(4)] == ["pose of Mug", "a loaded", "b loaded", "c loaded"]
    assert sim.state.ids == ("Cup_c",)
    sim.replace_world(room("d", "Cup_d"))
    assert [sim.edits.undo() for _ in range(3)] == ["d loaded", "c loaded", "b loaded"]
    with pytest.raises(NothingToUndoError, match="nothing to undo: only the last 3 replacements of the world can be"):
        sim.edits.undo()
    assert sim.state.ids == ("Cup_a",), "the history ends after the load that is too old"
    sim.edits.redo()
    assert sim.state.ids == ("Cup_b",)


def test_a_world_that_is_no_longer_kept_cannot_be_restored(sim: Simulation) -> None:
    applied = sim.apply(ReplaceWorld(KeptWorld(sim, {}, spawn=Spawn(room("other", "Cup")))))
    text = edit_to_json(applied.inverse)
    assert edit_from_json(text) == applied.inverse
    with (
        Simulation(KnowledgeBase(bundled_ontology=False), NullEngine()) as other,
        pytest.raises(InvalidArgumentError, match="another simulation keeps it"),
    ):
        other.apply(edit_from_json(text))
    sim.apply(applied.inverse)
    assert is_same(sim.snapshot(), kitchenette())
    del applied
    gc.collect()
    with pytest.raises(InvalidArgumentError, match="not kept here any more; load the map again"):
        edit_from_json(text)


def test_an_engine_without_saved_states_begins_a_new_history(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(NullEngine, "capabilities", NullEngine.capabilities - {Capability.SAVE})
    with Simulation(KnowledgeBase(bundled_ontology=False), NullEngine(), primitive_shapes=True) as sim:
        sim.spawn(kitchenette())
        sim.edits.move(MUG, THERE)
        sim.replace_world(room("other", "Cup"))
        with pytest.raises(NothingToUndoError, match="the engine cannot save its state"):
            sim.edits.undo()
        assert sim.state.ids == (CUP,)


# -- joints ------------------------------------------------------------------------------------------------------------


def test_a_joint_handle_has_limits_and_a_position(sim: Simulation) -> None:
    joint = hinge(sim)
    (axis,) = joint.axes
    assert (axis.name, axis.is_prismatic, axis.lower, axis.upper) == ("swing1", False, -pi / 4, 0.0)
    assert joint.positions(poses(sim)) == {"swing1": 0.0}
    assert joint.moving_body == DOOR


def test_the_moving_body_is_found_with_parent_and_child_swapped(sim: Simulation) -> None:
    world = sim.snapshot()
    joint = next(each for each in world.joints if each.id == "FridgeHinge")
    swapped = replace(joint, parent=DOOR, child=FRIDGE)
    joint = JointHandle(swapped, {body.id: body for body in world.bodies}, SpawnRecord.from_worlds([world]))
    assert joint.moving_body == DOOR
    goal = joint.pose_for("swing1", 0.4, poses(sim))
    moved = poses(sim) | {DOOR: np.array([*goal.position, *goal.quaternion])}
    assert joint.positions(moved)["swing1"] == pytest.approx(0.4)


def test_a_pull_acts_far_from_the_hinge_and_targets_the_joint_position(sim: Simulation) -> None:
    pull = hinge(sim).pull_target("swing1", 0.5, poses(sim))
    assert pull.id == DOOR
    assert pull.point == pytest.approx((0.0, -0.3, 0.0)), "the side across from the hinge"
    assert np.linalg.norm(np.array(pull.target) - (1.68, 1.3, 0.9)) == pytest.approx(0.6)


def test_a_pull_acts_on_the_far_side_of_a_door_that_is_the_parent_of_its_joint(sim: Simulation) -> None:
    kitchen = sim.snapshot()
    # The hinge is on the left of the door's center, and on the right of the center of what holds it.
    fridge = replace(kitchen.body("Fridge"), pose=Pose((2.0, 1.6, 0.9)))
    swapped = replace(next(each for each in kitchen.joints if each.id == "FridgeHinge"), parent=DOOR, child=FRIDGE)
    bodies = {body.id: body for body in kitchen.bodies} | {FRIDGE: fridge}
    world = replace(kitchen, bodies=tuple(bodies.values()), joints=(swapped,))
    now = {id: np.array([*body.pose.position, *body.pose.quaternion]) for id, body in bodies.items()}
    pull = JointHandle(swapped, bodies, SpawnRecord.from_worlds([world])).pull_target("swing1", 0.5, now)
    assert pull.id == DOOR
    assert pull.point == pytest.approx((0.0, -0.3, 0.0))


def test_a_pull_opens_a_door_in_physics() -> None:
    engine: Engine = MujocoEngine()
    with Simulation(KnowledgeBase(bundled_ontology=False), engine, primitive_shapes=True) as sim:
        sim.spawn(kitchenette())
        joint = hinge(sim)
        pull = joint.pull_target("swing1", -0.5, poses(sim))
        sim.pull(pull.id, point=pull.point, target=pull.target)
        sim.step(2.0)
        assert joint.positions(poses(sim))["swing1"] == pytest.approx(-0.5, abs=0.02)


def test_what_happens_in_a_context_is_one_step(sim: Simulation) -> None:
    edits = sim.edits
    edits.move(MUG, THERE)
    before = sim.snapshot()
    with edits.one_step("tidy up"):
        edits.delete([HANDLE])
        sim.engine.run(lambda engine: engine.apply(Attach(DRAWER, MUG)), edits=True)
        edits.set_label(MUG, "cup")
    after = sim.snapshot()
    assert edits.history.undo == ("tidy up", "pose of Mug"), "the edits within it are parts of it"
    assert edits.undo() == "tidy up"
    assert is_same(before, sim.snapshot())
    assert edits.redo() == "tidy up"
    assert is_same(after, sim.snapshot())
    edits.undo()
    assert edits.undo() == "pose of Mug"


def test_a_context_in_which_nothing_moves_is_no_step_and_one_that_fails_is(sim: Simulation) -> None:
    with sim.edits.one_step("wait"):
        sim.engine.run(lambda engine: engine.poses())
    assert sim.edits.history.undo == ()
    with pytest.raises(RuntimeError), sim.edits.one_step("fail"):  # noqa: PT012
        sim.engine.run(lambda engine: engine.apply(SetPoses({MUG: THERE})), edits=True)
        raise RuntimeError
    assert sim.edits.history.undo == ("fail",)


# -- what is simulated -------------------------------------------------------------------------------------------------


@pytest.fixture
def physics() -> Iterator[Simulation]:
    with Simulation(KnowledgeBase(bundled_ontology=False), MujocoEngine(), primitive_shapes=True) as sim:
        sim.spawn(kitchenette())
        yield sim


def test_a_snapshot_has_a_joint_where_its_moved_holder_is(sim: Simulation) -> None:
    sim.edits.move(FRIDGE, Pose((-2.0, 1.0, 0.9), (0.0, 0.0, 0.0, 1.0)))
    before = sim.snapshot()
    frame = next(each for each in before.joints if each.id == "FridgeHinge").pose
    assert frame.position == pytest.approx((-1.68, 0.7, 0.9)), "before, it stayed where the fridge had been"
    sim.edits.delete([DOOR])
    sim.edits.undo()
    assert is_same(before, sim.snapshot())


def test_a_door_beyond_its_limit_is_restored_there(physics: Simulation) -> None:
    joint = hinge(physics)
    physics.edits.move(DOOR, joint.pose_for("swing1", -pi / 4, poses(physics)))
    point = joint.pull_target("swing1", -1.2, poses(physics))
    physics.pull(DOOR, point=point.point, target=point.target)
    physics.step(1.0)
    physics.release()
    beyond = joint.positions(poses(physics))["swing1"]
    assert beyond < -pi / 4 - 1e-5, "the limit is soft"
    for edit in (
        lambda: physics.edits.delete([DOOR, GRIP]),
        lambda: physics.edits.move(DOOR, joint.pose_for("swing1", -0.2, poses(physics))),
    ):
        edit()
        physics.edits.undo()
        assert joint.positions(poses(physics))["swing1"] == pytest.approx(beyond, abs=1e-6)


@pytest.mark.parametrize("link", ["upper_arm_link", "gripper_link", "base_link", "mobile_manipulator.odom"])
def test_a_robot_stands_again_after_a_deletion_and_some_time(physics: Simulation, link: str) -> None:
    robot = add_robot(physics, "mobile_manipulator", Pose((0.3, -1.5, 0.0)))
    physics.step(0.2)
    before, commands = physics.snapshot(), physics.engine.run(lambda engine: engine.actuator_states())
    physics.edits.delete([BodyId(link)])
    physics.edits.undo()
    assert is_same(before, physics.snapshot())
    restored = physics.engine.run(lambda engine: engine.actuator_states())
    assert {name: each.command for name, each in restored.items()} == {
        name: each.command for name, each in commands.items()
    }
    height = robot.link_pose("head_pan_link")[2]
    physics.step(0.5)
    assert robot.link_pose("head_pan_link")[2] == pytest.approx(height, abs=0.01), "its drives hold it"
    physics.edits.delete([BodyId(link)])
    physics.step(0.1)
    physics.edits.undo()
    assert robot.exists
    assert len(physics.engine.run(lambda engine: engine.actuator_states())) == len(commands)


def test_bodies_that_move_one_another_are_moved_back(sim: Simulation) -> None:
    before = sim.snapshot()
    moves = {GRIP: Pose((1.0, 3.0, 1.0)), FRIDGE: Pose((2.5, 2.0, 0.9)), HANDLE: Pose((1.0, -1.0, 0.6))}
    for order in (list(moves), list(moves)[::-1]):
        sim.edits.move_all({id: moves[id] for id in order})
        sim.edits.undo()
        assert is_same(before, sim.snapshot())


def test_a_robot_that_cannot_be_added_deletes_nothing(physics: Simulation) -> None:
    for name in ("ann", "bob"):
        add_robot(physics, "mobile_manipulator", Pose((0.3, -1.5 if name == "ann" else 2.5, 0.0)), name=name)
    physics.edits.set_label(MUG, "x")
    find_robot(physics, "bob").remove()
    physics.edits.reset()  # its bodies are there again
    before = set(physics.state.ids)
    with pytest.raises(RobotModelError):
        add_robot(physics, "mobile_manipulator", name="bob")
    assert set(physics.state.ids) == before
    assert add_robot(physics, "mobile_manipulator", Pose((-2.0, 0.0, 0.0))).body_ids.isdisjoint(before)


def test_without_saved_states_a_context_is_undone_by_moving_the_bodies_back() -> None:
    class ForgetfulEngine(NullEngine):
        capabilities = NullEngine.capabilities - {Capability.SAVE}

    with Simulation(KnowledgeBase(), ForgetfulEngine(), threaded=False) as sim:
        sim.spawn(kitchenette())
        before = sim.snapshot()
        with sim.edits.one_step("tidy up"):
            sim.engine.run(lambda engine: engine.apply(SetPoses({MUG: THERE})), edits=True)
        assert not is_same(before, sim.snapshot())
        assert sim.edits.undo() == "tidy up"
        assert is_same(before, sim.snapshot())
