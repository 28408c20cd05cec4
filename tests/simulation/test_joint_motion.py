"""Opening, closing and moving joints, by a pull or by setting the pose."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

import mindstage as ms
from mindstage.engines import Engine, NullEngine
from mindstage.engines.mujoco import MujocoEngine
from mindstage.errors import BodyNotFoundError, InvalidArgumentError, NameNotFoundError
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import bundled_kitchen
from mindstage.scene import (
    AngularLimits,
    Attachment,
    AxisMotion,
    Body,
    BodyId,
    BodyPhysics,
    Iri,
    Joint,
    JointMimic,
    LinearLimits,
    Mobility,
    Pose,
    Vector,
    World,
)
from mindstage.scene.edits import Delete, SetPhysics
from mindstage.simulation import JointMotion, Simulation
from tests.cases import each_case
from tests.kitchenette import kitchenette


@pytest.fixture(scope="module")
def kitchen() -> Iterator[Simulation]:
    with ms.open(bundled_kitchen()) as sim:
        yield sim


@pytest.fixture
def sim(kitchen: Simulation) -> Simulation:
    kitchen.reset()
    return kitchen


@pytest.fixture(scope="module")
def static_kitchen() -> Iterator[Simulation]:
    with ms.open(bundled_kitchen(), engine="null") as sim:
        yield sim


@pytest.mark.parametrize(
    "name",
    ["fridge_door", "fridge_door_hinge", "http://mindstage.org/maps/kitchen.owl#fridge_door", "drawer_left_1"],
)
def test_a_joint_opens_and_closes(sim: Simulation, name: str) -> None:
    joint = sim.joint(name)
    assert (joint.openness, joint.position) == pytest.approx((0.0, 0.0), abs=1e-6)
    opened = joint.open()
    assert opened.arrived
    assert joint.openness > 0.95
    assert joint.position == pytest.approx(joint.open_position, abs=0.02)
    closed = joint.close()
    assert closed
    assert joint.openness < 0.05


def test_a_joint_with_parent_and_child_swapped_opens_too(sim: Simulation) -> None:
    joint = sim.joint("drawer_middle_1_slide")  # the map names the cabinet as its child
    assert joint.open()
    assert joint.is_prismatic
    assert abs(joint.position) == pytest.approx(0.45, abs=0.01)


def test_of_two_dynamic_ends_the_drawer_is_moved_whichever_is_the_parent() -> None:
    world = kitchenette()
    bodies = tuple(
        replace(each, physics=replace(each.physics, mobility=Mobility.DYNAMIC)) if each.id == "Cupboard" else each
        for each in world.bodies
    )
    slide = replace(world.joints[0], parent=BodyId("Drawer"), child=BodyId("Cupboard"))
    with Simulation(KnowledgeBase(), NullEngine()) as sim:
        sim.spawn(replace(world, bodies=bodies, joints=(slide, world.joints[1])))
        assert sim.joint("Drawer").id == "DrawerSlide"
        assert sim.joint("DrawerSlide").body == "Drawer"


def test_a_door_whose_handle_was_deleted_opens_the_same_way() -> None:
    found = []
    for deleted in ([], [BodyId("FridgeHandle")]):
        with Simulation(KnowledgeBase(), MujocoEngine(), primitive_shapes=True) as simulation:
            simulation.spawn(kitchenette())
            door = simulation.joint("FridgeDoor")
            simulation.edits.delete(deleted)
            assert door.open(0.8, timeout_s=30.0)
            found.append(door.position)
    assert found[0] == pytest.approx(found[1], abs=0.03)


def test_questions_report_that_it_is_open(sim: Simulation) -> None:
    sim.joint("fridge_door").open()
    (row,) = sim.ask("articulated_parts", thing="fridge")
    assert row.state == "open"
    assert row.share == pytest.approx(sim.joint("fridge_door").openness, abs=0.01)


def test_furniture_opens_outwards(sim: Simulation) -> None:
    before = sim.snapshot()
    for name in ("fridge_door", "drawer_left_1", "dishwasher_door"):
        joint = sim.joint(name)
        joint.open()
        after = sim.snapshot()
        handle, body = f"{joint.body}_handle", after.body(joint.body)
        holder = next(each for each in before.joints if joint.body in (each.parent, each.child))
        other = before.body(holder.parent if holder.child == body.id else holder.child).pose.position
        moved = math.dist(after.body(handle).pose.position, other) - math.dist(before.body(handle).pose.position, other)
        assert moved > 0.1, name


def test_of_two_limits_it_opens_to_the_one_where_its_handle_is_farther_away() -> None:
    kitchen = kitchenette()
    knob = replace(kitchen.body("DrawerHandle"), pose=Pose((2.3, 0.0, 0.65)))
    for side, handle in ((-0.45, kitchen.body("DrawerHandle")), (0.45, knob)):
        # Without a size, nothing is decided about where the front of the drawer is.
        drawer = replace(kitchen.body("Drawer"), size=None, pose=Pose((2.0, 0.0, 0.65)))
        cupboard, mug = kitchen.body("Cupboard"), kitchen.body("Mug")
        (slide,) = (replace(each, pose=drawer.pose) for each in kitchen.joints if each.id == "DrawerSlide")
        attachments = (
            Attachment(parent=drawer.id, child=handle.id),
            Attachment(parent=cupboard.id, child=mug.id),
        )
        world = replace(kitchen, bodies=(cupboard, drawer, handle, mug), joints=(slide,), attachments=attachments)
        with Simulation(ms.KnowledgeBase(bundled_ontology=False), NullEngine(), primitive_shapes=True) as sim:
            sim.spawn(world)
            assert sim.joint("Drawer").range == pytest.approx((-0.45, 0.45))
            assert sim.joint("Drawer").open_position == pytest.approx(side)


def shelf(joint: Joint, *, is_swapped: bool, more: tuple[Joint, ...] = ()) -> World:
    """A box beside a post in the air, joined to it; nothing is furniture, and there is no weight."""
    ends = (BodyId("box"), BodyId("post")) if is_swapped else (BodyId("post"), BodyId("box"))

    def body(id: str, position: Vector, mobility: Mobility) -> Body:
        iri = Iri(f"http://example.org/m#{id}")
        physics = BodyPhysics(mobility=mobility, gravity=False, mass_kg=1.0)
        return Body(id=BodyId(id), iri=iri, cls=iri, pose=Pose(position), size=(0.2, 0.2, 0.2), physics=physics)

    return World(
        iri=Iri("http://example.org/m#map"),
        bodies=(
            body("post", (0.0, 0.0, 1.0), Mobility.STATIC),
            body("box", (1.0, 0.0, 1.0), Mobility.DYNAMIC),
            body("twin", (-1.0, 0.0, 1.0), Mobility.DYNAMIC),
        ),
        joints=(replace(joint, parent=ends[0], child=ends[1]), *more),
    )


SLIDE = Joint(
    id=BodyId("slide"),
    iri=Iri("http://example.org/m#slide"),
    parent=BodyId("post"),
    child=BodyId("box"),
    pose=Pose((1.0, 0.0, 1.0)),
    linear=LinearLimits(y=AxisMotion.LIMITED, limit=0.3, y_middle=0.2),
)
HINGE = replace(
    SLIDE,
    pose=Pose((0.0, 0.0, 1.0)),
    linear=LinearLimits(),
    angular=AngularLimits(swing1=AxisMotion.LIMITED, swing1_limit=0.5, swing1_middle=0.3),
)


@each_case("engine", [NullEngine, MujocoEngine])
@each_case("is_swapped", [False, True])
@each_case("joint", [SLIDE, HINGE], ids=["slide", "hinge"])
def test_unequal_limits_hold_for_either_order_of_the_bodies(
    engine: type[Engine], is_swapped: bool, joint: Joint
) -> None:
    low, high = (-0.1, 0.5) if joint is SLIDE else (-0.2, 0.8)
    # positions are those of the child against the parent
    sign = -1.0 if is_swapped else 1.0
    with Simulation(ms.KnowledgeBase(bundled_ontology=False), engine(), primitive_shapes=True) as sim:
        sim.spawn(shelf(joint, is_swapped=is_swapped))
        found = sim.joint("box")
        assert found.range == pytest.approx((low, high))
        for position in (high, low, 0.0):
            assert found.move_to(position)
            x, y, _ = found.pose_at(found.position).position
            assert (y if joint is SLIDE else math.atan2(y, x)) == pytest.approx(sign * position, abs=0.02)
            assert sim.snapshot().body("box").pose.position == pytest.approx((x, y, 1.0), abs=1e-3)
        for outside in (low - 0.01, high + 0.01):
            with pytest.raises(InvalidArgumentError, match="is out of range"):
                found.move_to(outside)
        if engine is MujocoEngine:
            for end, direction in ((high, 1.0), (low, -1.0)):
                sim.pull(BodyId("box"), point=(0.0, 0.0, 0.0), target=(1.0, 3.0 * direction * sign, 1.0))
                sim.step(1.5)
                assert found.position == pytest.approx(end, abs=0.03), "the engine stops it at the limit"
            sim.release()


@pytest.mark.parametrize("multiplier", [0.5, -0.5])
def test_a_joint_that_follows_another_one_moves_it(multiplier: float) -> None:
    master = replace(
        SLIDE,
        id=BodyId("master"),
        iri=Iri("http://example.org/m#master"),
        child=BodyId("twin"),
        pose=Pose((-1.0, 0.0, 1.0)),
        linear=LinearLimits(y=AxisMotion.LIMITED, limit=1.0),
    )
    slide = replace(SLIDE, mimic=JointMimic(joint=BodyId("master"), multiplier=multiplier, offset=0.1))
    with Simulation(ms.KnowledgeBase(bundled_ontology=False), MujocoEngine(), primitive_shapes=True) as sim:
        sim.spawn(shelf(slide, is_swapped=False, more=(master,)))
        assert sim.joint("slide").move_to(0.3)
        # 0.3 = multiplier * position + 0.1
        assert sim.joint("master").position == pytest.approx(0.2 / multiplier, abs=0.02)
        assert sim.joint("slide").position == pytest.approx(0.3, abs=0.02)


def test_an_obstacle_stops_it_and_the_result_is_false(sim: Simulation) -> None:
    wall = replace(
        sim.snapshot().body("fridge"),
        id=BodyId("block"),
        iri=sim.snapshot().body("fridge").iri + "_block",
        pose=Pose((*_in_front(sim, "drawer_left_1", 0.15),)),
        size=(0.4, 0.1, 0.4),
        mesh=None,
        facts=(),
    )
    sim.spawn(
        replace(ms.load("bundled:kitchen"), bodies=(wall,), joints=(), attachments=(), lights=()), persistent=False
    )
    joint = sim.joint("drawer_left_1")
    result = joint.open(timeout_s=4.0)
    assert not result
    assert result.duration_s == pytest.approx(4.0, abs=0.1)
    assert joint.openness < 0.6
    sim.engine.run(lambda engine: engine.apply(Delete((BodyId("block"),))), edits=True)


def _in_front(sim: Simulation, id: str, gap: float) -> tuple[float, float, float]:
    x, y, z = sim.snapshot().body(f"{id}_handle").pose.position
    return x, y - gap, z


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(fraction=st.floats(0.0, 1.0), name=st.sampled_from(["fridge_door", "drawer_left_1", "microwave_door"]))
def test_an_engine_without_physics_sets_the_pose_exactly(
    static_kitchen: Simulation, fraction: float, name: str
) -> None:
    joint = static_kitchen.joint(name)
    before = static_kitchen.snapshot().body(f"{joint.body}_handle").pose
    result = joint.open(fraction)
    assert result == JointMotion(arrived=True, position=joint.position, target=result.target, duration_s=0.0)
    assert result.target == pytest.approx(joint.closed_position + fraction * joint.open_position)
    assert joint.openness == pytest.approx(fraction, abs=1e-6)
    if abs(fraction - 0.5) > 0.45:
        joint.close()
        assert joint.openness == pytest.approx(0.0, abs=1e-6)
        after = static_kitchen.snapshot().body(f"{joint.body}_handle").pose
        assert fraction == 0.0 or before != after or joint.openness == 0.0


def test_the_pose_of_a_kinematic_body_is_set(sim: Simulation) -> None:
    physics = replace(sim.snapshot().body("fridge_door").physics, mobility=Mobility.KINEMATIC)
    sim.engine.run(lambda engine: engine.apply(SetPhysics(BodyId("fridge_door"), physics)), edits=True)
    before = sim.state.time_s
    assert sim.joint("fridge_door_hinge").open(0.5)
    assert sim.state.time_s == before


def test_invalid_arguments_are_rejected(sim: Simulation) -> None:
    joint = sim.joint("fridge_door")
    for wrong in (-0.1, 1.1, math.nan):
        with pytest.raises(InvalidArgumentError, match=r"fraction .*from 0 to 1"):
            joint.open(wrong)
    with pytest.raises(InvalidArgumentError, match="out of range"):
        joint.move_to(2.0)
    with pytest.raises(NameNotFoundError, match="near: 'fridge_door'"):
        sim.joint("fridge_dor")
    with pytest.raises(NameNotFoundError):
        sim.joint("table")
    sim.engine.run(lambda engine: engine.apply(Delete((BodyId("fridge_door"),))), edits=True)
    with pytest.raises(BodyNotFoundError):
        joint.open()


def test_the_repr_shows_the_position_and_the_range(sim: Simulation, tmp_path: Path) -> None:
    assert repr(sim.joint("fridge_door")).endswith("fridge_door_hinge of fridge_door: 0.000 rad in [-1.571, 0.000]>")
