"""Dragging bodies with the mouse: targets of pointer rays, and forces in the simulation."""

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
from mindstage.scene.edits import Delete, SetPoses
from mindstage.viewer.drag import DragController, DragMode, drag_target
from tests.kitchenette import kitchenette

DRAWER, HANDLE, DOOR, MUG = BodyId("Drawer"), BodyId("DrawerHandle"), BodyId("FridgeDoor"), BodyId("Mug")
EYE: Vector = (-2.0, -1.0, 2.0)


class RecordingSimulation(Simulation):
    """A simulation that records pulls and releases."""

    def pull(self, id: BodyId, *, point: Vector, target: Vector) -> None:
        self.pulls[id] = (point, target)
        super().pull(id, point=point, target=target)

    def release(self, id: BodyId | None = None) -> None:
        self.released.append(id)
        super().release(id)


@pytest.fixture
def simulation() -> Iterator[RecordingSimulation]:
    with RecordingSimulation(KnowledgeBase(), NullEngine()) as simulation:
        simulation.pulls, simulation.released = {}, []
        simulation.spawn(kitchenette())
        yield simulation


@pytest.fixture
def controller(simulation: RecordingSimulation) -> DragController:
    controller = DragController(simulation)
    controller.set_world(kitchenette())
    return controller


def ray(eye: Vector, through: Vector, distance: float) -> Vector:
    """The point at a distance on the ray from the eye through a point."""
    step = np.subtract(through, eye)
    x, y, z = (np.asarray(eye) + distance * step / np.linalg.norm(step)).tolist()
    return x, y, z


# -- targets of pointer rays -------------------------------------------------------------------------------------------

points = st.tuples(*[st.floats(-1.0, 1.0)] * 3)


@given(travel=st.floats(-1.0, 1.0), distance=st.floats(0.5, 9.0))
def test_a_pointer_on_the_axis_of_a_drawer_is_the_target(travel: float, distance: float) -> None:
    axis, point = np.array([1.0, 0.0, 0.0]), np.array([1.7, 0.0, 0.65])
    there = point + travel * axis
    pointer = ray(EYE, tuple(there), distance)
    assert drag_target(DragMode.PRISMATIC, axis, point, np.array(pointer), np.array(EYE)) == pytest.approx(tuple(there))


@given(pointer=points)
def test_the_target_of_a_drawer_is_always_on_its_axis(pointer: Vector) -> None:
    axis, point = np.array([1.0, 0.0, 0.0]), np.array([1.7, 0.0, 0.65])
    _, y, z = drag_target(DragMode.PRISMATIC, axis, point, np.array(pointer), np.array(EYE))
    assert (y, z) == pytest.approx((0.0, 0.65))


@given(x=st.floats(-1.0, 2.0), y=st.floats(-1.0, 2.0), distance=st.floats(0.5, 9.0))
def test_the_target_of_a_door_is_in_its_plane(x: float, y: float, distance: float) -> None:
    axis, point = np.array([0.0, 0.0, 1.0]), np.array([1.6, 0.8, 1.0])
    pointer = ray(EYE, (x, y, 1.0), distance)
    target = drag_target(DragMode.REVOLUTE, axis, point, np.array(pointer), np.array(EYE))
    length = np.linalg.norm(np.subtract((x, y, 1.0), point))
    if length <= 3.0:
        assert target == pytest.approx((x, y, 1.0))
    assert target[2] == pytest.approx(1.0)


def test_the_target_of_a_free_body_is_the_pointer() -> None:
    point, pointer = np.array([2.0, 0.0, 0.85]), np.array([1.8, 0.3, 1.2])
    assert drag_target(DragMode.FREE, np.array([0.0, 0.0, 1.0]), point, pointer, np.array(EYE)) == pytest.approx(
        tuple(pointer)
    )


@pytest.mark.parametrize("mode", list(DragMode))
def test_for_a_parallel_ray_the_target_is_the_pointer(mode: DragMode) -> None:
    point, pointer = np.array([0.0, 0.0, 1.0]), np.array([0.1, 0.0, 1.0])
    level_eye = np.array([-3.0, 0.0, 1.0])
    axis = np.array([1.0, 0.0, 0.0]) if mode is DragMode.PRISMATIC else np.array([0.0, 0.0, 1.0])
    assert drag_target(mode, axis, point, pointer, level_eye) == pytest.approx(tuple(pointer))


