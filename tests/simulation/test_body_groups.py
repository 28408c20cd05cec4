"""Parts and contents of bodies, copies of groups, and edits of several bodies."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from mindstage import KnowledgeBase, MujocoEngine, NullEngine, Simulation
from mindstage.errors import BodyNotFoundError, HistoryChangedError, InvalidArgumentError
from mindstage.maps import bundled_kitchen
from mindstage.scene import Body, BodyId, Iri, Pose, World
from mindstage.scene.edits import Delete, SetPoses
from mindstage.simulation.body_groups import BodyGroup, find_dependents, paste_group
from tests.cases import each_case
from tests.kitchenette import kitchenette

FRIDGE, DOOR, HANDLE, MUG = (BodyId(name) for name in ("Fridge", "FridgeDoor", "FridgeHandle", "Mug"))


@pytest.fixture
def simulation() -> Iterator[Simulation]:
    with Simulation(KnowledgeBase(), NullEngine()) as simulation:
        simulation.spawn(kitchenette())
        yield simulation


@pytest.fixture
def room() -> Iterator[Simulation]:
    """A chest on the floor between two others."""
    boxes = {
        "floor": ((0.0, 0.0, -0.05), (8.0, 8.0, 0.1)),
        "chest": ((0.0, 0.0, 0.2), (0.4, 0.4, 0.4)),
        "left": ((-0.6, 0.0, 0.3), (0.6, 0.6, 0.6)),
        "right": ((0.6, 0.0, 0.3), (0.6, 0.6, 0.6)),
    }
    iri = Iri("http://example.org/room")
    bodies = tuple(
        Body(id=BodyId(name), iri=Iri(f"{iri}#{name}"), cls=Iri(f"{iri}#Box"), pose=Pose(at), size=size)
        for name, (at, size) in boxes.items()
    )
    with Simulation(KnowledgeBase(), MujocoEngine(), primitive_shapes=True, threaded=False) as simulation:
        simulation.spawn(World(iri=iri, bodies=bodies))
        yield simulation


@pytest.fixture(scope="module")
def kitchen() -> Iterator[Simulation]:
    knowledge = KnowledgeBase()
    knowledge.load(bundled_kitchen())
    with Simulation(knowledge, MujocoEngine(), timeout_s=60.0) as simulation:
        simulation.spawn()
        yield simulation


def position(simulation: Simulation, id: str) -> np.ndarray:
    return simulation.state.poses[simulation.state.ids.index(BodyId(id))][:3]


def test_the_parts_of_a_fridge_are_its_door_and_handle_and_its_contents_the_food(kitchen: Simulation) -> None:
    found = find_dependents(kitchen.snapshot(), [BodyId("fridge")])
    assert set(found.parts) == {"fridge_door", "fridge_door_handle"}
    assert {"milk_carton_1", "egg_box_1", "butter_pack_1"} <= set(found.contents)
    assert "fridge" not in find_dependents(kitchen.snapshot(), [BodyId("fridge_door")]).parts


def test_deleting_a_body_leaves_its_parts_unless_they_are_asked_for(simulation: Simulation) -> None:
    assert simulation.edits.delete([FRIDGE]) == (FRIDGE,)
    assert DOOR in simulation.state.ids
    simulation.edits.undo()
    assert set(simulation.edits.delete([FRIDGE], parts=True)) == {FRIDGE, DOOR, HANDLE}
    assert {FRIDGE, DOOR, HANDLE}.isdisjoint(simulation.state.ids)
    simulation.edits.undo()
    assert {FRIDGE, DOOR, HANDLE} <= set(simulation.state.ids)
    assert len(simulation.snapshot().joints) == len(kitchenette().joints), "joints are restored"
    with pytest.raises(BodyNotFoundError):
        simulation.edits.delete([BodyId("Nothing")], parts=True)


def test_a_copied_group_is_pasted_beside_with_its_joints(simulation: Simulation) -> None:
    group = BodyGroup.from_text(BodyGroup.from_world(simulation.snapshot(), [FRIDGE]).text)
    before = set(simulation.state.ids)
    pasted = paste_group(simulation, group)
    world = simulation.snapshot()
    assert set(pasted) == {"Fridge_1", "FridgeDoor_1", "FridgeHandle_1"}
    assert set(simulation.state.ids) - before == set(pasted)
    (joint,) = (each for each in world.joints if each.child in pasted or each.parent in pasted)
    assert {joint.parent, joint.child} == {"Fridge_1", "FridgeDoor_1"}
    offset = position(simulation, "Fridge_1") - position(simulation, "Fridge")
    assert np.linalg.norm(offset) > 0.3, "it does not overlap the original"
    assert position(simulation, "FridgeDoor_1") - position(simulation, "FridgeDoor") == pytest.approx(offset)


def test_a_copy_avoids_what_is_on_both_sides_of_its_original(room: Simulation) -> None:
    (copy,) = paste_group(room, BodyGroup.from_world(room.snapshot(), [BodyId("chest")]))
    world = room.snapshot()
    at, size = position(room, copy), np.array(world.body("chest").size)
    assert at[2] == pytest.approx(0.2), "on the floor"
    for other in ("chest", "left", "right"):
        gap = np.abs(at - position(room, other)) - (size + np.array(world.body(other).size)) / 2
        assert gap[:2].max() > 0.0, f"beside {other}"


@each_case("text", ["", "{}", "[1]", '{"content": "something else", "bodies": []}', '{"bodies": []}'])
def test_other_text_is_not_pasted(text: str) -> None:
    with pytest.raises(InvalidArgumentError, match="pasted text"):
        BodyGroup.from_text(text)


def test_several_bodies_are_moved_as_one_step_or_not_at_all(simulation: Simulation) -> None:
    mug, fridge = position(simulation, MUG).copy(), position(simulation, FRIDGE).copy()
    with pytest.raises(BodyNotFoundError):
        simulation.edits.move_all({MUG: Pose((1.0, 1.0, 1.0)), BodyId("Nothing"): Pose()})
    assert position(simulation, MUG) == pytest.approx(mug)
    simulation.edits.move_all({MUG: Pose((1.0, 1.0, 1.0)), FRIDGE: Pose((3.0, 1.0, 1.0))})
    assert position(simulation, MUG) == pytest.approx((1.0, 1.0, 1.0))
    assert simulation.edits.undo() == "pose of 2 bodies"
    assert position(simulation, MUG) == pytest.approx(mug)
    assert position(simulation, FRIDGE) == pytest.approx(fridge)


def test_a_step_of_the_history_is_chosen_only_as_it_was_seen(simulation: Simulation) -> None:
    stack = simulation.edits
    for x in (1.0, 2.0, 3.0):
        stack.move(MUG, Pose((x, 0.0, 0.85)))
    seen = stack.version
    stack.go_to(1, version=seen)
    assert position(simulation, MUG)[0] == pytest.approx(1.0)
    assert len(stack.history.redo) == 2
    stack.go_to(3)
    assert position(simulation, MUG)[0] == pytest.approx(3.0)
    with pytest.raises(HistoryChangedError):
        stack.go_to(0, version=seen)
    with pytest.raises(InvalidArgumentError, match="3 steps"):
        stack.go_to(4)
    assert position(simulation, MUG)[0] == pytest.approx(3.0), "nothing was undone"


def test_what_was_moved_by_physics_can_be_recorded_as_one_step(simulation: Simulation) -> None:
    before = {body.id: body.pose for body in simulation.snapshot().bodies}
    assert not simulation.edits.record_motion(before, label="nothing dragged")
    simulation.engine.run(lambda engine: engine.apply(SetPoses({MUG: Pose((1.0, 0.5, 0.85))})), edits=True)
    assert simulation.edits.record_motion(before, label="Mug dragged")
    assert simulation.edits.undo() == "Mug dragged"
    assert position(simulation, MUG) == pytest.approx(before[MUG].position)
    simulation.edits.redo()
    assert position(simulation, MUG) == pytest.approx((1.0, 0.5, 0.85))


@pytest.mark.parametrize("holder", ["wall_shelf", "window_sill", "floor"])
def test_things_are_placed_on_flat_panels(kitchen: Simulation, holder: str) -> None:
    placed = kitchen.place("CoffeeMug", on=holder)
    body = kitchen.snapshot().body(BodyId(holder))
    low = kitchen.engine.run(lambda engine: engine.snapshot()).body(placed.id).pose.position[2]
    assert placed.support_id == holder
    assert low > body.pose.position[2]
    kitchen.engine.run(lambda engine: engine.apply(Delete((placed.id,))), edits=True)


def test_a_body_is_placed_near_a_point(kitchen: Simulation) -> None:
    x, y, z = kitchen.snapshot().body(BodyId("counter_west")).pose.position
    placed = kitchen.place("CoffeeMug", on="counter_west", near=(x + 0.2, y - 0.1, z))
    offset = np.subtract(placed.pose.position, (x + 0.2, y - 0.1, z))
    assert np.linalg.norm(offset[:2]) < 0.3
    kitchen.engine.run(lambda engine: engine.apply(Delete((placed.id,))), edits=True)


def test_pulling_an_unknown_body_is_an_error(simulation: Simulation) -> None:
    with pytest.raises(BodyNotFoundError, match="nope"):
        simulation.pull(BodyId("nope"), point=(0.0, 0.0, 0.0), target=(1.0, 0.0, 0.0))


def test_the_clock_begins_again_when_the_world_is_cleared(simulation: Simulation) -> None:
    simulation.step(0.5)
    simulation.clear()
    assert simulation.state.time_s == 0.0
