"""Edits of a running world, there and back, in an engine without physics and in one with."""

from __future__ import annotations

from collections.abc import Iterator
from math import pi

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage.engines import Engine, MujocoEngine, NullEngine
from mindstage.errors import (
    AttachmentError,
    BodyExistsError,
    BodyNotFoundError,
    NothingToUndoError,
    PoseUnreachableError,
    WorldError,
)
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import BodyId, BodyPhysics, Material, Mobility, Pose, World, diff
from mindstage.scene.transforms import Array
from mindstage.simulation import JointHandle, Simulation, SpawnRecord
from tests.kitchenette import kitchenette

MUG, DRAWER, HANDLE = BodyId("Mug"), BodyId("Drawer"), BodyId("DrawerHandle")
FRIDGE, DOOR, GRIP = BodyId("Fridge"), BodyId("FridgeDoor"), BodyId("FridgeHandle")
THERE = Pose((0.5, -2.0, 0.05))


@pytest.fixture(params=[NullEngine, MujocoEngine])
def stage(request: pytest.FixtureRequest) -> Iterator[Simulation]:
    with Simulation(KnowledgeBase(bundled_ontology=False), request.param(), shapes=False) as stage:
        stage.spawn(kitchenette())
        yield stage


def poses(stage: Simulation) -> dict[BodyId, Array]:
    return dict(zip(stage.state.ids, stage.state.poses, strict=True))


def hinge(stage: Simulation) -> JointHandle:
    world = stage.snapshot()
    constraint = next(each for each in world.joints if each.id == "FridgeHinge")
    return JointHandle(constraint, {body.id: body for body in world.bodies}, SpawnRecord.from_worlds(stage.worlds))


def same(a: World, b: World) -> bool:
    return diff(a, b).identical(1e-6)


def test_each_edit_is_undone_and_done_again(stage: Simulation) -> None:
    editing, before = stage.undo_stack, stage.snapshot()
    edits = {
        "place of Mug": lambda: editing.move(MUG, THERE),
        "mass of Mug": lambda: editing.set_physics(
            MUG, BodyPhysics(mobility=Mobility.DYNAMIC, gravity=True, overlap_events=False, mass_kg=7.0), label="mass"
        ),
        "material of Mug": lambda: editing.set_materials(MUG, [Material(name="gold", color=(1.0, 0.8, 0.0))]),
        "Mug hangs on Drawer": lambda: editing.attach(DRAWER, MUG),
        "DrawerHandle hangs on nothing": lambda: editing.detach(HANDLE),
        "Mug deleted": lambda: editing.delete([MUG]),
    }
    for what, edit in edits.items():
        edit()
        after = stage.snapshot()
        assert not same(before, after), what
        assert editing.undo() == what
        assert same(before, stage.snapshot()), what
        assert editing.redo() == what
        assert same(after, stage.snapshot()), what
        assert editing.undo() == what
    assert same(before, stage.snapshot())


def test_edits_are_undone_in_turn_and_a_new_one_ends_what_was_undone(stage: Simulation) -> None:
    editing = stage.undo_stack
    editing.move(MUG, THERE)
    editing.set_materials(MUG, [Material(name="gold")])
    assert editing.history.undo == ("material of Mug", "place of Mug")
    editing.undo()
    assert (editing.history.undo, editing.history.redo) == (("place of Mug",), ("material of Mug",))
    editing.delete([HANDLE])
    assert editing.history.redo == ()
    editing.undo()
    editing.undo()
    with pytest.raises(NothingToUndoError, match="there is nothing to undo"):
        editing.undo()
    editing.redo()
    editing.redo()
    with pytest.raises(NothingToUndoError, match="done again"):
        editing.redo()


def test_what_is_dragged_in_many_steps_is_undone_in_one(stage: Simulation) -> None:
    before = stage.snapshot()
    for step in range(5):
        stage.undo_stack.move(MUG, Pose((0.1 * step, -2.0, 0.05)), continues_last=step > 0)
    assert stage.undo_stack.history.undo == ("place of Mug",)
    stage.undo_stack.undo()
    assert same(before, stage.snapshot())


