"""The bundled household ontology is consistent, and agrees with the ontologies whose IRIs it uses."""

from __future__ import annotations

from pathlib import Path

import pytest
from pyoxigraph import NamedNode

from tests.maps.bundled_classes import TYPE, OntologyClasses, short_name
from tests.maps.bundled_scene import HOUSEHOLD, KNOWROB, OWL, RDFS

TOPS = {"SpatialThing", "TemporalThing", "Agent-Generic"}
IAI_MAP = "iai-kitchen-original.owl"
ADDED = {"HeatSource", "Milk"}
"""Superclasses that the bundled ontology adds to classes of KnowRob: devices that produce heat, kinds of milk."""
ADDED_TO = {"Milk": {"DairyProduct", "Food", "Perishable", "FoodOrDrinkOrIngredient"}}
"""Superclasses that it adds to one class: KnowRob's Milk is a drink only, but milk is kept cool."""


@pytest.fixture(scope="module")
def household() -> OntologyClasses:
    return OntologyClasses(HOUSEHOLD)


@pytest.fixture(scope="module")
def laboratory(shared_data: Path) -> OntologyClasses:
    """The bundled ontology and the laboratory kitchen, nothing else."""
    return OntologyClasses(HOUSEHOLD, shared_data / "maps" / IAI_MAP)


@pytest.fixture(scope="module")
def knowrob(shared_data: Path) -> OntologyClasses:
    return OntologyClasses(*ontologies(shared_data))


def ontologies(shared_data: Path) -> list[Path]:
    return sorted((shared_data / "ontology").rglob("*.owl"))


def test_it_is_one_ontology_with_an_iri() -> None:
    (name,) = OntologyClasses(HOUSEHOLD).individuals_of_type(OWL + "Ontology")
    assert name == "http://mindstage.org/ontology/household.ttl"


def test_it_stays_small_because_it_is_loaded_on_every_start() -> None:
    assert HOUSEHOLD.stat().st_size < 300_000


def test_it_contains_the_classes_of_a_household(household: OntologyClasses) -> None:
    assert len(household.declared) >= 600
    assert sum(name.startswith("ms:") for name in household.declared) >= 100


def test_every_class_has_a_known_top_class(household: OntologyClasses) -> None:
    assert {cls for cls in household.declared if not household.parents[cls]} == TOPS
    assert [cls for cls in household.declared if not household.class_and_ancestors(cls) & TOPS] == []


def test_the_class_hierarchy_is_acyclic(household: OntologyClasses) -> None:
    assert household.in_cycles() == []


def test_every_name_is_declared(household: OntologyClasses) -> None:
    kinds = ("ObjectProperty", "DatatypeProperty", "AnnotationProperty", "NamedIndividual")
    known = household.declared.union(*(household.individuals_of_type(OWL + kind) for kind in kinds))
    named = {
        short_name(node)
        for quad in household.store
        for node in (quad.subject, quad.object)
        if isinstance(node, NamedNode)
        and node.value.startswith(("http://knowrob.org/", "http://mindstage.org/ontology#"))
    }
    assert named - known == set()


def test_every_class_except_those_of_the_laboratory_has_a_label(household: OntologyClasses) -> None:
    label = NamedNode(RDFS + "label")
    labeled = {short_name(quad.subject) for quad in household.store.quads_for_pattern(None, label, None)}
    parents = {parent for above in household.parents.values() for parent in above}
    assert parents <= labeled
    assert {cls for cls in household.declared if cls.startswith("ms:")} <= labeled


def test_disjoint_classes_share_nothing(household: OntologyClasses) -> None:
    pairs = list(household.disjoint())
    assert len(pairs) >= 25
    for one, other in pairs:
        assert [cls for cls in household.declared if {one, other} <= household.class_and_ancestors(cls)] == [], (
            one,
            other,
        )


def test_containers_are_containers_and_actions_are_actions(household: OntologyClasses) -> None:
    containers = list(household.restrictions("typePrimaryFunction-containerFor"))
    actions = list(household.restrictions("deviceUsed"))
    assert len(containers) >= 45
    assert len(actions) >= 40
    for each in containers:
        assert "Container" in household.ancestors(each.subject), each
        assert all("HumanScaleObject" in household.class_and_ancestors(filler) for filler in each.fillers), each
    for each in actions:
        assert "ActionOnObject" in household.ancestors(each.subject), each
        # KnowRob classifies sinks as furniture and not as devices.
        assert all({"PhysicalDevice", "Sink"} & household.class_and_ancestors(filler) for filler in each.fillers), each


def test_perishables_belong_in_the_refrigerator(household: OntologyClasses) -> None:
    assert set(household.storage_classes_for("CowsMilk")) == {"Refrigerator"}
    assert set(household.storage_classes_for("ms:FrozenPizza")) == {"Refrigerator-Freezer"}


