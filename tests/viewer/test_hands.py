"""Hands: what the mouse says, as a grip on the stage."""

from __future__ import annotations

from collections.abc import Iterator
from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from mindstage import KnowledgeBase, MujocoEngine, NullEngine, Simulation
from mindstage.scene import BodyId, BodyPhysics, Mobility, Pose, Vector, World
from mindstage.viewer.drag import DragController, DragMode, drag_target
from tests.kitchenette import kitchenette

DRAWER, HANDLE, DOOR, MUG = BodyId("Drawer"), BodyId("DrawerHandle"), BodyId("FridgeDoor"), BodyId("Mug")
EYE: Vector = (-2.0, -1.0, 2.0)


class Told(Simulation):
    """A stage that remembers what hands tell it."""

    def pull(self, id: BodyId, *, point: Vector, target: Vector) -> None:
        self.grips[id] = (point, target)
        super().pull(id, point=point, target=target)

    def release(self, id: BodyId | None = None) -> None:
        self.released.append(id)
        super().release(id)


@pytest.fixture
def told() -> Iterator[Told]:
    with Told(KnowledgeBase(), NullEngine()) as stage:
        stage.grips, stage.released = {}, []
        stage.spawn(kitchenette())
        yield stage


@pytest.fixture
def hands(told: Told) -> DragController:
    hands = DragController(told)
    hands.set_world(kitchenette())
    return hands


def ray(eye: Vector, through: Vector, distance: float) -> Vector:
    """A place on the ray from the eye through a point, at some distance."""
    step = np.subtract(through, eye)
    x, y, z = (np.asarray(eye) + distance * step / np.linalg.norm(step)).tolist()
    return x, y, z


# -- where a ray meets what the thing can do ---------------------------------------------------------------------------

places = st.tuples(*[st.floats(-1.0, 1.0)] * 3)


@given(travel=st.floats(-1.0, 1.0), distance=st.floats(0.5, 9.0))
def test_a_pointer_on_the_line_of_a_drawer_takes_the_drawer_there(travel: float, distance: float) -> None:
    axis, held = np.array([1.0, 0.0, 0.0]), np.array([1.7, 0.0, 0.65])
    there = held + travel * axis
    pointer = ray(EYE, tuple(there), distance)
    assert drag_target(DragMode.PRISMATIC, axis, held, np.array(pointer), np.array(EYE)) == pytest.approx(tuple(there))


@given(pointer=places)
def test_a_drawer_is_never_pulled_off_its_line(pointer: Vector) -> None:
    axis, held = np.array([1.0, 0.0, 0.0]), np.array([1.7, 0.0, 0.65])
    _, y, z = drag_target(DragMode.PRISMATIC, axis, held, np.array(pointer), np.array(EYE))
    assert (y, z) == pytest.approx((0.0, 0.65))


@given(x=st.floats(-1.0, 2.0), y=st.floats(-1.0, 2.0), distance=st.floats(0.5, 9.0))
def test_a_door_is_pulled_in_its_plane_to_where_the_pointer_is(x: float, y: float, distance: float) -> None:
    axis, held = np.array([0.0, 0.0, 1.0]), np.array([1.6, 0.8, 1.0])
    pointer = ray(EYE, (x, y, 1.0), distance)
    target = drag_target(DragMode.REVOLUTE, axis, held, np.array(pointer), np.array(EYE))
    length = np.linalg.norm(np.subtract((x, y, 1.0), held))
    if length <= 3.0:
        assert target == pytest.approx((x, y, 1.0))
    assert target[2] == pytest.approx(1.0)


def test_what_is_loose_goes_where_the_pointer_is() -> None:
    held, pointer = np.array([2.0, 0.0, 0.85]), np.array([1.8, 0.3, 1.2])
    assert drag_target(DragMode.FREE, np.array([0.0, 0.0, 1.0]), held, pointer, np.array(EYE)) == pytest.approx(
        tuple(pointer)
    )


@pytest.mark.parametrize("way", list(DragMode))
def test_a_ray_that_never_meets_it_follows_the_pointer(way: DragMode) -> None:
    held, pointer = np.array([0.0, 0.0, 1.0]), np.array([0.1, 0.0, 1.0])
    level_eye = np.array([-3.0, 0.0, 1.0])
    axis = np.array([1.0, 0.0, 0.0]) if way is DragMode.PRISMATIC else np.array([0.0, 0.0, 1.0])
    assert drag_target(way, axis, held, pointer, level_eye) == pytest.approx(tuple(pointer))