def test_an_edit_that_the_world_refuses_is_none(stage: Simulation) -> None:
    before = stage.snapshot()
    with pytest.raises(BodyNotFoundError):
        stage.undo_stack.move(BodyId("Mugg"), THERE)
    with pytest.raises(BodyNotFoundError):
        stage.undo_stack.delete([MUG, BodyId("Mugg")])
    with pytest.raises(AttachmentError):
        stage.undo_stack.attach(MUG, MUG)
    with pytest.raises(PoseUnreachableError):
        stage.undo_stack.move(MUG, Pose((float("nan"), 0.0, 0.0)))
    assert stage.undo_stack.history.undo == ()
    assert stage.snapshot() == before


@pytest.mark.parametrize("gone", [[DOOR], [FRIDGE], [GRIP], [DOOR, FRIDGE], [FRIDGE, GRIP], [DOOR, FRIDGE, GRIP]])
def test_what_was_deleted_comes_back_as_far_open_as_it_was(stage: Simulation, gone: list[BodyId]) -> None:
    joint = hinge(stage)
    stage.undo_stack.move(DOOR, joint.pose_for("swing1", 0.5, poses(stage)))
    before = stage.snapshot()
    stage.undo_stack.delete(gone)
    assert not set(gone) & set(stage.state.ids)
    stage.undo_stack.undo()
    assert same(before, stage.snapshot())
    assert joint.positions(poses(stage))["swing1"] == pytest.approx(0.5, abs=1e-6)
    stage.undo_stack.move(DOOR, joint.pose_for("swing1", -0.7, poses(stage)))
    assert joint.positions(poses(stage))["swing1"] == pytest.approx(-0.7, abs=1e-6)
    if stage.engine_name == "mujoco":
        with pytest.raises(PoseUnreachableError):
            stage.undo_stack.move(DOOR, joint.pose_for("swing1", 0.8, poses(stage)))


def test_a_door_comes_back_to_where_its_fridge_stands_by_then(stage: Simulation) -> None:
    joint = hinge(stage)
    stage.undo_stack.move(DOOR, joint.pose_for("swing1", 0.5, poses(stage)))
    stage.undo_stack.delete([DOOR, GRIP])
    stage.run_on_engine(
        lambda engine: engine.set_pose(FRIDGE, Pose((-2.0, 1.0, 0.9), (0.0, 0.0, 0.0, 1.0))), edits=True
    )
    stage.undo_stack.undo()
    assert joint.positions(poses(stage))["swing1"] == pytest.approx(0.5, abs=1e-6)
    frame = next(each for each in stage.snapshot().joints if each.id == "FridgeHinge").pose
    assert frame.position == pytest.approx((-1.68, 0.7, 0.9))


def test_what_hung_comes_back_to_where_it_hung_although_its_holder_moved(stage: Simulation) -> None:
    stage.undo_stack.detach(HANDLE)
    stage.run_on_engine(lambda engine: engine.set_pose(DRAWER, Pose((1.75, 0.0, 0.65))), edits=True)
    stage.undo_stack.undo()
    assert poses(stage)[HANDLE][:3] == pytest.approx((1.48, 0.0, 0.65), abs=1e-6)
    assert [hold.child for hold in stage.snapshot().attachments if hold.parent == DRAWER] == [HANDLE]


def test_what_cannot_come_back_says_why_and_is_forgotten(stage: Simulation) -> None:
    stage.undo_stack.delete([MUG])
    mug = kitchenette().body("Mug")
    stage.spawn(replace(kitchenette(), bodies=(mug,), joints=(), attachments=()), persistent=False)
    with pytest.raises(BodyExistsError):
        stage.undo_stack.undo()
    assert stage.undo_stack.history.undo == ()


def test_what_cannot_be_undone_any_more_changes_nothing(stage: Simulation) -> None:
    stage.undo_stack.attach(DRAWER, MUG)
    stage.undo_stack.undo()
    stage.undo_stack.redo()
    stage.run_on_engine(lambda engine: engine.delete([MUG]), edits=True)
    before = stage.snapshot()
    with pytest.raises(WorldError):
        stage.undo_stack.undo()
    assert stage.snapshot() == before


