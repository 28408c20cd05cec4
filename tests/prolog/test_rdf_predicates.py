"""RDF predicates, named as in SWI-Prolog's semweb library and KnowRob."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from mindstage.errors import PrologGoalError
from mindstage.prolog import PrologConsole
from tests.cases import each_case
from tests.cli.runner import map_text

KITCHEN = "http://mindstage.org/maps/kitchen.owl#"
KNOWROB = "http://knowrob.org/kb/knowrob.owl#"
XSD = "http://www.w3.org/2001/XMLSchema#"


def values(console: PrologConsole, goal: str, variable: str = "X") -> list[Any]:
    return [solution[variable] for solution in console.solutions(goal, limit=100_000)]


def test_triples_are_found_from_any_end(kitchen: PrologConsole) -> None:
    part, whole = f"{KITCHEN}fridge_door_handle", f"{KITCHEN}fridge_door"
    assert part in values(kitchen, "rdf(kitchen:fridge_door, knowrob:child, X)")
    assert whole in values(kitchen, "rdf(X, knowrob:child, kitchen:fridge_door_handle)")
    assert f"{KNOWROB}child" in values(kitchen, "rdf(kitchen:fridge_door, X, kitchen:fridge_door_handle)")
    assert kitchen.holds("rdf(kitchen:fridge_door, knowrob:child, kitchen:fridge_door_handle)")
    assert not kitchen.holds("rdf(kitchen:fridge_door_handle, knowrob:child, kitchen:fridge_door)")
    assert len(values(kitchen, "rdf(X, _, _)")) > 5000


@each_case(
    "goal",
    [
        "rdf(M, P, literal(type(_, Text)))",
        "rdf(M, P, literal(type(xsd:string, Text)))",
        "rdf(M, P, literal(Inner)), Inner = type(_, Text)",
        "rdf(M, P, literal(type(xsd:string, dynamic))), Text = dynamic",
        "rdf(M, P, literal(type(_, dynamic))), Text = dynamic",
        "rdf(M, P, literal(dynamic)), Text = dynamic",
        "rdf(M, P, Value), Value = literal(type(_, Text))",
        "rdf_has(M, P, literal(type(_, Text)))",
    ],
)
def test_literals_are_terms_as_in_rdf_db(goal: str, kitchen: PrologConsole) -> None:
    assert values(kitchen, f"M = kitchen:milk_carton_1, P = knowrob:mobility, {goal}", "Text") == ["dynamic"]


@pytest.mark.parametrize("value", ["literal(static)", "literal(type(xsd:integer, dynamic))", "literal(lang(en, _))"])
def test_other_literals_are_not_found(value: str, kitchen: PrologConsole) -> None:
    assert not kitchen.holds(f"rdf(kitchen:milk_carton_1, knowrob:mobility, {value})")


def test_literals_can_have_a_language(kitchen: PrologConsole) -> None:
    assert values(kitchen, "rdf(knowrob:'CowsMilk', rdfs:label, literal(lang(en, X)))") == ["cow's milk"]
    assert values(kitchen, "rdfs_label(knowrob:'CowsMilk', X)") == ["cow's milk"]


@pytest.mark.parametrize("value", ['"a string"', "17", "f(x)"])
def test_values_other_than_resources_and_literals_are_refused(value: str, kitchen: PrologConsole) -> None:
    with pytest.raises(PrologGoalError, match="is neither a resource nor a literal; give an atom, or literal"):
        kitchen.holds(f"rdf(_, rdfs:label, {value})")


# -- what follows ------------------------------------------------------------------------------------------------------


def test_classes_are_subclasses_of_themselves(kitchen: PrologConsole) -> None:
    above = values(kitchen, "rdfs_subclass_of(knowrob:'CowsMilk', X)")
    assert above[0] == f"{KNOWROB}CowsMilk"
    assert f"{KNOWROB}Perishable" in above
    assert f"{KNOWROB}CowsMilk" in values(kitchen, "owl_subclass_of(X, knowrob:'Perishable')")
    assert kitchen.holds("rdfs_subclass_of(knowrob:'CowsMilk', knowrob:'Perishable')")
    assert not kitchen.holds("rdfs_subclass_of(knowrob:'Perishable', knowrob:'CowsMilk')")
    assert len(kitchen.solutions("rdfs_subclass_of(_, _)", limit=100_000)) > 1000


def test_individuals_belong_to_all_superclasses(kitchen: PrologConsole) -> None:
    assert len(values(kitchen, "rdfs_individual_of(X, knowrob:'Handle')")) == 33
    assert f"{KNOWROB}Handle" in values(kitchen, "owl_individual_of(kitchen:fridge_door_handle, X)")
    assert kitchen.holds("rdfs_individual_of(kitchen:fridge_door_handle, knowrob:'Handle')")
    assert not kitchen.holds("rdfs_individual_of(kitchen:fridge_door_handle, knowrob:'Door')")
    assert len(values(kitchen, "rdfs_individual_of(X, owl:'Class')")) > 500
    assert len(kitchen.solutions("rdfs_individual_of(_, _)", limit=100_000)) > 1000


def test_properties_are_followed_to_any_depth(kitchen: PrologConsole) -> None:
    parts = values(kitchen, "rdf_reachable(kitchen:fridge, knowrob:child, X)")
    assert parts[0] == f"{KITCHEN}fridge"
    wholes = values(kitchen, "rdf_reachable(X, knowrob:child, kitchen:fridge_door_handle)")
    assert wholes[:2] == [f"{KITCHEN}fridge_door_handle", f"{KITCHEN}fridge_door"]
    with pytest.raises(PrologGoalError, match="instantiated"):
        kitchen.holds("rdf_reachable(_, knowrob:child, _)")


def test_class_properties_are_inherited(kitchen: PrologConsole) -> None:
    promised = "owl_class_properties(Class, knowrob:'typePrimaryFunction-containerFor', Value)"
    goal = f"Class = ms:'FridgeW60H140', {promised}"
    assert f"{KNOWROB}Perishable" in values(kitchen, goal, "Value")
    assert values(kitchen, f"Class = knowrob:'Dishwasher', {promised}, Value = union_of(X)") == [
        [f"{KNOWROB}FoodUtensil", f"{KNOWROB}FoodVessel"]
    ]
    owners = values(kitchen, "owl_class_properties(X, knowrob:'typePrimaryFunction-containerFor', knowrob:'Bread')")
    assert "http://mindstage.org/ontology#Breadbasket" in owners
    assert f"{KNOWROB}deviceUsed" in values(kitchen, "owl_class_properties(knowrob:'BakingFood', X, _)")


# -- assertions --------------------------------------------------------------------------------------------------------


def test_an_asserted_triple_is_found_at_once_and_can_be_retracted(console: PrologConsole) -> None:
    assert not console.holds("get_subclass_in_map(_, 'Robot', _)")
    console.holds("rdf_assert(kitchen:pr2, rdf:type, knowrob:'Robot')")
    console.holds("rdf_assert(kitchen:pr2, knowrob:describedInMap, kitchen:kitchen)")
    assert values(console, "get_subclass_in_map(_, 'Robot', X)") == [f"{KITCHEN}pr2"]
    assert console.holds("rdf_retractall(kitchen:pr2, rdf:type, _), rdf_retractall(kitchen:pr2, rdf:type, _)")
    assert not console.holds("get_subclass_in_map(_, 'Robot', _)")


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        ("literal('a b')", f"literal(type('{XSD}string','a b'))"),
        ("literal(3)", f"literal(type('{XSD}integer','3'))"),
        ("literal(0.5)", f"literal(type('{XSD}double','0.5'))"),
        ("literal(type(xsd:boolean, true))", f"literal(type('{XSD}boolean',true))"),
        ("literal(lang(de, 'Tür'))", "literal(lang(de,'Tür'))"),
        ("kitchen:oven", f"'{KITCHEN}oven'"),
    ],
)
def test_literals_are_asserted_with_their_datatypes(value: str, shown: str, console: PrologConsole) -> None:
    console.holds(f"rdf_assert(kitchen:fridge, knowrob:note, {value})")
    goal = "rdf(kitchen:fridge, knowrob:note, V), format(atom(X), '~q', [V])"
    assert values(console, goal) == [shown]
    if value.startswith("literal"):
        assert console.holds(f"rdf_retractall(kitchen:fridge, knowrob:note, {value})")
        assert not console.holds("rdf(kitchen:fridge, knowrob:note, _)")


@pytest.mark.parametrize("value", ["_", "literal(_)", "literal(type(xsd:string, _))", "'no name'"])
def test_incomplete_values_cannot_be_asserted(value: str, console: PrologConsole) -> None:
    with pytest.raises(PrologGoalError) as refused:
        console.holds(f"rdf_assert(kitchen:fridge, knowrob:note, {value})")
    assert refused.value.error_type == "InvalidArgumentError"


def test_loading_a_file_registers_its_prefix(console: PrologConsole, tmp_path: Path) -> None:
    path = tmp_path / "room.owl"
    path.write_text(map_text(["Room"], {"Mug1": "1.0 2.0 0.0"}), encoding="utf-8")
    assert console.holds(f"owl_parse('{path}'), get_subclass_in_map(room:'Room', knowrob:'Mug', room:'Mug1')")
    assert console.holds(f"owl_parser:owl_parse('{path}')")
    with pytest.raises(PrologGoalError) as refused:
        console.holds("owl_parse('nowhere.owl')")
    assert refused.value.error_type == "SourceParseError"


def test_files_that_load_semweb_get_this_store_instead(kitchen: PrologConsole, tmp_path: Path) -> None:
    file = tmp_path / "knowrob_style.pl"
    file.write_text(
        ":- module(knowrob_style, [part_named/2]).\n"
        ":- use_module(library('semweb/rdf_db')).\n"
        ":- use_module(library(semweb/rdfs), [rdfs_individual_of/2]).\n"
        ":- rdf_db:rdf_register_ns(own, 'http://own.org/o#', [keep(true)]).\n"
        "part_named(Whole, Part) :- rdf_has(Whole, knowrob:child, Part), rdfs_individual_of(Part, knowrob:'Handle').\n",
        encoding="utf-8",
    )
    assert kitchen.consult(file) == 0
    assert values(kitchen, "part_named(kitchen:fridge_door, X)") == [f"{KITCHEN}fridge_door_handle"]
    assert values(kitchen, "rdf_global_id(own:a, X)") == ["http://own.org/o#a"]
