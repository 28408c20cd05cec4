"""Every declared question is a predicate, with the semantics of Prolog."""

from __future__ import annotations

from typing import Any

import pytest

from mindstage.errors import PrologGoalError
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.queries import Question, list_questions
from mindstage.prolog import PrologConsole
from tests.cases import each_case

KITCHEN = "http://mindstage.org/maps/kitchen.owl#"
KNOWROB = "http://knowrob.org/kb/knowrob.owl#"


def values(console: PrologConsole, goal: str, variable: str = "X") -> list[Any]:
    return [solution[variable] for solution in console.solutions(goal, limit=100_000)]


def variables(number: int) -> str:
    return ", ".join(f"V{at}" for at in range(number))


@each_case("question", list_questions(), ids=lambda question: question.name)
def test_a_question_answers_as_many_rows_as_it_does_in_python(
    question: Question[Any], kitchen: PrologConsole, kitchen_knowledge: KnowledgeBase
) -> None:
    extra = [argument for argument in question.arguments if argument.name not in question.columns]
    goal = f"{question.name}({variables(len(question.columns) + len(extra))})"
    found = kitchen.solutions(goal, limit=100_000, timeout_s=60)
    assert len(found) == len(kitchen_knowledge.ask(question))


def test_the_arguments_alone_are_a_predicate_too_with_the_map_first(kitchen: PrologConsole) -> None:
    assert values(kitchen, "handle_of(Map, fridge_door, X)") == [f"{KITCHEN}fridge_door_handle"]
    assert values(kitchen, "individual_of_class(X, 'Handle', fridge_door_handle)") == [f"{KITCHEN}kitchen"]
    assert values(kitchen, "storage_place('CowsMilk', X)") == [f"{KNOWROB}Refrigerator"]


@each_case("map", ["_", "kitchen:kitchen"])
@each_case("thing", ["_", "kitchen:fridge_door"])
@each_case("handle", ["_", "kitchen:fridge_door_handle"])
def test_any_argument_may_be_bound_or_free(
    map: str, thing: str, handle: str, kitchen: PrologConsole, kitchen_knowledge: KnowledgeBase
) -> None:
    given = {"map": map, "individual": thing, "handle": handle}
    bound = {name: value.partition(":")[2] for name, value in given.items() if value != "_"}
    answers = kitchen_knowledge.ask("handle_of", **bound)
    assert len(answers) >= 1
    assert len(kitchen.solutions(f"handle_of({map}, {thing}, {handle})")) == len(answers)


@pytest.mark.parametrize("goal", ["handle_of(_, milk_carton_1, _)", "handle_of(_, X, X)", "subclass_of('Box', 'Box')"])
def test_a_goal_without_answers_fails(goal: str, kitchen: PrologConsole) -> None:
    assert kitchen.solutions(goal) == []


def test_columns_that_are_no_arguments_may_be_bound(kitchen: PrologConsole) -> None:
    assert kitchen.holds("storage_place('Bread', knowrob:'Refrigerator', knowrob:'Perishable', 3)")
    assert not kitchen.holds("storage_place('Bread', knowrob:'Refrigerator', _, 0)")
    assert values(kitchen, "storage_place('Bread', X, _, _)") == [
        "http://mindstage.org/ontology#Breadbasket",
        f"{KNOWROB}Refrigerator",
    ]


@each_case(
    "goal",
    [
        "handle_of(M, D, _), individual_of_class(M, 'Door', D), !",
        "findall(X, individual_of_class(_, 'Handle', X), Xs), length(Xs, 33)",
        "\\+ handle_of(_, milk_carton_1, _)",
        "forall(individual_of_class(M, 'BarHandle', X), individual_of_class(M, 'Handle', X))",
        "setof(C, I^M^(member(C, ['Handle', 'Refrigerator', 'Robot']), individual_of_class(M, C, I)), Cs), "
        "Cs == ['Handle', 'Refrigerator']",
        "member(Thing, [milk_carton_1, fridge_door]), handle_of(_, Thing, _)",
        "aggregate_all(count, individual_of_class(_, 'Handle', _), 33)",
        "maplist([Thing]>>once(individual_of_class(_, _, Thing)), [fridge, oven])",
        "catch((handle_of(_, _, X), throw(found(X))), found(_), true)",
        "handle_of(_, fridge_door, _), garbage_collect, garbage_collect_atoms, handle_of(_, fridge_door, _)",
    ],
)
def test_all_of_prolog_works_over_the_answers(goal: str, kitchen: PrologConsole) -> None:
    assert kitchen.holds(goal)


def test_the_last_answer_leaves_no_choice_point(kitchen: PrologConsole) -> None:
    assert kitchen.holds("call_cleanup(handle_of(_, fridge_door, fridge_door_handle), Done = true), Done == true")
    assert values(kitchen, "findall(D, call_cleanup(storage_place('Bread', _), D = true), Ds), last(Ds, X)") == ["true"]


# -- names -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["'CowsMilk'", "knowrob:'CowsMilk'", f"'{KNOWROB}CowsMilk'", '"CowsMilk"'])
def test_names_are_local_names_prefixed_names_or_iris(name: str, kitchen: PrologConsole) -> None:
    assert values(kitchen, f"storage_place({name}, X)") == [f"{KNOWROB}Refrigerator"]


