"""The bundled kitchen: it is what its script generates, complete, and answers questions."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pyoxigraph import NamedNode

from mindstage.knowledge import KnowledgeBase
from mindstage.maps import bundled_kitchen
from tests.cases import each_case
from tests.maps.bundled_classes import OntologyClasses, short_name
from tests.maps.bundled_scene import HOUSEHOLD, KITCHEN, KITCHEN_NS, KNOWROB, Scene

ROOT = Path(__file__).parents[2]
SCRIPT = ROOT / "scripts/make_kitchen.py"


@pytest.fixture(scope="module")
def kitchen() -> Scene:
    return Scene(KITCHEN)


@pytest.fixture(scope="module")
def knowledge() -> OntologyClasses:
    return OntologyClasses(HOUSEHOLD, KITCHEN)


# ---------------------------------------------------------------------------------------------------- the script


def test_the_file_is_what_the_script_generates() -> None:
    done = subprocess.run([sys.executable, SCRIPT, "--check"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A copy of the script and its modules in a writable project."""
    shutil.copytree(SCRIPT.parent, tmp_path / "scripts", ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / KITCHEN.relative_to(ROOT)).parent.mkdir(parents=True)
    return tmp_path


def make(project: Path, *arguments: str, seed: str = "0") -> int:
    command = [sys.executable, project / "scripts/make_kitchen.py", *arguments]
    done = subprocess.run(command, capture_output=True, check=False, env={**os.environ, "PYTHONHASHSEED": seed})
    return done.returncode


def test_the_script_always_writes_the_same_file(copy: Path) -> None:
    written = copy / KITCHEN.relative_to(ROOT)
    for seed in ("1", "2"):
        assert make(copy, seed=seed) == 0
        assert written.read_bytes() == KITCHEN.read_bytes()


def test_check_reports_a_stale_file_and_does_not_change_it(copy: Path) -> None:
    written = copy / KITCHEN.relative_to(ROOT)
    assert make(copy, "--check") == 1
    assert not written.exists()
    stale = KITCHEN.read_bytes().replace(b"0.45", b"0.44")
    written.write_bytes(stale)
    assert make(copy, "--check") == 1
    assert written.read_bytes() == stale


# ---------------------------------------------------------------------------------------------------- the map


def test_swi_prolog_reads_the_same_number_of_statements(kitchen: Scene, swipl: Path) -> None:
    load = f"use_module(library(semweb/rdf_db)), rdf_load('{KITCHEN}', [silent(true)])"
    goal = f"{load}, rdf_statistics(triples(Count)), writeln(Count)"
    done = subprocess.run([swipl, "-g", goal, "-t", "halt"], capture_output=True, text=True, check=True, timeout=60)
    assert int(done.stdout) == len(kitchen.store)


def test_it_contains_a_complete_kitchen(kitchen: Scene) -> None:
    assert len(kitchen.boxes) >= 200
    assert len(kitchen.movable_boxes) >= 100


def test_it_has_many_doors_and_drawers(kitchen: Scene) -> None:
    assert len(kitchen.fronts_with_joints) == len(kitchen.joints) >= 30
    assert sum(id.startswith("drawer_") for id in kitchen.fronts_with_joints) >= 15
    assert sum("door" in id for id in kitchen.fronts_with_joints) >= 15


def test_joints_connect_parts_with_cases(kitchen: Scene) -> None:
    for part, joint in kitchen.fronts_with_joints.items():
        assert kitchen.boxes[part].mobility == "dynamic"
        assert kitchen.boxes[joint.parent].mobility == "static"


def test_some_joints_have_swapped_roles(kitchen: Scene) -> None:
    assert 2 <= sum(joint.is_reversed for joint in kitchen.joints) <= 5


def test_attachments_are_given_by_either_body(kitchen: Scene) -> None:
    by_parent = {(short_name(quad.subject), short_name(quad.object)) for quad in relation_quads(kitchen, "child")}
    by_child = {(short_name(quad.object), short_name(quad.subject)) for quad in relation_quads(kitchen, "parent")}
    assert min(len(by_parent - by_child), len(by_child - by_parent), len(by_parent & by_child)) >= 10
    assert len(by_parent | by_child) == len(kitchen.parents)


def relation_quads(kitchen: Scene, property: str) -> list:
    quads = kitchen.store.quads_for_pattern(None, NamedNode(KNOWROB + property), None)
    return [quad for quad in quads if quad.subject.value.removeprefix(KITCHEN_NS) in kitchen.boxes]


def test_attached_bodies_are_not_dynamic(kitchen: Scene) -> None:
    for child in kitchen.parents:
        assert kitchen.boxes[child].mobility in {"kinematic", "static"}
    kinematic = {box.id for box in kitchen.boxes.values() if box.mobility == "kinematic"}
    assert kinematic <= set(kitchen.parents)


def test_masses_are_realistic(kitchen: Scene) -> None:
    for box in kitchen.boxes.values():
        if box.mobility == "static":
            assert box.mass == 0, box.id
        else:
            density = box.mass / np.prod(box.size)
            assert 20 <= density <= 2700, f"{box.id} weighs {density:.0f} kg per cubic meter"


