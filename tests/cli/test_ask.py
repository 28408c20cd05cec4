"""The verbs `ask`, `questions` and `sparql`."""

from __future__ import annotations

from pathlib import Path

import pytest

from mindstage.knowledge.queries import list_questions
from tests.cli.runner import Run, WriteMap, json_output

KITCHEN = ("--map", "bundled:kitchen")


def test_the_fields_of_the_json_output(run: Run) -> None:
    result = run("ask", "storage_place_in_environment", "CowsMilk", *KITCHEN, "--json", "--why")
    assert result.exit_code == 0
    answer = json_output(result)
    assert list(answer) == [
        *("question", "args", "answers", "missing", "notes", "sentence", "truth", "assumptions", "findings")
    ]
    (place,) = answer["answers"]
    assert place["id"] == "fridge"
    assert place["iri"].endswith("#fridge")
    assert place["class"].startswith("http://")
    assert place["why"][0].startswith("CowsMilk is a ")


def test_the_default_output_is_a_table_with_short_names(run: Run) -> None:
    result = run("ask", "storage-place", "CowsMilk")
    assert result.exit_code == 0
    assert "Refrigerator" in result.stdout
    assert "http://" not in result.stdout
    assert "why" not in result.stdout
    assert "every Refrigerator" in run("ask", "storage-place", "CowsMilk", "--why").stdout


def test_why_prints_an_explanation_below_each_answer(run: Run) -> None:
    shown = run("ask", "storage_place", "Bread", "--why").stdout
    lines = [line.split(maxsplit=1) for line in shown.splitlines()]
    at = lines.index(["place", "Refrigerator"])
    assert lines.index(["place", "Breadbasket"]) < at
    why = next(number for number, line in enumerate(lines) if number > at and line[0] == "why")
    assert lines[why][1].startswith("Bread is a ")
    assert " ".join(lines[why + 1]).startswith("every Refrigerator: ")


def test_an_answer_too_wide_for_a_table_is_printed_as_records(run: Run) -> None:
    shown = run("ask", "what_is", "fridge_door_hinge", *KITCHEN).stdout
    fields = dict(line.split(maxsplit=1) for line in shown.splitlines())
    assert fields["joint"].startswith("fridge to fridge_door, swing1 limited ")
    assert fields["classes"].strip() == "Constraint"
    assert "size" not in fields, "an unknown field is omitted"


def test_individuals_are_printed_with_their_class(run: Run) -> None:
    shown = run("ask", "handle_of", "fridge_door", *KITCHEN).stdout
    assert "class of handle" in shown
    assert "BarHandle" in shown
    assert "class of" not in run("ask", "individual_of_class", "Cup", *KITCHEN).stdout


@pytest.mark.parametrize(
    "args", [("_", "fridge_door_handle"), ("handle=fridge_door_handle",), ("fridge_door",), ("_", "_", "kitchen")]
)
def test_arguments_are_positional_or_named(args: tuple[str, ...], run: Run) -> None:
    answers = json_output(run("ask", "handle_of", *args, *KITCHEN, "--json"))["answers"]
    assert any(answer["handle"].endswith("#fridge_door_handle") for answer in answers)


def test_without_an_answer_the_missing_knowledge_is_printed(run: Run) -> None:
    result = run("ask", "storage_place", "Robot", "--json")
    assert result.exit_code == 1
    (missing,) = json_output(result)["missing"]
    assert list(missing) == ["class", "property", "why", "claims"]
    assert missing["why"].startswith("Robot has no storage place")
    assert "missing: Robot has no storage place" in run("ask", "storage_place", "Robot").stdout


def test_a_question_without_data_has_no_answer(run: Run) -> None:
    result = run("ask", "articulated_parts")
    assert result.exit_code == 1
    assert result.stdout == "no answer\n"