@each_case(
    ("term", "printed"),
    [
        ("knowrob:'Handle'", "knowrob:'Handle'"),
        ("kitchen:fridge_door", "kitchen:fridge_door"),
        ("[rdf:type, f(owl:'Class')]", "[rdf:type,f(owl:'Class')]"),
        ("'http://example.org/other#thing'", "'http://example.org/other#thing'"),
        (f"'{KNOWROB}'", f"'{KNOWROB}'"),
    ],
)
def test_names_are_printed_with_their_prefix(term: str, printed: str, kitchen: PrologConsole) -> None:
    goal = f"mindstage_prefixes:expand_prefixes({term}, Expanded), with_output_to(atom(X), print(Expanded))"
    assert values(kitchen, goal) == [printed]


def test_users_may_add_prefixes(kitchen: PrologConsole) -> None:
    assert kitchen.holds("rdf_register_prefix(my, 'http://my.org/x#'), rdf_global_id(my:a, 'http://my.org/x#a')")
    assert kitchen.holds("rdf_global_id(my:N, 'http://my.org/x#b'), N == b, rdf_current_prefix(my, _)")
    with pytest.raises(PrologGoalError, match="unknown prefix mine; known prefixes: ") as refused:
        kitchen.holds("handle_of(_, mine:thing, _)")
    assert refused.value.error_type == "NameNotFoundError"


def test_an_unknown_name_fails_and_is_warned_about_once(
    kitchen: PrologConsole, capfd: pytest.CaptureFixture[str]
) -> None:
    assert not kitchen.holds("storage_place('CowsMilch', _)")
    assert "no class 'CowsMilch' is known; near: 'CowsMilk'" in capfd.readouterr().err
    assert kitchen.holds("\\+ storage_place('CowsMilch', _)")
    assert capfd.readouterr().err == ""


@each_case(
    ("goal", "kind"),
    [
        ("ask_sentence('describe the left drawer', _)", "AmbiguousSentenceError"),
        ("storage_place(17, _)", "InvalidArgumentError"),
        ("identical_maps(kitchen, kitchen, -1)", "NumberRefusedError"),
        ("why(handle_off(_, _, _))", "QuestionNotFoundError"),
        ("why(maps(_, _, _))", "InvalidArgumentError"),
    ],
)
def test_invalid_questions_are_errors(goal: str, kind: str, kitchen: PrologConsole) -> None:
    with pytest.raises(PrologGoalError) as refused:
        kitchen.solutions(goal)
    assert refused.value.error_type == kind
    assert kitchen.holds(f"catch(({goal}), mindstage_error('{kind}', Sentence), string(Sentence))")


# -- more than answers -------------------------------------------------------------------------------------------------


def test_the_questions_are_listed(kitchen: PrologConsole, capfd: pytest.CaptureFixture[str]) -> None:
    assert kitchen.holds("questions")
    lines = capfd.readouterr().out.splitlines()
    assert len(lines) == len(list_questions())
    assert any(line.startswith("handle_of(Map, Individual, Handle)  ") for line in lines)


def test_why_prints_the_explanation(kitchen: PrologConsole, capfd: pytest.CaptureFixture[str]) -> None:
    assert kitchen.holds("why(handle_of(_, fridge_door, _))")
    assert "    fridge_door child fridge_door_handle\n" in capfd.readouterr().out


def test_missing_facts_are_printed(kitchen: PrologConsole, capfd: pytest.CaptureFixture[str]) -> None:
    assert not kitchen.holds("why(storage_place('Robot', _))")
    assert capfd.readouterr().out.startswith("missing: Robot has no storage place")
    assert values(kitchen, "missing(storage_place('Robot', _), X)")[0].startswith("Robot has no storage place")
    assert not kitchen.holds("missing(storage_place('CowsMilk', _), _)")


def test_structured_answers_are_terms(kitchen: PrologConsole) -> None:
    pose = "pose([X, _, _], [W, _, _, _])"
    goal = f"what_is(_, milk_carton_1, Classes, none, {pose}, [_, _, 0.2], Kg, dynamic, _, none, [], Tags, _, map)"
    (row,) = kitchen.solutions(f"{goal}, memberchk(tag('SemLog', 'Id', milk_carton_1), Tags)")
    assert row["Kg"] == pytest.approx(1.05)
    assert (row["X"], row["W"]) == (pytest.approx(-1.567), pytest.approx(0.707107))
    assert row["Classes"] == ["http://mindstage.org/ontology#MilkCarton"]


def test_a_plain_sentence_is_asked(kitchen: PrologConsole) -> None:
    rows = kitchen.solutions("ask_sentence('what is in the fridge?', Answer), arg(2, Answer, Thing)")
    asked = kitchen.solutions("where_is(_, Thing, inside, kitchen:fridge)")
    assert {row["Thing"] for row in rows} == {row["Thing"] for row in asked}
    assert len(rows) > 1


def test_what_was_understood_is_a_question(kitchen: PrologConsole) -> None:
    query = 'ask_sentence("what is similar to the fridge", _, Question), Question =.. [Name, Map, Thing|_], var(Map)'
    row = kitchen.solutions(query)[0]
    assert (row["Name"], row["Thing"]) == ("similar_to", KITCHEN + "fridge")


def test_a_sentence_that_is_not_understood_is_an_error(kitchen: PrologConsole) -> None:
    with pytest.raises(PrologGoalError, match=r"unknown: 'wher'; near: 'where'"):
        kitchen.solutions("ask_sentence('wher is the milk', Answer)")


def test_a_class_stands_for_all_its_individuals(kitchen: PrologConsole) -> None:
    rows = kitchen.solutions("where_is(_, knowrob:'CowsMilk', inside, Where)")
    assert [row["Where"] for row in rows] == [KITCHEN + "fridge"]