def test_what_somebody_added_is_taken_away_and_comes_again(stage: Simulation) -> None:
    before = stage.snapshot()
    cup = replace(kitchenette().body("Mug"), id=BodyId("Cup"), pose=THERE)
    stage.spawn(replace(kitchenette(), bodies=(cup,), joints=(), attachments=()), persistent=False)
    stage.undo_stack.record_spawn([cup.id])
    assert stage.undo_stack.undo() == "Cup added"
    assert {body.id for body in stage.snapshot().bodies} == {body.id for body in before.bodies}
    stage.undo_stack.redo()
    assert stage.snapshot().body("Cup").pose == THERE


def test_a_reset_brings_back_what_was_spawned_and_can_be_undone(stage: Simulation) -> None:
    before = stage.snapshot()
    stage.undo_stack.move(MUG, THERE)
    cup = replace(kitchenette().body("Mug"), id=BodyId("Cup"), pose=Pose((1.0, -2.0, 0.05)))
    stage.spawn(replace(kitchenette(), bodies=(cup,), joints=(), attachments=()), persistent=False)
    stage.undo_stack.delete([HANDLE])
    changed = stage.snapshot()
    stage.undo_stack.reset()
    assert same(before, stage.snapshot()), "even where the mug was is as it was, and the cup is gone"
    assert stage.undo_stack.undo() == "reset"
    assert same(changed, stage.snapshot())


def test_a_cleared_stage_has_nothing_to_undo(stage: Simulation) -> None:
    stage.undo_stack.move(MUG, THERE)
    stage.clear()
    assert stage.undo_stack.history.undo == ()


def test_a_stage_learns_something_else(stage: Simulation) -> None:
    other = KnowledgeBase(bundled_ontology=False)
    stage.set_knowledge(other)
    assert stage.knowledge is other
    assert stage.state.ids == ()


# -- joints ------------------------------------------------------------------------------------------------------------


def test_a_joint_tells_how_far_it_goes_and_where_it_is(stage: Simulation) -> None:
    joint = hinge(stage)
    (axis,) = joint.axes
    assert (axis.name, axis.is_prismatic, axis.lower, axis.upper) == ("swing1", False, -pi / 4, pi / 4)
    assert joint.positions(poses(stage)) == {"swing1": 0.0}
    assert joint.moving_body == DOOR


def test_the_moving_end_is_found_where_the_map_has_the_roles_upside_down(stage: Simulation) -> None:
    world = stage.snapshot()
    constraint = next(each for each in world.joints if each.id == "FridgeHinge")
    turned = replace(constraint, parent=DOOR, child=FRIDGE)
    joint = JointHandle(turned, {body.id: body for body in world.bodies}, SpawnRecord.from_worlds([world]))
    assert joint.moving_body == DOOR
    there = joint.pose_for("swing1", 0.4, poses(stage))
    moved = poses(stage) | {DOOR: np.array([*there.position, *there.quaternion])}
    assert joint.positions(moved)["swing1"] == pytest.approx(0.4)


def test_a_pull_takes_hold_far_from_the_hinge_and_leads_to_where_it_shall_be(stage: Simulation) -> None:
    pull = hinge(stage).pull_target("swing1", 0.5, poses(stage))
    assert pull.id == DOOR
    assert pull.point == pytest.approx((0.0, -0.3, 0.0)), "the side across from the hinge"
    assert np.linalg.norm(np.array(pull.target) - (1.68, 1.3, 0.9)) == pytest.approx(0.6)


def test_a_pull_opens_a_door_in_physics() -> None:
    engine: Engine = MujocoEngine()
    with Simulation(KnowledgeBase(bundled_ontology=False), engine, shapes=False) as stage:
        stage.spawn(kitchenette())
        joint = hinge(stage)
        pull = joint.pull_target("swing1", -0.5, poses(stage))
        stage.pull(pull.id, point=pull.point, target=pull.target)
        stage.step(2.0)
        assert joint.positions(poses(stage))["swing1"] == pytest.approx(-0.5, abs=0.02)