@given(way=st.sampled_from(DragMode), pointer=places, eye=places, held=places, axis=places)
def test_no_slip_of_the_mouse_throws_the_hand_far_away(
    way: DragMode, pointer: Vector, eye: Vector, held: Vector, axis: Vector
) -> None:
    length = np.linalg.norm(axis)
    direction = np.array(axis) / length if length > 1e-3 else np.array([0.0, 0.0, 1.0])
    target = drag_target(way, direction, np.array(held), np.array(pointer), np.array(eye))
    assert np.isfinite(target).all()
    assert np.linalg.norm(np.subtract(target, held)) <= 3.0 + 1e-9


# -- what is told to the stage -----------------------------------------------------------------------------------------


def test_only_what_the_physics_moves_can_be_held(hands: DragController) -> None:
    assert hands.draggable == {"Drawer", "DrawerHandle", "FridgeDoor", "FridgeHandle", "Mug"}


def test_taking_hold_grips_the_point_that_was_touched(told: Told, hands: DragController) -> None:
    assert hands.start("ann", HANDLE, (1.67, 0.05, 0.66))
    point, target = told.grips[HANDLE]
    assert point == pytest.approx((-0.01, 0.05, 0.01))
    assert target == (1.67, 0.05, 0.66)


def test_the_point_is_in_the_frame_of_a_body_that_is_turned(told: Told, hands: DragController) -> None:
    turned = Pose((1.0, 2.0, 3.0), (np.cos(pi / 4), 0.0, 0.0, np.sin(pi / 4)))
    told.run_on_engine(lambda engine: engine.set_pose(MUG, turned), edits=True)
    hands.start("ann", MUG, (1.0, 2.5, 3.0))
    assert told.grips[MUG][0] == pytest.approx((0.5, 0.0, 0.0))


def test_moving_the_pointer_moves_the_target_along_the_drawer(told: Told, hands: DragController) -> None:
    hands.start("ann", HANDLE, (1.66, 0.0, 0.65))
    hands.move("ann", ray(EYE, (1.4, 0.0, 0.65), 1.0), EYE)
    point, target = told.grips[HANDLE]
    assert target == pytest.approx((1.4, 0.0, 0.65))
    assert point == pytest.approx((-0.02, 0.0, 0.0)), "the hand does not slip"


def test_the_line_of_a_drawer_turns_with_its_cupboard(told: Told) -> None:
    quarter = (np.cos(pi / 4), 0.0, 0.0, np.sin(pi / 4))
    hands = DragController(told)
    hands.set_world(kitchenette())
    told.run_on_engine(lambda engine: engine.set_pose(BodyId("Cupboard"), Pose((2.0, 0.0, 0.4), quarter)), edits=True)
    hands.start("ann", DRAWER, (1.95, 0.0, 0.65))
    hands.move("ann", ray(EYE, (1.95, 0.3, 0.65), 2.0), EYE)
    assert told.grips[DRAWER][1] == pytest.approx((1.95, 0.3, 0.65))


def test_a_joint_with_its_roles_upside_down_is_pulled_alike(told: Told) -> None:
    world = kitchenette()
    upside_down = tuple(replace(joint, parent=joint.child, child=joint.parent) for joint in world.joints)
    hands = DragController(told)
    hands.set_world(replace(world, joints=upside_down))
    hands.start("ann", HANDLE, (1.66, 0.0, 0.65))
    hands.move("ann", ray(EYE, (1.4, 0.0, 0.65), 1.0), EYE)
    assert told.grips[HANDLE][1] == pytest.approx((1.4, 0.0, 0.65))


def test_opening_the_hand_lets_go(told: Told, hands: DragController) -> None:
    hands.start("ann", MUG, (2.0, 0.0, 0.85))
    hands.release("ann")
    assert told.released == [MUG]
    assert hands.drag_forces == ()


def test_opening_an_empty_hand_is_harmless(told: Told, hands: DragController) -> None:
    hands.release("ann")
    hands.move("ann", (0.0, 0.0, 0.0), EYE)
    assert (told.grips, told.released) == ({}, [])