@given(mode=st.sampled_from(DragMode), pointer=points, eye=points, point=points, axis=points)
def test_the_distance_of_the_target_is_limited(
    mode: DragMode, pointer: Vector, eye: Vector, point: Vector, axis: Vector
) -> None:
    length = np.linalg.norm(axis)
    direction = np.array(axis) / length if length > 1e-3 else np.array([0.0, 0.0, 1.0])
    target = drag_target(mode, direction, np.array(point), np.array(pointer), np.array(eye))
    assert np.isfinite(target).all()
    assert np.linalg.norm(np.subtract(target, point)) <= 3.0 + 1e-9


# -- calls into the simulation -----------------------------------------------------------------------------------------


def test_only_bodies_that_can_move_are_draggable(controller: DragController) -> None:
    assert controller.draggable == {"Drawer", "DrawerHandle", "FridgeDoor", "FridgeHandle", "Mug"}


def test_a_drag_starts_at_the_clicked_point(simulation: RecordingSimulation, controller: DragController) -> None:
    assert controller.start("ann", HANDLE, (1.67, 0.05, 0.66))
    point, target = simulation.pulls[HANDLE]
    assert point == pytest.approx((-0.01, 0.05, 0.01))
    assert target == (1.67, 0.05, 0.66)


def test_the_point_is_in_the_frame_of_the_body(simulation: RecordingSimulation, controller: DragController) -> None:
    turned = Pose((1.0, 2.0, 3.0), (np.cos(pi / 4), 0.0, 0.0, np.sin(pi / 4)))
    simulation.engine.run(lambda engine: engine.apply(SetPoses({MUG: turned})), edits=True)
    controller.start("ann", MUG, (1.0, 2.5, 3.0))
    assert simulation.pulls[MUG][0] == pytest.approx((0.5, 0.0, 0.0))


def test_moving_the_pointer_moves_the_target_along_the_axis(
    simulation: RecordingSimulation, controller: DragController
) -> None:
    controller.start("ann", HANDLE, (1.66, 0.0, 0.65))
    controller.move("ann", ray(EYE, (1.4, 0.0, 0.65), 1.0), EYE)
    point, target = simulation.pulls[HANDLE]
    assert target == pytest.approx((1.4, 0.0, 0.65))
    assert point == pytest.approx((-0.02, 0.0, 0.0)), "the point of application is unchanged"


def test_the_axis_of_a_drawer_moves_with_its_cupboard(simulation: RecordingSimulation) -> None:
    quarter = (np.cos(pi / 4), 0.0, 0.0, np.sin(pi / 4))
    controller = DragController(simulation)
    controller.set_world(kitchenette())
    simulation.engine.run(
        lambda engine: engine.apply(SetPoses({BodyId("Cupboard"): Pose((2.0, 0.0, 0.4), quarter)})), edits=True
    )
    controller.start("ann", DRAWER, (1.95, 0.0, 0.65))
    controller.move("ann", ray(EYE, (1.95, 0.3, 0.65), 2.0), EYE)
    assert simulation.pulls[DRAWER][1] == pytest.approx((1.95, 0.3, 0.65))


def test_a_joint_with_swapped_bodies_is_dragged_alike(simulation: RecordingSimulation) -> None:
    world = kitchenette()
    swapped = tuple(replace(joint, parent=joint.child, child=joint.parent) for joint in world.joints)
    controller = DragController(simulation)
    controller.set_world(replace(world, joints=swapped))
    controller.start("ann", HANDLE, (1.66, 0.0, 0.65))
    controller.move("ann", ray(EYE, (1.4, 0.0, 0.65), 1.0), EYE)
    assert simulation.pulls[HANDLE][1] == pytest.approx((1.4, 0.0, 0.65))


def test_releasing_ends_the_force(simulation: RecordingSimulation, controller: DragController) -> None:
    controller.start("ann", MUG, (2.0, 0.0, 0.85))
    controller.release("ann")
    assert simulation.released == [MUG]
    assert controller.drag_forces == ()


def test_releasing_nothing_is_harmless(simulation: RecordingSimulation, controller: DragController) -> None:
    controller.release("ann")
    controller.move("ann", (0.0, 0.0, 0.0), EYE)
    assert (simulation.pulls, simulation.released) == ({}, [])


def test_static_and_unknown_bodies_cannot_be_dragged(
    simulation: RecordingSimulation, controller: DragController
) -> None:
    assert not controller.start("ann", BodyId("Cupboard"), (2.0, 0.0, 0.8))
    assert not controller.start("ann", BodyId("Nothing"), (2.0, 0.0, 0.8))
    assert simulation.pulls == {}


