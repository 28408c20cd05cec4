"""Files of KnowRob users: which load, what is missing and why, and the OWL predicates that they use."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

from mindstage.errors import PrologGoalError
from mindstage.prolog import PrologConsole
from tests.cases import each_case

KITCHEN = "http://mindstage.org/maps/kitchen.owl#"
KNOWROB = "http://knowrob.org/kb/knowrob.owl#"


def load(console: PrologConsole, folder: Path, text: str, name: str = "pkg/prolog/rules.pl") -> int:
    file = folder / name
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text, encoding="utf-8")
    return console.consult(file)


def values(console: PrologConsole, goal: str, variable: str = "X") -> list[Any]:
    return [solution[variable] for solution in console.solutions(goal, limit=100_000)]


# -- packages ----------------------------------------------------------------------------------------------------------

PACKAGES = Path(__file__).with_name("packages")
FRIDGE_DOOR = f"'{KITCHEN}fridge_door'"


@pytest.mark.parametrize(
    ("file", "goals"),
    [
        (
            "lab_tools/prolog/init.pl",
            {
                "tools_of_class(knowrob:'Handle', Ts), length(Ts, 33)": 1,
                f"handle_height({FRIDGE_DOOR}, 1.15)": 1,
                "spoken_name('http://a#fridge_door', 'fridge door')": 1,
                "heavy_thing(X), \\+ ( rdf_has(X, knowrob:mass, literal(type(_, V))), atom_number(V, N), N =< 5 )": 17,
                "is_class('http://example.org/lab.owl#Wrench')": 1,
            },
        ),
        (
            "lab_rules/prolog/comp_lab.pl",
            {
                "rdf_has(A, lab:onTopOf, kitchen:floor), comp_on_top(A, B), B == 'FLOOR'": 0,
                f"comp_on_top('{KITCHEN}milk_carton_1', '{KITCHEN}floor'), "
                f"rdf_has('{KITCHEN}milk_carton_1', lab:onTopOf, '{KITCHEN}floor')": 1,
                "comp_dist(fridge, fridge, D), D =:= 0.0": 1,
            },
        ),
        ("lab_rules/prolog/lab_tests.pl", {"run_tests(lab_tools)": 1}),
        (
            "lab_rules/prolog/perception.pl",
            {
                "see(knowrob:'Cup', X), seen(X, T), get_timepoint(Now), Now @>= T": 1,
                "visible_at(fridge, _, [_, _, 1.4])": 1,
            },
        ),
        (
            "lab_lang/prolog/episodes.pl",
            {
                f"ep_event('{KITCHEN}fridge', knowrob:'Refrigerator')": 1,
                "ep_create(dul:'Event', E, belief_state), rdf_has(E, dul:hasTimeInterval, I), I \\== E": 1,
            },
        ),
        (
            "lab_lang/prolog/openease_queries.pl",
            {
                "milk_pose(X, [_, _, Z]), number(Z)": 2,
                "where(milk_carton_1, Y), where_then(milk_carton_1, Y, T), nonvar(T)": 1,
                "setof(P, store_at(milk_carton_1, P), [One]), kb_type_of(One, knowrob:'Refrigerator')": 1,
            },
        ),
        (
            "lab2/src/__init__.pl",
            {
                "tool_on(X, Y), rdf_has(X, soma:isOntopOf, Y)": 90,
                "tool_mass(milk_carton_1, 1.05)": 1,
                "grasp_handle(X, _), is_a(X, knowrob:'Door')": 17,
                "mass_during(milk_carton_1, 1.05, [0.0, inf])": 1,
                "tell(is_tool(fridge)), is_tool(kitchen:fridge)": 1,
                "rdf_has(C, knowrob:child, D), \\+ drawer_of(D, C)": 0,
            },
        ),
    ],
)
def test_files_in_the_manner_of_knowrobs_packages_load_and_answer(
    file: str, goals: dict[str, int], console: PrologConsole, capfd: pytest.CaptureFixture[str]
) -> None:
    assert console.consult(PACKAGES / file) == 0, capfd.readouterr().err
    assert {goal: len(console.solutions(goal, limit=200)) for goal in goals} == goals


@pytest.mark.parametrize(
    ("uses", "message"),
    [
        ("library('lang/terms/is_a'), [instance_of/2, subclass_of/2]", ""),
        ("library('knowrob/lang/ask'), [kb_triple/3, kb_type_of/2]", ""),
        ("library(comp_spatial), [comp_above_of/2, comp_center/2]", "Mindstage does not have comp_center/2"),
        ("library(comp_spatial)", "Mindstage has its own predicates in place of most of those in it"),
    ],
)
def test_of_knowrobs_own_libraries_only_what_is_not_here_is_missing(
    uses: str, message: str, kitchen: PrologConsole, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert load(kitchen, tmp_path, f":- module(uses_{abs(hash(uses))}, []).\n:- use_module({uses}).\n") == 0
    printed = capfd.readouterr().err.replace("\nWarning:    ", " ")
    assert message in printed
    assert bool(printed) == bool(message)


# -- libraries and packages --------------------------------------------------------------------------------------------


def test_rdf_meta_expands_prefixes_in_a_users_own_predicates(kitchen: PrologConsole, tmp_path: Path) -> None:
    text = (
        ":- module(my_rules, [kind_of/2, is_handle/1]).\n"
        ":- use_module(library('semweb/rdfs')).\n"
        ":- rdf_meta kind_of(r, r), is_handle(r).\n"
        "kind_of(Thing, Class) :- atom(Class), rdfs_individual_of(Thing, Class).\n"
        "is_handle(Thing) :- kind_of(Thing, knowrob:'Handle').\n"
    )
    assert load(kitchen, tmp_path, text) == 0
    assert len(values(kitchen, "is_handle(X)")) == 33


def test_libraries_of_knowrob_are_there(kitchen: PrologConsole, tmp_path: Path) -> None:
    names = "semweb/owl semweb/owl_parser knowrob/computable knowrob/owl knowrob/rdfs thea/owl_parser rdfs_computable"
    uses = "".join(f":- use_module(library('{name}')).\n" for name in names.split())
    text = uses + "door(X) :- owl_individual_of(X, knowrob:'Door'), rdf_triple(knowrob:child, X, _).\n"
    assert load(kitchen, tmp_path, text) == 0
    assert f"{KITCHEN}fridge_door" in values(kitchen, "door(X)")


@pytest.mark.parametrize(
    ("library", "reason"),
    [
        ("jpl", "it needs Java"),
        ("knowrob/mongo", "it needs a MongoDB server"),
        ("tf_prolog", "it needs ROS nodes"),
        ("knowrob_elsewhere", "no package beside this file contains it"),
    ],
)
def test_a_missing_library_is_a_warning_with_the_reason(
    library: str, reason: str, console: PrologConsole, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    text = f":- use_module(library('{library}')).\n:- jpl_call_something(1).\nrest_is_loaded(yes).\n"
    assert load(console, tmp_path, text) == 0
    assert reason in capfd.readouterr().err.replace("\nWarning:    ", " ")
    assert values(console, "rest_is_loaded(X)") == ["yes"]
    with pytest.raises(PrologGoalError, match="Unknown procedure"):
        console.holds("jpl_call_something(1)")


def test_a_misspelled_library_of_a_plain_file_stays_an_error(kitchen: PrologConsole, tmp_path: Path) -> None:
    assert load(kitchen, tmp_path, ":- use_module(library(lsits)).\n", "rules.pl") == 1


def test_a_directive_that_fails_for_another_reason_stays_an_error(kitchen: PrologConsole, tmp_path: Path) -> None:
    assert load(kitchen, tmp_path, ":- misspelled_goal(1).\n") == 1
    assert load(kitchen, tmp_path, ":- use_module(library(jpl)).\n:- atom_length(X, _).\n") == 1


MONGO = ":- use_module(library('knowrob/mongo')).\n"
LISTED = ":- use_module(library('knowrob/mongo'), [mng_go/1]).\n"
OBJECT = ":- module(machine, [machine_go/1]).\n:- use_foreign_library('libmachine.so').\n"


@pytest.mark.parametrize(
    ("text", "errors", "message"),
    [
        (MONGO + ":- other_go(1).", 0, "one of library('knowrob/mongo')"),
        (LISTED + ":- mng_go(1).", 0, "one of library('knowrob/mongo')"),
        (LISTED + ":- other_go(1).", 1, "Unknown procedure: other_go/1"),
        (MONGO + ":- rdf_has(1).", 1, "Unknown procedure: rdf_has/1"),
        (MONGO + ":- register_ros_pakage(knowrob).", 1, "Unknown procedure: register_ros_pakage/1"),
        (MONGO + "own(1).\n:- own.", 1, "Unknown procedure: own/0"),
        (MONGO + ":- forall(mebmer(_, [1]), true).", 1, "Unknown procedure: mebmer/2"),
        (MONGO + ":- atom_lenght(abc, _).", 1, "Unknown procedure: atom_lenght/2"),
        (":- module(starts, []).\n" + MONGO + "start :- mng_start(x).\n:- start.", 0, "starts:mng_start/1 cannot"),
        (MONGO + ":- initialization(mng_begin(2)).", 0, "mng_begin/1 cannot be called"),
        (":- use_module(library(jpl)).\n:- misspelled_goal(1).", 1, "Unknown procedure: misspelled_goal/1"),
        (":- register_ros_package(nowhere_pkg_2).\n:- from_it(1).", 0, "one of the package nowhere_pkg_2"),
        (OBJECT + ":- machine_go(1).", 0, "one of a library of machine code"),
        (":- module(no_machine, [machine_go/1]).", 0, "machine_go/1 cannot be called: its module exports it"),
    ],
)
def test_an_unknown_procedure_is_a_warning_only_if_what_is_missing_may_provide_it(
    text: str, errors: int, message: str, kitchen: PrologConsole, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert load(kitchen, tmp_path, text + "\n") == errors
    assert message in capfd.readouterr().err.replace("\nWarning:    ", " ")


def test_packages_beside_the_file_are_registered_and_loaded_once(console: PrologConsole, tmp_path: Path) -> None:
    load(console, tmp_path, ":- assertz(initialized(other)).\n", "other_pkg/prolog/init.pl")
    load(
        console,
        tmp_path,
        ":- module(other_rules, [from_other/1]).\nfrom_other(1).\n",
        "other_pkg/prolog/other_rules.pl",
    )
    console.holds("retractall(initialized(_))")
    text = (
        ":- register_ros_package(other_pkg).\n:- register_ros_package(other_pkg, _).\n"
        ":- use_module(library('other_rules')).\nmine(X) :- from_other(X).\n"
    )
    assert load(console, tmp_path, text) == 0
    assert values(console, "mine(X)") == [1]
    assert console.holds("rospack_package_path(other_pkg, _) ; true")


def test_folders_with_any_names_may_lie_beside_a_package(kitchen: PrologConsole, tmp_path: Path) -> None:
    for name in (b"\xff\xfe", b"a\nb", b"*", b"[", b"{b", "\N{GRINNING FACE}".encode(), b".hidden"):
        (Path(os.fsdecode(os.fsencode(tmp_path) + b"/" + name)) / "strange" / "prolog").mkdir(parents=True)
        (Path(os.fsdecode(os.fsencode(tmp_path) + b"/stack/" + name)) / "prolog").mkdir(parents=True)
    for package in ("stack/beside", "[stack]/further", "{b/last"):
        name = package.rpartition("/")[2]
        rules = f":- module({name}_rules, [{name}/1]).\n{name}(1).\n"
        load(kitchen, tmp_path, rules, f"{package}/prolog/{name}_rules.pl")
    uses = "".join(f":- use_module(library({name}_rules)).\n" for name in ("beside", "further", "last"))
    text = uses + "all(1) :- beside(1), further(1), last(1).\n"
    assert load(kitchen, tmp_path, text, "stack/pkg/prolog/rules.pl") == 0
    assert kitchen.holds("all(1)")


def test_a_package_that_is_not_found_is_a_warning(
    console: PrologConsole, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert load(console, tmp_path, ":- register_ros_package(nowhere_pkg).\n") == 0
    assert "ROS package nowhere_pkg is neither beside this file" in capfd.readouterr().err.replace(
        "\nWarning:    ", " "
    )


def test_an_ontology_that_cannot_be_read_while_loading_is_a_warning(console: PrologConsole, tmp_path: Path) -> None:
    assert load(console, tmp_path, ":- owl_parser:owl_parse('package://nowhere/owl/a.owl').\n") == 0
    with pytest.raises(PrologGoalError):
        console.holds("owl_parse('package://nowhere/owl/a.owl')")


def test_goals_of_the_module_rdf_db_change_the_store(console: PrologConsole, tmp_path: Path) -> None:
    text = (
        ":- rdf_db:rdf_register_ns(own, 'http://own.org/o#', [keep(true)]).\n"
        ":- rdf_db:rdf_register_ns(knowrob, 'http://ias.cs.tum.edu/kb/knowrob.owl#', [keep(true)]).\n"
        ":- rdf_db:rdf_assert(own:a, knowrob:child, own:b).\n"
    )
    assert load(console, tmp_path, text) == 0
    rows = console.solutions("rdf('http://own.org/o#a', P, V, G)")
    assert rows == [{"P": f"{KNOWROB}child", "V": "http://own.org/o#b", "G": "user"}]


def test_rules_of_knowrob_2_load(kitchen: PrologConsole, tmp_path: Path) -> None:
    text = (
        ":- module(model_rules, [is_door/1]).\n:- use_module(library('model/OWL')).\n"
        "is_door(Entity) ?+> rdfs_individual_of(Entity, knowrob:'Door').\n"
    )
    assert load(kitchen, tmp_path, text, "src/model/rules.pl") == 0
    assert f"{KITCHEN}fridge_door" in values(kitchen, "is_door(X)")


def test_modules_of_knowrob_2_export_modes_properties_and_interfaces(console: PrologConsole, tmp_path: Path) -> None:
    interface = ":- interface(finder, [ found/1,  % ?Entity\n found_in(r, r) ]).\n/** <interface> */\n"
    load(console, tmp_path, interface, "pkg2/src/finder.pl")
    (tmp_path / "pkg2" / "package.xml").write_text("<package/>", encoding="utf-8")
    text = (
        ":- module(k2_rules, [ is_k2_door(r), next_door(r, r) -> knowrob:touches,\n"
        "    implements('./finder.pl'), plain/0 ]).\n"
        ":- use_module(library('semweb/rdf_db'), [ rdf_meta/1, rdf_split_url/3 ]).\n"
        ":- rdf_meta(inner(r)), rdf_db:rdf_register_ns(k2, 'http://k2.org/#', [keep(true)]).\n"
        "is_k2_door(Door), [table(?)] ?+> inner(knowrob:'Door'), has_type(Door, knowrob:'Door').\n"
        "next_door(A, B) ?> pragma(A = A), { B = done, ! }.\n"
        "next_door(_, never) ?> { true }.\n"
        "found(X) :- inner(X).\nfound_in(X, Y) :- X = Y.\nplain :- found_in(knowrob:'Door', X), atom(X), found(X).\n"
        "inner('http://knowrob.org/kb/knowrob.owl#Door').\n"
    )
    assert load(console, tmp_path, text, "pkg2/src/rules.pl") == 0
    assert f"{KITCHEN}fridge_door" in values(console, "is_k2_door(X)")
    assert values(console, "next_door(kitchen:oven, X)") == ["done"]  # the cut is that of the rule
    assert values(console, "rdf_has(kitchen:oven, knowrob:touches, X)") == ["done"]
    assert values(console, "plain, found(X)") == [f"{KNOWROB}Door"]
    assert values(console, "found_in(X, y)") == ["y"]
    assert values(console, "mindstage_user_files:told_by(is_k2_door(_), inner(X))") == []
    assert console.holds("mindstage_user_files:told_by(is_k2_door(_), (inner(_), has_type(_, _)))")


def test_tests_of_knowrob_2_run_with_their_ontology(console: PrologConsole, tmp_path: Path) -> None:
    (tmp_path / "pkg3" / "owl").mkdir(parents=True)
    (tmp_path / "pkg3" / "package.xml").write_text("<package/>", encoding="utf-8")
    ontology = "<http://t3.org/t.owl#lea> a <http://t3.org/t.owl#Adult> .\n"
    (tmp_path / "pkg3" / "owl" / "t.ttl").write_text(ontology, encoding="utf-8")
    text = (
        f":- begin_rdf_tests(k2_tests, '{tmp_path}/pkg3/owl/t.ttl', [namespace('http://t3.org/t.owl#')]).\n"
        "test('lea is an adult') :- once(has_type(test:lea, test:'Adult')).\n"
        ":- end_rdf_tests(k2_tests).\n"
    )
    assert load(console, tmp_path, text, "pkg3/src/tested.pl") == 0
    assert console.holds("run_tests(k2_tests)")
    wrong = text.replace("k2_tests", "k2_wrong").replace("test:'Adult'", "test:'Child'")
    assert load(console, tmp_path, wrong, "pkg3/src/wrong.pl") == 0
    assert not console.holds("run_tests(k2_wrong)")


def test_what_belongs_to_the_surroundings_of_knowrob_2_is_accepted(
    console: PrologConsole, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "pkg4").mkdir()
    (tmp_path / "pkg4" / "package.xml").write_text("<package/>", encoding="utf-8")
    text = (
        ":- ros_package_iri(knowrob, 'http://knowrob.org/kb').\n:- log_warning(kb(started)).\n"
        ":- use_directory('lang').\n:- tripledb_load('http://nowhere.org/a.owl', [namespace(io)]).\n"
    )
    assert load(console, tmp_path, text, "pkg4/src/__init__.pl") == 0
    messages = capfd.readouterr().err
    assert "kb(started)" in messages
    assert "src/lang/__init__.pl does not exist" in messages


def test_unknown_prefixes_are_expanded_when_the_goal_runs(console: PrologConsole, tmp_path: Path) -> None:
    text = "later_known(X) :- rdf_has(X, later:likes, _).\n"
    assert load(console, tmp_path, text) == 0
    console.holds(
        "rdf_register_prefix(later, 'http://later.org/#'), rdf_assert(kitchen:fridge, later:likes, kitchen:oven)"
    )
    assert values(console, "later_known(X)") == [f"{KITCHEN}fridge"]


# -- predicates --------------------------------------------------------------------------------------------------------


@each_case(
    ("goal", "expected"),
    [
        ("rdf_split_url(N, X, knowrob:'Door')", "Door"),
        ("rdf_split_url('http://a/', b, X)", "http://a/b"),
        ("remove_namespace(kitchen:fridge, X)", "fridge"),
        ("strip_literal_type(literal(type(xsd:float, '1.5')), X)", "1.5"),
        ("strip_literal_type(knowrob, X)", "knowrob"),
        ("rdf_equal(X, a)", "a"),
        ("rdfs_subclass_of(knowrob:'Door', owl:'Thing'), X = yes", "yes"),
        ("rdfs_individual_of(kitchen:fridge, owl:'Thing'), X = yes", "yes"),
    ],
)
def test_terms_have_the_forms_of_knowrob(goal: str, expected: str, kitchen: PrologConsole) -> None:
    assert values(kitchen, goal) == [expected]


def test_restrictions_are_terms(kitchen: PrologConsole) -> None:
    contains = "knowrob:'typePrimaryFunction-containerFor'"
    filler = f"restriction('{KNOWROB}typePrimaryFunction-containerFor', some_values_from(union_of(X)))"
    assert values(kitchen, f"owl_restriction_on(knowrob:'Dishwasher', {filler})") == [
        [f"{KNOWROB}FoodUtensil", f"{KNOWROB}FoodVessel"]
    ]
    for predicate in ("class_properties", "class_properties_some"):
        assert len(values(kitchen, f"{predicate}(knowrob:'Dishwasher', {contains}, union_of(X))")) == 1
    assert not kitchen.holds(f"class_properties_all(knowrob:'Dishwasher', {contains}, _)")
    assert f"{KNOWROB}CardboardBox-Eggs" in values(kitchen, f"class_properties_some(X, {contains}, _)")


def test_descriptions_are_satisfied_by_individuals(kitchen: PrologConsole) -> None:
    both = set(values(kitchen, "owl_satisfies(union_of([knowrob:'Handle', knowrob:'Door']), X)"))
    parts = (values(kitchen, f"rdfs_individual_of(X, knowrob:'{name}')") for name in ("Handle", "Door"))
    assert both == {each for part in parts for each in part}
    fridge = f"'{KITCHEN}fridge'"
    assert kitchen.holds(f"owl_satisfies(complement_of(knowrob:'Handle'), {fridge})")
    some = "restriction('http://knowrob.org/kb/knowrob.owl#child', some_values_from(knowrob:'Handle'))"
    assert kitchen.holds(f"owl_satisfies({some}, kitchen:fridge_door)")
    assert not kitchen.holds(f"owl_satisfies({some}, kitchen:fridge_door_handle)")


def test_new_individuals_have_unused_names(console: PrologConsole) -> None:
    goal = "rdf_instance_from_class(knowrob:'Drawer', X), rdfs_individual_of(X, knowrob:'Drawer')"
    first, second = values(console, goal), values(console, goal)
    assert first[0] != second[0]
    assert first[0].startswith(f"{KNOWROB}Drawer_")


def test_transitive_properties_are_followed_by_owl_has(console: PrologConsole) -> None:
    start = "http://example.org/e#"
    console.holds(f"rdf_assert('{start}in', rdf:type, owl:'TransitiveProperty')")
    console.holds(f"rdf_assert('{start}in', rdfs:subPropertyOf, '{start}near')")
    console.holds(f"rdf_assert('{start}a', '{start}in', '{start}b'), rdf_assert('{start}b', '{start}in', '{start}c')")
    for property in ("in", "near"):
        assert values(console, f"owl_has('{start}a', '{start}{property}', X)") == [f"{start}b", f"{start}c"]
        assert len(console.solutions(f"owl_has(_, '{start}{property}', _)")) == 3
    assert values(console, f"rdf_has('{start}a', '{start}near', X)") == [f"{start}b"]
    assert values(console, f"rdf_reachable('{start}a', '{start}in', X, 1, _)") == [f"{start}a", f"{start}b"]
    assert set(values(console, f"rdfs_subproperty_of(X, '{start}near')")) == {f"{start}in", f"{start}near"}


def test_lists_can_be_asserted_and_read(console: PrologConsole) -> None:
    assert values(console, "rdfs_assert_list([kitchen:oven, kitchen:fridge], L), rdfs_list_to_prolog_list(L, X)") == [
        [f"{KITCHEN}oven", f"{KITCHEN}fridge"]
    ]