def test_walls_and_furniture_stay_out_of_hands(told: Told, hands: DragController) -> None:
    assert not hands.start("ann", BodyId("Cupboard"), (2.0, 0.0, 0.8))
    assert not hands.start("ann", BodyId("Nothing"), (2.0, 0.0, 0.8))
    assert told.grips == {}


def test_two_visitors_hold_two_things(told: Told, hands: DragController) -> None:
    hands.start("ann", MUG, (2.0, 0.0, 0.85))
    hands.start("bob", DOOR, (1.66, 0.75, 1.0))
    hands.release("ann")
    assert [pull.id for pull in hands.drag_forces] == [DOOR]
    hands.release_all()
    assert told.released == [MUG, DOOR]


def test_what_two_visitors_hold_stays_held_when_one_lets_go(told: Told, hands: DragController) -> None:
    hands.start("ann", MUG, (2.0, 0.0, 0.85))
    hands.start("bob", MUG, (2.0, 0.0, 0.85))
    hands.release("ann")
    assert told.released == []
    hands.release("bob")
    assert told.released == [MUG]


def test_what_is_taken_away_slips_out_of_the_hand(told: Told, hands: DragController) -> None:
    hands.start("ann", MUG, (2.0, 0.0, 0.85))
    told.run_on_engine(lambda engine: engine.delete([MUG]), edits=True)
    hands.move("ann", (2.0, 0.0, 1.2), EYE)
    assert hands.drag_forces == ()
    assert told.released == [MUG]


def test_a_circle_of_attachments_cannot_be_held(told: Told) -> None:
    world = kitchenette()
    hold = world.attachments[0]
    hands = DragController(told)
    still = tuple(
        replace(body, physics=BodyPhysics(mobility=Mobility.KINEMATIC)) if body.id == DRAWER else body
        for body in world.bodies
    )
    circle = (hold, replace(hold, parent=hold.child, child=hold.parent))
    hands.set_world(replace(world, bodies=still, attachments=circle))
    assert not {DRAWER, HANDLE} & hands.draggable


# -- the whole way -----------------------------------------------------------------------------------------------------


def position(stage: Simulation, id: BodyId) -> np.ndarray:
    return stage.state.poses[stage.state.ids.index(id)][:3]


@pytest.fixture
def alive() -> Iterator[Simulation]:
    with Simulation(KnowledgeBase(), MujocoEngine()) as stage:
        stage.spawn(kitchenette())
        yield stage


def drag(stage: Simulation, world: World, id: BodyId, start: Vector, end: Vector) -> None:
    """What the page does when somebody drags: hold, move in small steps, let go."""
    hands = DragController(stage)
    hands.set_world(world)
    assert hands.start("ann", id, start)
    for part in np.linspace(0.0, 1.0, 20):
        x, y, z = (np.array(start) * (1.0 - part) + np.array(end) * part).tolist()
        hands.move("ann", ray(EYE, (x, y, z), 1.0), EYE)
        stage.step(0.1)
    hands.release("ann")


def test_a_drawer_comes_out_by_its_handle(alive: Simulation) -> None:
    drag(alive, kitchenette(), HANDLE, (1.66, 0.0, 0.65), (1.36, 0.0, 0.65))
    x, y, z = position(alive, DRAWER)
    assert x == pytest.approx(1.65, abs=0.05)
    assert (y, z) == pytest.approx((0.0, 0.65), abs=1e-3)


def test_a_door_opens_by_its_handle(alive: Simulation) -> None:
    drag(alive, kitchenette(), BodyId("FridgeHandle"), (1.62, 0.75, 1.0), (1.3, 0.9, 1.0))
    door = alive.state.poses[alive.state.ids.index(DOOR)]
    assert np.degrees(2 * np.arccos(abs(door[3]))) > 20


def test_a_mug_is_lifted(alive: Simulation) -> None:
    hands = DragController(alive)
    hands.set_world(kitchenette())
    hands.start("ann", MUG, (2.0, 0.0, 0.88))
    for part in np.linspace(0.0, 1.0, 20):
        hands.move("ann", (2.0, 0.0, 0.88 + 0.3 * part), EYE)
        alive.step(0.1)
    assert position(alive, MUG)[2] > 1.05
    hands.release("ann")
    alive.step(1.5)
    assert position(alive, MUG)[2] < 0.95