def test_bread_belongs_in_the_breadbasket_before_the_refrigerator(household: OntologyClasses) -> None:
    places = household.storage_classes_for("Bread")
    assert set(places) == {"ms:Breadbasket", "Refrigerator"}
    assert places["ms:Breadbasket"] < places["Refrigerator"]


def test_the_dishwasher_takes_a_union_of_things(household: OntologyClasses) -> None:
    (restriction,) = [
        each for each in household.restrictions("typePrimaryFunction-containerFor") if each.subject == "Dishwasher"
    ]
    assert set(restriction.fillers) == {"FoodUtensil", "FoodVessel"}
    assert "Dishwasher" in household.storage_classes_for("DinnerFork")
    assert "Dishwasher" in household.storage_classes_for("Skillet")


def test_drinking_vessels_contain_drinks_but_do_not_store_them(household: OntologyClasses) -> None:
    kinds = {
        each.restriction_type
        for each in household.restrictions("typePrimaryFunction-containerFor")
        if "Drink" in each.fillers
    }
    assert kinds == {"allValuesFrom"}


@pytest.mark.parametrize(
    ("cls", "count"), [("Handle", 18), ("Door", 13), ("StorageConstruct", 18), ("ElectricalDevice", 14)]
)
def test_the_laboratory_kitchen_has_the_counts_of_the_thesis(laboratory: OntologyClasses, cls: str, count: int) -> None:
    assert len(laboratory.instances(cls)) == count


def test_every_class_of_the_laboratory_kitchen_is_known(
    laboratory: OntologyClasses, household: OntologyClasses
) -> None:
    described = NamedNode(KNOWROB + "describedInMap")
    used = {
        short_name(kind.object)
        for quad in laboratory.store.quads_for_pattern(None, described, None)
        for kind in laboratory.store.quads_for_pattern(quad.subject, TYPE, None)
    } - {"owl:NamedIndividual"}
    assert len(used) == 64
    assert used <= household.declared


def test_milk_of_the_laboratory_kitchen_is_stored_in_its_fridge(laboratory: OntologyClasses) -> None:
    places = [place for cls in laboratory.storage_classes_for("CowsMilk") for place in laboratory.instances(cls)]
    assert classes_of(laboratory, places) == ["IAIFridgeCasing"]


@pytest.mark.parametrize(
    ("action", "devices", "pieces"),
    [
        ("BakingFood", {"HeatSource"}, ["IAICooktop", "IAIOvenCase"]),
        ("WashingDishesByMachine", {"Dishwasher"}, ["IAIDishwasherCase"]),
    ],
)
def test_devices_of_the_laboratory_kitchen_for_an_action(
    laboratory: OntologyClasses, action: str, devices: set[str], pieces: list[str]
) -> None:
    assert laboratory.devices_for(action) == devices
    assert classes_of(laboratory, [each for cls in devices for each in laboratory.instances(cls)]) == pieces


def classes_of(classes: OntologyClasses, individuals: list[str]) -> list[str]:
    return sorted(
        short_name(quad.object)
        for quad in classes.store.quads_for_pattern(None, TYPE, None)
        if isinstance(quad.subject, NamedNode)
        and quad.subject.value.rpartition("#")[2] in individuals
        and short_name(quad.object) != "owl:NamedIndividual"
    )


def test_shared_classes_have_the_superclasses_of_knowrob(household: OntologyClasses, knowrob: OntologyClasses) -> None:
    theirs = knowrob.declared | set(knowrob.parents)
    shared = household.declared & (theirs | {parent for parents in knowrob.parents.values() for parent in parents})
    assert len(shared) >= 500
    for cls in shared:
        ours, known = household.ancestors(cls) & shared, knowrob.ancestors(cls) & shared
        assert known <= ours, f"{cls} is not under {known - ours}"
        placed = "SpatialThing" in known or "TemporalThing" in known
        extra = ours - known - ADDED - ADDED_TO.get(cls, set())
        assert not (placed and extra), f"{cls} is not known to be under {extra}"


def test_it_can_be_loaded_with_knowrob_s_ontologies(shared_data: Path, laboratory: OntologyClasses) -> None:
    both = OntologyClasses(HOUSEHOLD, shared_data / "maps" / IAI_MAP, *ontologies(shared_data))
    assert [cls for cls in both.in_cycles() if cls in laboratory.declared] == []
    for one, other in OntologyClasses(HOUSEHOLD).disjoint():
        assert [cls for cls in both.declared if {one, other} <= both.class_and_ancestors(cls)] == [], (one, other)
    for cls in ("Handle", "Door", "StorageConstruct", "ElectricalDevice", "HeatSource", "Refrigerator"):
        assert both.instances(cls) == laboratory.instances(cls), cls
