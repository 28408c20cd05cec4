"""KnowRob 2's language, openEASE's descriptions, markers, and the table of KnowRob's predicates."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from mindstage.errors import PrologGoalError
from mindstage.prolog import PrologConsole
from mindstage.scene.colors import COLORS
from mindstage.simulation import MarkerType, Simulation
from tests.cases import each_case
from tests.prolog.test_cli import run
from tests.prolog.test_knowrob_predicates import values

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "reference" / "prolog.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| `([^`]+)` \| (as KnowRob|differs|not here) \| (.*) ?\|$", PAGE, re.MULTILINE)


# -- asking and telling ------------------------------------------------------------------------------------------------


def test_asking_calls_goals_and_lists_of_goals(kitchen: PrologConsole) -> None:
    cartons = {("milk_carton_1",), ("milk_carton_2",)}
    for ask in ("ask", "kb_call"):
        assert values(kitchen, f"{ask}([has_type(X, knowrob:'CowsMilk'), is_inside_of(X, fridge)])", "X") == cartons
        assert values(kitchen, f"{ask}((has_type(X, knowrob:'CowsMilk'), is_at(X, _)))", "X") == cartons
    assert len(kitchen.solutions("ask(has_type(kitchen:fridge, knowrob:'Refrigerator'))")) == 1


def test_triples_have_plain_values(kitchen: PrologConsole) -> None:
    assert kitchen.solutions("triple(milk_carton_1, mass, X)") == [{"X": 1.05}]
    heavy = values(kitchen, "triple(X, knowrob:mass, 1.05)", "X")
    assert {("milk_carton_1",), ("milk_carton_2",)} <= heavy
    assert heavy == values(kitchen, "triple(X, knowrob:mass, M), M =:= 1.05", "X")
    assert kitchen.holds("triple(milk_carton_1, gravity, true)")
    assert not kitchen.holds("triple(milk_carton_1, gravity, false)")
    assert kitchen.holds('triple(milk_carton_1, gravity, "true")')


def test_owl_thing_is_above_all(kitchen: PrologConsole) -> None:
    assert kitchen.holds("subclass_of(knowrob:'CowsMilk', owl:'Thing')")
    assert kitchen.holds("subclass_of(owl:'Thing', owl:'Thing')")
    assert not kitchen.holds("subclass_of(owl:'Thing', knowrob:'CowsMilk')")
    assert values(kitchen, "subclass_of(knowrob:'CowsMilk', X)", "X") >= {("CowsMilk",), ("Perishable",), ("Thing",)}
    assert kitchen.holds("has_type(kitchen:fridge, owl:'Thing')")
    everything = values(kitchen, "has_type(X, owl:'Thing')", "X")
    assert values(kitchen, "everything_in_map(_, X)", "X") <= everything
    assert ("CowsMilk",) not in everything
    assert ("Thing",) in values(kitchen, "has_type(kitchen:fridge, X)", "X")


def test_classes_are_reflexive_and_inherited(kitchen: PrologConsole) -> None:
    assert kitchen.holds("subclass_of(knowrob:'CowsMilk', knowrob:'CowsMilk')")
    assert kitchen.holds("is_a(knowrob:'CowsMilk', knowrob:'Drink'), is_a(kitchen:milk_carton_1, knowrob:'Drink')")
    found = values(kitchen, "instance_of(X, knowrob:'Handle')", "X")
    assert found == values(kitchen, "individual_of_class(_, knowrob:'Handle', X)", "X")
    assert kitchen.holds("is_class(knowrob:'Handle'), \\+ is_class(kitchen:fridge), is_individual(kitchen:fridge)")


def test_paths_of_a_property_are_followed_in_both_directions(console: PrologConsole) -> None:
    for one, other in ("ab", "bc", "ca", "xy"):
        assert console.holds(f"rdf_assert('http://t#{one}', 'http://t#next', 'http://t#{other}')")
    below = "findall(X, triple('http://t#a', {}('http://t#next'), X), L), sort(L, S), length(S, N)"
    assert console.solutions(below.format("transitive"))[0]["N"] == 3, "a circle leads back to its start"
    assert console.holds("triple('http://t#x', transitive('http://t#next'), 'http://t#y')")
    assert not console.holds("triple('http://t#y', transitive('http://t#next'), 'http://t#y')")
    assert console.holds("triple('http://t#y', reflexive('http://t#next'), 'http://t#y')")
    assert not console.holds("triple('http://t#a', reflexive('http://t#next'), 'http://t#c')")
    assert console.holds("triple('http://t#a', transitive(reflexive('http://t#next')), 'http://t#c')")
    assert len(console.solutions("triple(X, transitive('http://t#next'), 'http://t#y')")) == 1
    assert len(console.solutions("triple(X, transitive('http://t#next'), Y)")) == 10


def test_statements_hold_at_all_times_and_relations_of_the_present_have_no_interval(kitchen: PrologConsole) -> None:
    goal = "kb_call(has_type(kitchen:fridge, knowrob:'Refrigerator') during [B, E])"
    assert kitchen.solutions(goal) == [{"B": 0.0, "E": "inf"}]
    assert kitchen.holds("ask(triple(milk_carton_1, mass, 1.05) since 10.0)")
    with pytest.raises(PrologGoalError, match="no episode was added"):
        kitchen.solutions("kb_call(is_inside_of(milk_carton_1, fridge) during [0.0, 1.0])")


def test_knowrob_of_2018_creates_asserts_and_retracts(console: PrologConsole) -> None:
    (cup,) = console.solutions("kb_create(knowrob:'Cup', X, _), kb_assert(X, knowrob:mass, 0.25)")
    assert console.holds(f"kb_type_of('{cup['X']}', knowrob:'Cup'), kb_triple('{cup['X']}', knowrob:mass, 0.25)")
    assert console.holds(f"kb_retract('{cup['X']}', knowrob:mass, _)")
    assert not console.holds(f"kb_triple('{cup['X']}', knowrob:mass, _)")
    assert console.holds(
        "kb_create([knowrob:'Cup', knowrob:'Artifact'], X), kb_triple(X, rdf:type, knowrob:'Artifact')"
    )


@pytest.mark.parametrize(
    "form", ["mat(M), length(M, 16)", "pose([_, _, 1.4], [0.0, 0.0, _, _])", "[_, _, 1.4, _, _, _, _]"]
)
def test_poses_have_the_forms_of_knowrob_of_2016(form: str, kitchen: PrologConsole) -> None:
    pose, _, rest = form.partition("M), ")
    given = f"{pose}M)" if rest else form
    goal = f"get_timepoint(T), object_pose_at_time(fridge, T, {given})"
    assert len(kitchen.solutions(goal + (f", {rest}" if rest else ""))) == 1


def test_what_is_told_is_asked_and_forgotten(console: PrologConsole) -> None:
    told = "[new_iri(X, knowrob:'Cup'), has_type(X, knowrob:'Cup'), triple(X, knowrob:mass, 0.25)]"
    (row,) = console.solutions(f"kb_project({told}), triple(X, knowrob:mass, M)")
    assert row["M"] == 0.25
    assert row["X"].startswith("http://knowrob.org/kb/knowrob.owl#Cup_")
    assert console.holds(f"has_type('{row['X']}', knowrob:'Cup')")
    assert console.holds(f"forget(triple('{row['X']}', knowrob:mass, _))")
    assert not console.holds(f"triple('{row['X']}', knowrob:mass, _)")
    assert console.holds(
        "tell(subclass_of(knowrob:'Beaker', knowrob:'Cup')), subclass_of(knowrob:'Beaker', knowrob:'Cup')"
    )


def test_what_cannot_be_told_is_an_error(console: PrologConsole) -> None:
    for statement in (
        "is_inside_of(milk_carton_1, fridge)",
        "halt",
        "is_at(fridge, [fridge_door, [0,0,0], [0,0,0,1]])",
    ):
        with pytest.raises(PrologGoalError, match=r"asserted|frame map"):
            console.holds(f"tell({statement})")
    with pytest.raises(PrologGoalError, match="instantiated"):
        console.holds("tell(triple(kitchen:fridge, knowrob:mass, _))")
    with pytest.raises(PrologGoalError, match="fridge"):
        console.holds("tell(is_at(fridge, [map, [0, 0, 0], [0, 0, 0, 1]]))")  # nothing is spawned


# -- descriptions ------------------------------------------------------------------------------------------------------


@each_case(
    ("description", "found"),
    [
        ("[an, object, [type, milk]]", {"milk_carton_1", "milk_carton_2"}),
        ("[an, object, [type, milk_carton]]", {"milk_carton_1", "milk_carton_2"}),
        ("[an, object, [type, knowrob:'Refrigerator']]", {"fridge"}),
        ("[an, object, [type, milk], [name, milk_carton_2]]", {"milk_carton_2"}),
        (
            "[an, object, [type, milk], [inside, [an, object, [type, refrigerator]]]]",
            {"milk_carton_1", "milk_carton_2"},
        ),
        ("[an, object, [type, milk], [inside, oven]]", set()),
        ("[an, object, [type, milk], [mass, 1.05]]", {"milk_carton_1", "milk_carton_2"}),
        ("[an, object, [type, milk], [mass, 2]]", set()),
        ("[a, refrigerator]", {"fridge"}),
        ("[an, event]", set()),
        ("knowrob:'Refrigerator'", {"fridge"}),
    ],
)
def test_descriptions_find_entities(description: str, found: set[str], kitchen: PrologConsole) -> None:
    assert values(kitchen, f"entity(X, {description})", "X") == {(each,) for each in found}


def test_an_entity_is_described_so_that_it_is_found_again(kitchen: PrologConsole) -> None:
    assert values(kitchen, "entity(oven, D), entity(X, D)", "X") == {("oven",)}
    (row,) = kitchen.solutions("entity(milk_carton_1, [an, object|Properties])")
    assert [key for key, _ in row["Properties"]] == ["type", "name", "pose"]


def test_variables_in_a_description_are_bound(kitchen: PrologConsole) -> None:
    (row,) = kitchen.solutions("entity(X, [an, object, [name, milk_carton_1], [mass, M], [pose, [a, pose, P, _]]])")
    assert row["M"] == 1.05
    assert row["P"] == [-1.567, 1.5, 1.6]


@each_case(
    ("description", "why"),
    [
        ("[an, object, [type, flubber]]", "flubber"),
        ("[an, object, [flubber, 1]]", "flubber"),
        ("[a, pose, [0, 0, 0], [0, 0, 0, 1]]", "pose has no individuals"),
        ("[an, object, [on, oven, during, [0, 1]]]", "properties in descriptions have no intervals"),
        ("[the, object]", "the"),
    ],
)
def test_descriptions_that_mean_nothing_are_errors(description: str, why: str, kitchen: PrologConsole) -> None:
    with pytest.raises(PrologGoalError, match=why):
        kitchen.holds(f"entity(_, {description})")


def test_the_classes_that_a_word_stands_for_are_printed(kitchen: PrologConsole) -> None:
    goal = "mindstage_knowrob_language:words_classes(milk, Classes)"
    (row,) = kitchen.solutions(goal)
    assert [each.rpartition("#")[2] for each in row["Classes"]] == ["Milk"]


# -- showing -----------------------------------------------------------------------------------------------------------


def test_entities_are_shown(console: PrologConsole, simulation: Simulation) -> None:
    assert console.holds("spawn_semantic_map(_), show([an, object, [type, milk]]), show(oven, red)")
    green, red = COLORS["green"], COLORS["red"]
    assert dict(simulation.state.highlights) == {"milk_carton_1": green, "milk_carton_2": green, "oven": red}
    assert not console.holds("show([an, object, [type, milk], [inside, oven]])")


def test_markers_are_added_changed_and_removed(console: PrologConsole, simulation: Simulation) -> None:
    assert console.holds("spawn_semantic_map(_), marker(sphere(here), here), marker_color(here, [1, 0, 0])")
    assert console.holds("marker_pose(here, [map, [1, 2, 3], [0, 0, 0, 1]]), marker_scale(here, [0.5, 0.5, 0.5])")
    assert console.holds("marker(text(note, 'hot'), M), marker(object(fridge), Copy)")
    sphere, note, copy = simulation.state.markers
    assert (sphere.type, sphere.pose.position, sphere.color) == (MarkerType.SPHERE, (1.0, 2.0, 3.0), (1.0, 0.0, 0.0))
    assert (note.type, note.text) == (MarkerType.TEXT, "hot")
    assert (copy.type, copy.body) == (MarkerType.BODY_COPY, "fridge")
    assert console.holds("marker_remove(here), marker_remove(note), \\+ marker_remove(note)")
    assert [marker.id for marker in simulation.state.markers] == ["fridge"]
    with pytest.raises(PrologGoalError, match="here"):
        console.holds("marker_color(here, [0, 0, 1])")
    with pytest.raises(PrologGoalError, match="object"):
        console.holds("marker(banana(x), _)")


# -- the table ---------------------------------------------------------------------------------------------------------


def test_the_table_lists_at_least_120_predicates_once() -> None:
    names = [predicate for predicate, _, _ in ROWS]
    assert len(names) >= 120
    assert len(names) == len(set(names))
    assert len(re.findall(r"^\| `", PAGE, re.MULTILINE)) == len(ROWS)
    unexplained = [name for name, status, note in ROWS if status != "as KnowRob" and not note.strip()]
    assert not unexplained


def test_predicates_of_the_table_can_be_called(kitchen: PrologConsole) -> None:
    listed = ", ".join(f"'{name}'/{arity}" for name, arity in _indicators("as KnowRob", "differs"))
    goal = (
        f"member(Name/Arity, [{listed}]), functor(Head, Name, Arity), "
        "\\+ predicate_property(mindstage:Head, visible), \\+ current_op(_, fx, Name)"
    )
    assert [(row["Name"], row["Arity"]) for row in kitchen.solutions(goal)] == []


@each_case("predicate", [name for name, status, _ in ROWS if status == "not here"])
def test_predicates_that_are_not_here_say_why(predicate: str, kitchen: PrologConsole) -> None:
    name, arity = predicate.split("/")
    call = f"functor(Goal, {name}, {arity}), catch(Goal, error(existence_error(procedure, Which), _), true)"
    (row,) = kitchen.solutions(f"{call}, format(atom(Text), '~w', [Which])")
    assert row["Text"] == predicate
    with pytest.raises(PrologGoalError, match=rf"{predicate} of KnowRob is not here: ...................."):
        kitchen.holds(f"functor(Goal, {name}, {arity}), call(Goal)")


def test_every_predicate_that_is_not_here_is_in_the_table(kitchen: PrologConsole) -> None:
    rows = kitchen.solutions("knowrob_not_here(Name/Arity, _)")
    assert {(row["Name"], row["Arity"]) for row in rows} == set(_indicators("not here"))


def test_every_predicate_of_these_modules_is_in_the_table(kitchen: PrologConsole) -> None:
    listed = set(_indicators("as KnowRob", "differs", "not here"))
    for module in ("knowrob_objects", "knowrob_language", "episodes"):
        rows = kitchen.solutions(f"module_property(mindstage_{module}, exports(L)), member(Name/Arity, L)")
        own = {("full_name", 3), ("bind", 2), ("described_event", 3), ("is_episode_event", 1), ("knowrob_not_here", 2)}
        assert {(row["Name"], row["Arity"]) for row in rows} - own <= listed


def test_definitions_of_users_take_precedence(prolog: Path, tmp_path: Path) -> None:
    rules = tmp_path / "rules.pl"
    rules.write_text("urdf_load(robot, done).\nget_timepoint(noon).\n", encoding="utf-8")
    done = run("--consult", str(rules), "-g", "urdf_load(X, done), get_timepoint(T), write(X-T)")
    assert done.stdout.strip() == "robot-noon"


def _indicators(*statuses: str) -> list[tuple[str, int]]:
    names = [predicate.split("/") for predicate, status, _ in ROWS if status in statuses]
    return [(name, int(arity)) for name, arity in names]


@pytest.mark.parametrize(("goal", "holds"), [("during([1, 2], [0, 5])", True), ("during([1, 7], [0, 5])", False)])
def test_during_is_the_relation_of_allen_between_intervals(kitchen: PrologConsole, goal: str, holds: bool) -> None:
    assert kitchen.holds(goal) is holds