def test_tags_name_the_class_and_the_id(kitchen: Scene) -> None:
    for box in kitchen.boxes.values():
        assert kitchen.value(box.id, "tagsData") == f"SemLog;Class,{box.cls};Id,{box.id};"
    for joint in kitchen.joints:
        assert kitchen.value(joint.id, "tagsData") == f"SemLog;Id,{joint.id};"


def test_poses_have_six_decimals(kitchen: Scene) -> None:
    for property, count in (("translation", 3), ("quaternion", 4)):
        for quad in kitchen.store.quads_for_pattern(None, NamedNode(KNOWROB + property), None):
            words = quad.object.value.split()
            assert len(words) == count
            assert all(len(word.partition(".")[2]) == 6 for word in words)
            assert "-0.000000" not in words


def test_every_class_in_use_is_a_subclass_in_the_household_ontology(kitchen: Scene, knowledge: OntologyClasses) -> None:
    household = OntologyClasses(HOUSEHOLD)
    for cls in {box.cls for box in kitchen.boxes.values()}:
        (base,) = knowledge.parents[f"ms:{cls}"]
        assert base in household.declared, cls
        assert "SpatialThing" in knowledge.ancestors(f"ms:{cls}"), cls


def test_it_redefines_no_class_of_the_household_ontology(kitchen: Scene) -> None:
    household = OntologyClasses(HOUSEHOLD)
    assert {f"ms:{box.cls}" for box in kitchen.boxes.values()} & household.declared == set()


def test_the_knowledge_base_reads_it_without_a_finding(kitchen: Scene) -> None:
    knowledge = KnowledgeBase()
    knowledge.load([bundled_kitchen()])
    world = knowledge.world("kitchen")
    assert knowledge.findings() == ()
    assert {body.id for body in world.bodies} == set(kitchen.boxes)
    for body in world.bodies:
        box = kitchen.boxes[body.id]
        assert body.pose.position == tuple(box.center)
        assert body.size == tuple(box.size)
        assert (body.physics.mobility.value, body.physics.mass_kg) == (box.mobility, box.mass)
    assert {(each.child, each.parent) for each in world.attachments} == set(kitchen.parents.items())
    held = {each.id: {each.parent, each.child} for each in world.joints}
    assert held == {joint.id: {joint.parent, joint.child} for joint in kitchen.joints}


# ---------------------------------------------------------------------------------------------------- its answers


@each_case(
    ("item", "places"),
    [
        ("CowsMilk", {"fridge"}),
        ("Bread", {"woven_breadbasket_1", "fridge"}),
        ("ms:FrozenPizza", {"freezer"}),
        ("Apple", {"wide_fruit_bowl_1", "fridge"}),
        ("DinnerFork", {"drawer_left_1", "dishwasher"}),
        ("WheatFlour", {"pantry", "spice_cupboard"}),
        ("DishwashingSoap", {"sink_cupboard"}),
    ],
)
def test_items_have_storage_places(knowledge: OntologyClasses, item: str, places: set[str]) -> None:
    assert {each for cls in knowledge.storage_classes_for(item) for each in knowledge.instances(cls)} == places


@each_case(
    ("action", "devices"),
    [
        ("BakingFood", {"oven", "hob"}),
        ("ms:BakingBread", {"oven", "hob"}),
        ("WashingDishesByMachine", {"dishwasher"}),
        ("MakingCoffee-TheBeverage", {"filter_coffee_maker_1"}),
        ("ms:SlicingBread", {"serrated_knife_1", "oak_board_1"}),
        ("TurningOnWater", {"tap"}),
    ],
)
def test_actions_have_devices(knowledge: OntologyClasses, action: str, devices: set[str]) -> None:
    found = {each for cls in knowledge.devices_for(action) for each in knowledge.instances(cls)}
    assert devices <= found
    assert found - devices <= {each for each in found if "knife" in each}


def test_stored_items_are_at_their_storage_places(kitchen: Scene, knowledge: OntologyClasses) -> None:
    in_use = {"sink", "microwave", "oven"}
    put_away = 0
    for item in kitchen.movable_boxes:
        low, high = item.extent
        places = [
            box
            for box in kitchen.boxes.values()
            if box.id != item.id and (box.extent[0] < low).all() and (high < box.extent[1]).all()
        ]
        stores = knowledge.storage_classes_for(f"ms:{item.cls}")
        right = {each for cls in stores for each in knowledge.instances(cls)}
        if places and right and in_use.isdisjoint(box.id for box in places):
            assert right & {box.id for box in places}, f"{item.id} is in {places[0].id}, its place is {right}"
            put_away += 1
    assert put_away >= 50


def test_counts_of_classes(kitchen: Scene, knowledge: OntologyClasses) -> None:
    assert len(knowledge.instances("Handle")) == len(kitchen.fronts_with_joints)
    assert len(knowledge.instances("Drawer")) + len(knowledge.instances("Door")) == len(kitchen.fronts_with_joints)
    assert knowledge.instances("HeatSource") == {"oven", "hob"}
    assert len(knowledge.instances("Food")) >= 25