def test_two_clients_drag_two_bodies(simulation: RecordingSimulation, controller: DragController) -> None:
    controller.start("ann", MUG, (2.0, 0.0, 0.85))
    controller.start("bob", DOOR, (1.66, 0.75, 1.0))
    controller.release("ann")
    assert [pull.id for pull in controller.drag_forces] == [DOOR]
    controller.release_all()
    assert simulation.released == [MUG, DOOR]


def test_a_body_dragged_by_two_clients_is_released_by_the_last(
    simulation: RecordingSimulation, controller: DragController
) -> None:
    controller.start("ann", MUG, (2.0, 0.0, 0.85))
    controller.start("bob", MUG, (2.0, 0.0, 0.85))
    controller.release("ann")
    assert simulation.released == []
    controller.release("bob")
    assert simulation.released == [MUG]


def test_deleting_a_body_ends_its_drag(simulation: RecordingSimulation, controller: DragController) -> None:
    controller.start("ann", MUG, (2.0, 0.0, 0.85))
    simulation.engine.run(lambda engine: engine.apply(Delete((MUG,))), edits=True)
    controller.move("ann", (2.0, 0.0, 1.2), EYE)
    assert controller.drag_forces == ()
    assert simulation.released == [MUG]


def test_a_cycle_of_attachments_is_not_draggable(simulation: RecordingSimulation) -> None:
    world = kitchenette()
    attachment = world.attachments[0]
    controller = DragController(simulation)
    kinematic = tuple(
        replace(body, physics=BodyPhysics(mobility=Mobility.KINEMATIC)) if body.id == DRAWER else body
        for body in world.bodies
    )
    cycle = (attachment, replace(attachment, parent=attachment.child, child=attachment.parent))
    controller.set_world(replace(world, bodies=kinematic, attachments=cycle))
    assert not {DRAWER, HANDLE} & controller.draggable


# -- with physics ------------------------------------------------------------------------------------------------------


def position(simulation: Simulation, id: BodyId) -> np.ndarray:
    return simulation.state.poses[simulation.state.ids.index(id)][:3]


@pytest.fixture
def physics_simulation() -> Iterator[Simulation]:
    with Simulation(KnowledgeBase(), MujocoEngine()) as simulation:
        simulation.spawn(kitchenette())
        yield simulation


def drag(simulation: Simulation, world: World, id: BodyId, start: Vector, end: Vector) -> None:
    """Starts a drag, moves the pointer in small steps, and releases."""
    controller = DragController(simulation)
    controller.set_world(world)
    assert controller.start("ann", id, start)
    for part in np.linspace(0.0, 1.0, 20):
        x, y, z = (np.array(start) * (1.0 - part) + np.array(end) * part).tolist()
        controller.move("ann", ray(EYE, (x, y, z), 1.0), EYE)
        simulation.step(0.1)
    controller.release("ann")


def test_a_drawer_is_opened_by_its_handle(physics_simulation: Simulation) -> None:
    drag(physics_simulation, kitchenette(), HANDLE, (1.66, 0.0, 0.65), (1.36, 0.0, 0.65))
    x, y, z = position(physics_simulation, DRAWER)
    assert x == pytest.approx(1.65, abs=0.05)
    assert (y, z) == pytest.approx((0.0, 0.65), abs=1e-3)


def test_a_door_is_opened_by_its_handle(physics_simulation: Simulation) -> None:
    drag(physics_simulation, kitchenette(), BodyId("FridgeHandle"), (1.62, 0.75, 1.0), (1.3, 0.9, 1.0))
    door = physics_simulation.state.poses[physics_simulation.state.ids.index(DOOR)]
    assert np.degrees(2 * np.arccos(abs(door[3]))) > 20


def test_a_mug_is_lifted(physics_simulation: Simulation) -> None:
    controller = DragController(physics_simulation)
    controller.set_world(kitchenette())
    controller.start("ann", MUG, (2.0, 0.0, 0.88))
    for part in np.linspace(0.0, 1.0, 20):
        controller.move("ann", (2.0, 0.0, 0.88 + 0.3 * part), EYE)
        physics_simulation.step(0.1)
    assert position(physics_simulation, MUG)[2] > 1.05
    controller.release("ann")
    physics_simulation.step(1.5)
    assert position(physics_simulation, MUG)[2] < 0.95