def test_maps_and_ontologies_are_options(run: Run, write_map: WriteMap) -> None:
    first, second = write_map("a.owl", maps=["A"], mugs={"X": "0 0 0"}), write_map("b.owl", maps=["B"], mugs={})
    answers = json_output(run("ask", "maps", "--map", first, "--map", second, "--json"))["answers"]
    assert [(answer["id"], answer["individuals"]) for answer in answers] == [("A", 1), ("B", 0)]
    assert run("ask", "storage_place", "CowsMilk", "--no-bundled-ontology").exit_code == 2


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("storage_plac",), "no question 'storage_plac'; near: 'storage_place'"),
        (("storage_place", "CowsMilc"), "no class 'CowsMilc' is known; near: 'CowsMilk'"),
        (("storage_place", "a", "b", "c"), "'c' is one argument too many; it takes item, place"),
        (("storage_place", "Bread", "item=Cake"), "item is given twice"),
        (("storage_place", "thing=Bread"), "it has no argument 'thing'; there is item, place"),
        (("identical_maps", "tolerance=much"), "identical_maps, tolerance: 'much' is no number"),
        (("where_is", "relation=near"), "where_is, relation: 'near' is no relation; there is on, inside, above"),
        (("maps", "--map", "nowhere.owl"), "nowhere.owl"),
    ],
)
def test_invalid_questions_exit_2_with_alternatives(args: tuple[str, ...], message: str, run: Run) -> None:
    result = run("ask", *args)
    assert result.exit_code == 2
    assert message in result.stderr
    assert message in json_output(run("ask", *args, "--json"))["error"]["message"]


def test_the_questions_are_listed(run: Run) -> None:
    table = run("questions")
    assert table.exit_code == 0
    listed = json_output(run("questions", "--json"))
    assert [each["question"] for each in listed] == [question.name for question in list_questions()]
    assert all(each["question"] in table.stdout for each in listed)
    (storage,) = [each for each in listed if each["question"] == "storage_place"]
    assert storage["arguments"] == [{"name": "item", "kind": "class"}, {"name": "place", "kind": "class"}]


def test_a_query_gives_a_table_or_json(run: Run) -> None:
    query = "SELECT ?x ?none WHERE { knowrob:Bread rdfs:subClassOf ?x }"
    assert "knowrob.owl#Baked" in run("sparql", query).stdout
    answer = json_output(run("sparql", query, "--json"))
    assert answer["columns"] == ["x", "none"]
    assert {"x": {"kind": "iri", "value": "http://knowrob.org/kb/knowrob.owl#Baked"}} in answer["rows"]


@pytest.mark.parametrize(("cls", "printed", "code"), [("Perishable", "yes\n", 0), ("Tool", "no\n", 1)])
def test_the_answer_of_an_ask_query_is_the_exit_code(cls: str, printed: str, code: int, run: Run) -> None:
    result = run("sparql", f"ASK {{ knowrob:Bread rdfs:subClassOf+ knowrob:{cls} }}")
    assert (result.stdout, result.exit_code) == (printed, code)


def test_queries_include_the_maps(run: Run, shared_data: Path) -> None:
    query = "SELECT (COUNT(?x) AS ?n) { ?x knowrob:describedInMap ?map }"
    answer = json_output(run("sparql", query, "--map", shared_data / "maps" / "iai-kitchen-original.owl", "--json"))
    assert answer["rows"] == [
        {"n": {"kind": "literal", "value": "136", "datatype": answer["rows"][0]["n"]["datatype"]}}
    ]


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("SELEC",), "the query cannot be answered: error at 1:"),
        (("SELECT (COUNT(*) AS ?n) { ?a ?b ?c . ?d ?e ?f }", "--timeout", "0.05"), "did not end within 0.05 s"),
        (("ASK {}", "--timeout", "nan"), "nan is not a finite number"),
    ],
)
def test_invalid_queries_exit_2(args: tuple[str, ...], message: str, run: Run) -> None:
    result = run("sparql", *args)
    assert result.exit_code == 2
    assert message in result.stderr


