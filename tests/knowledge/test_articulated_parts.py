"""Open containers: from the joints of an engine, or as in the map."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage.engines import NullEngine
from mindstage.engines.mujoco import MujocoEngine
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.queries import JointOpenness, OpenState, articulated_parts
from mindstage.knowledge.questions import StateAccess, WorldState
from mindstage.maps import bundled_kitchen
from mindstage.rdf.graphs import local_name
from mindstage.scene import AxisMotion, BodyId, Iri, Joint, World
from mindstage.simulation import Simulation
from tests.cases import each_case
from tests.engines.scenes import BASE, attachment, body, prismatic_joint, revolute_joint, world
from tests.kitchenette import KNOWROB, kitchenette


@pytest.fixture(scope="module")
def kitchen() -> KnowledgeBase:
    kb = KnowledgeBase()
    kb.load(bundled_kitchen())
    return kb


@pytest.fixture
def sim(kitchen: KnowledgeBase) -> Iterator[Simulation]:
    with Simulation(kitchen, MujocoEngine()) as sim:
        sim.spawn()
        yield sim


def pull(sim: Simulation, handle: str, by: tuple[float, float, float]) -> None:
    """Pulls a body by a spring for three seconds."""
    at = sim.state.poses[sim.state.ids.index(BodyId(handle))][:3]
    x, y, z = np.add(at, by).tolist()
    sim.pull(BodyId(handle), point=(0.0, 0.0, 0.0), target=(x, y, z))
    sim.step(3.0)
    sim.release()


def test_a_fridge_is_open_after_pulling_its_handle_and_closed_after_a_reset(sim: Simulation) -> None:
    (closed,) = sim.ask(articulated_parts, thing="fridge")
    assert (closed.state, closed.source, closed.unit) == (OpenState.CLOSED, "mujoco", "rad")
    nothing = sim.ask(articulated_parts, state="open")
    assert (list(nothing), nothing.missing) == ([], ()), "it was measured, and nothing is open"
    pull(sim, "fridge_door_handle", (0.1, -0.55, 0.0))
    (row,) = sim.ask(articulated_parts, state="open")
    assert (local_name(row.thing), local_name(row.part)) == ("fridge", "fridge_door")
    assert row.share is not None
    assert 0.4 < row.share <= 1.0
    assert row.way == pytest.approx(row.share * np.pi / 2, abs=1e-5)
    turned, source = sim.knowledge.explain(articulated_parts, row)
    assert turned.startswith("fridge_door of fridge has turned by 0.")
    assert source == "as mujoco has it now"
    (row,) = sim.knowledge.ask(articulated_parts, thing="fridge")
    assert (row.state, row.way, row.source) == (OpenState.CLOSED, 0.0, "map")
    assert sim.knowledge.explain(articulated_parts, row)[1] == "as the map has it; no simulation is running"
    sim.reset()
    assert not sim.ask(articulated_parts, state="open")


def test_a_drawer_is_open_by_as_much_as_it_slid(sim: Simulation) -> None:
    pull(sim, "drawer_left_1_handle", (0.0, -0.3, 0.0))
    (row,) = sim.ask(articulated_parts, thing="drawer_unit_left", state="open")
    assert local_name(row.part) == "drawer_left_1"
    assert (row.unit, row.way) == ("m", pytest.approx(0.3, abs=0.03))
    assert row.share == pytest.approx(row.way / 0.45, abs=1e-5)
    assert len(sim.ask(articulated_parts, thing="drawer_unit_left", state="closed")) == 3


def test_an_engine_without_joint_positions_uses_the_map(kitchen: KnowledgeBase) -> None:
    with Simulation(kitchen, NullEngine()) as sim:
        sim.spawn()
        assert {(row.state, row.source) for row in sim.ask(articulated_parts)} == {(OpenState.CLOSED, "map")}
        (missing,) = sim.ask(articulated_parts, state="open").missing
        assert missing.reason.startswith("joint positions are unknown")


def test_every_front_has_one_answer_for_any_joint_roles(kitchen: KnowledgeBase) -> None:
    rows = kitchen.ask(articulated_parts)
    assert len(rows) == len(kitchen.world().joints)
    of = {local_name(row.part): local_name(row.thing) for row in rows}
    assert of["microwave_door"] == "microwave"
    assert of["drawer_middle_1"] == of["drawer_middle_2"] == "drawer_unit_middle"
    assert of["oven_door"] == "oven"


@pytest.mark.parametrize("community", [True, False], ids=["community", "bundled"])
def test_a_door_belongs_to_the_container_that_it_closes(community: bool, shared_data: Path) -> None:
    kb = KnowledgeBase(bundled_ontology=not community)
    kb.load(
        shared_data / "maps" / "iai-kitchen-original.owl",
        ontologies=[shared_data / "ontology"] if community else [],
    )
    classes = {
        local_name(str(kb.reasoner.class_of(row.part))): local_name(str(kb.reasoner.class_of(row.thing)))
        for row in kb.ask(articulated_parts)
    }
    assert classes["IAIFridgeDoor"] == "IAIFridgeCasing", "the constraint names the block that the casing stands in"
    assert classes["IAIDrawerW60H36"] == "IAIFridgeArea"
    assert classes["IAIOvenDoor"] == "IAIOvenCase"
    assert not {"IAITapTop", "IAITapBottom", "IAIDishwasherUpperRack"} & classes.keys()


# -- limits ------------------------------------------------------------------------------------------------------------


def articulated_parts_of(scene: World, **joints: tuple[float, ...]) -> list[JointOpenness]:
    """The answers for a scene with these joint positions."""
    kb = KnowledgeBase()
    state = WorldState(world=scene, spawned=(scene,), joint_positions=joints, source="hand")  # type: ignore[arg-type]
    return list(articulated_parts.ask(kb, {}, present=StateAccess(kb, lambda: state)))


def cabinet(joint: Joint, cls: str = KNOWROB + "Drawer") -> World:
    front = replace(body("front", (0.3, 0, 0.5), (0.5, 0.5, 0.2), "dynamic"), cls=Iri(cls))
    return world(body("case", (0, 0, 0.5), (0.6, 0.6, 1.0)), front, joint)


SLIDE = prismatic_joint("joint", "case", "front", (0.3, 0, 0.5), limit=0.4)
FREE = replace(SLIDE, linear=replace(SLIDE.linear, x=AxisMotion.FREE))
TURNS = revolute_joint("joint", "case", "front", (0.3, 0, 0.5), limit=1.0)
TURNS_FREE = replace(TURNS, angular=replace(TURNS.angular, swing1=AxisMotion.FREE))


@each_case(
    ("joint", "axis", "way", "state", "share"),
    [
        (SLIDE, 0, 0.0199, OpenState.CLOSED, 0.04975),
        (SLIDE, 0, 0.0201, OpenState.OPEN, 0.05025),
        (SLIDE, 0, -0.3, OpenState.OPEN, 0.75),
        (FREE, 0, 0.0199, OpenState.CLOSED, None),
        (FREE, 0, 0.0201, OpenState.OPEN, None),
        (TURNS, 5, 0.0499, OpenState.CLOSED, 0.0499),
        (TURNS, 5, -0.05, OpenState.OPEN, 0.05),
        (TURNS_FREE, 5, 0.0999, OpenState.CLOSED, None),
        (TURNS_FREE, 5, 0.1001, OpenState.OPEN, None),
    ],
)
def test_a_joint_is_open_from_the_stated_limit(
    joint: Joint, axis: int, way: float, state: OpenState, share: float | None
) -> None:
    positions = [0.0] * 6
    positions[axis] = way
    (row,) = articulated_parts_of(cabinet(joint), joint=tuple(positions))
    assert (row.state, row.way, row.source) == (state, pytest.approx(abs(way)), "hand")
    assert row.share == (None if share is None else pytest.approx(share))


@each_case(
    ("cls", "count"),
    [
        (KNOWROB + "Drawer", 1),
        (KNOWROB + "Door", 1),
        (KNOWROB + "ContainerLid", 1),
        (BASE + "NobodyKnows", 1),
        (KNOWROB + "ControlKnob", 0),
        (KNOWROB + "Handle", 0),
    ],
)
def test_doors_drawers_and_lids_open_something_and_knobs_do_not(cls: str, count: int) -> None:
    assert len(articulated_parts_of(cabinet(SLIDE, cls), joint=(0.1, 0, 0, 0, 0, 0))) == count


def test_a_joint_that_the_engine_does_not_measure_is_as_in_the_map() -> None:
    (row,) = articulated_parts_of(cabinet(SLIDE), other=(0.1, 0, 0, 0, 0, 0))
    assert (row.state, row.source) == (OpenState.CLOSED, "map")


def test_a_locked_joint_has_no_answer() -> None:
    assert articulated_parts_of(cabinet(replace(SLIDE, linear=replace(SLIDE.linear, limit=0.0)))) == []


def test_an_open_door_belongs_to_the_container_it_closes() -> None:
    shut = world(
        body("block", (0, 0, 1), (0.6, 0.6, 2)),
        replace(body("casing", (0.02, 0, 1.4), (0.56, 0.58, 1.1)), cls=Iri(KNOWROB + "Refrigerator")),
        replace(body("front", (0.32, 0, 1.4), (0.04, 0.58, 1.1), "dynamic"), cls=Iri(KNOWROB + "Door")),
        revolute_joint("joint", "block", "front", (0.32, 0.3, 1.4)),
        attachment("block", "casing"),
    )
    away = replace(shut.body("front").pose, position=(0.6, 0.3, 1.4))
    now = replace(shut, bodies=tuple(replace(each, pose=away) if each.id == "front" else each for each in shut.bodies))
    kb = KnowledgeBase()
    state = WorldState(
        world=now, spawned=(shut,), joint_positions={BodyId("joint"): (0, 0, 0, 0, 0, 0.7)}, source="hand"
    )
    (row,) = articulated_parts.ask(kb, {}, present=StateAccess(kb, lambda: state))
    assert (local_name(row.thing), row.state) == ("casing", OpenState.OPEN)


def test_a_world_without_a_map_has_answers() -> None:
    with Simulation(KnowledgeBase(), MujocoEngine()) as sim:
        sim.spawn(kitchenette())
        pull(sim, "DrawerHandle", (-0.3, 0.0, 0.0))
        (row,) = sim.ask(articulated_parts, thing="Cupboard")
        assert (local_name(row.part), row.state) == ("Drawer", OpenState.OPEN)
        assert row.map == kitchenette().iri