# -- sentences ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("words", [["where is the milk?"], ["where", "is", "milk"], ["Where", "is", "the", "milk"]])
def test_a_sentence_shows_what_was_understood_and_its_answers(run: Run, words: list[str]) -> None:
    result = run("ask", *words, *KITCHEN)
    assert result.exit_code == 0
    understood, answer = result.stdout.splitlines()
    assert understood in {"understood: where is the milk?", "understood: where is milk?"}
    assert answer == "milk_carton_1 and milk_carton_2 are in fridge."


@pytest.mark.parametrize(
    ("sentence", "answer", "code"),
    [
        ("are all drawers closed?", "Yes: all 16 drawers are closed.", 0),
        ("is the milk on the table?", "No: milk_carton_1 and milk_carton_2 are not on the table.", 1),
        ("is the window open?", "Unknown: nothing states whether window is open.", 3),
        ("how many plates are there?", "7 plates: 4 Plate, 3 SmallPlate.", 0),
    ],
)
def test_a_sentence_is_answered_by_a_sentence_and_its_exit_code(
    run: Run, sentence: str, answer: str, code: int
) -> None:
    result = run("ask", sentence, *KITCHEN)
    assert (result.stdout.splitlines()[-1], result.exit_code) == (answer, code)


def test_the_answers_to_a_sentence_are_printed_as_rows_if_wanted(run: Run) -> None:
    assert "milk_carton_2" in run("ask", "is any milk on the table?", *KITCHEN, "--rows").stdout.splitlines()[-2]


def test_a_command_is_pointed_to_the_verb_that_does_it(run: Run) -> None:
    result = run("ask", "open the fridge", *KITCHEN)
    assert result.exit_code == 2
    assert "mindstage do 'open the fridge' MAP does it" in result.stderr


def test_what_can_be_asked_is_listed(run: Run) -> None:
    assert run("ask", "what can I ask?").stdout == run("questions").stdout


def test_a_sentence_in_json_has_the_fields_of_its_question(run: Run) -> None:
    sentence = json_output(run("ask", "what is similar to the kettle?", *KITCHEN, "--json"))
    named = json_output(run("ask", "similar_to", "water_kettle_1", *KITCHEN, "--json"))
    assert sentence["notes"][0] == "understood: similar_to thing=water_kettle_1"
    assert sentence | {"notes": []} == named | {"notes": []}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["where is the milc?"], "unknown: 'milc'; near: 'Milk'"),
        (["wher", "is", "milk"], "unknown: 'wher'; near: 'where'"),
        (["describe the left drawer"], "has 5 readings: what_is individual=drawer_dresser_left | "),
        (["was the oven open?"], "it is about the past"),
        (["where is " + "x" * 10_000], "it has 10,009 characters, more than 1,000"),
        (["xyzzy"], "no question 'xyzzy'; `mindstage questions` lists all of them"),
    ],
)
def test_what_is_not_understood_is_named_in_a_short_message(run: Run, words: list[str], message: str) -> None:
    result = run("ask", *words, *KITCHEN)
    assert result.exit_code == 2
    assert message in result.stderr
    assert len(result.stderr) < 700


def test_a_class_as_an_argument_names_its_individuals(run: Run) -> None:
    result = run("ask", "where_is", "CowsMilk", "inside", *KITCHEN)
    assert result.exit_code == 0
    assert "'CowsMilk' is the class knowrob:CowsMilk with 2 individuals" in result.stdout
    assert "milk_carton_2" in result.stdout


def test_the_sentences_of_each_question_are_listed(run: Run) -> None:
    listed = json_output(run("questions", "--json"))
    by_grammar = {"larger_than", "how_many", "is_between", "in_words", "distance"}
    assert {each["question"] for each in listed if not each["sentences"]} <= by_grammar
