"""Questions as services: all by one service, and each by its own."""

from __future__ import annotations

import json

import pytest

from mindstage.bridge import LocalNode
from mindstage.errors import ServiceCallError
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.queries import answers_to_builtins, list_questions
from mindstage.simulation import Simulation
from tests.ros.ros_messages import Ask, Call, pose_message


def test_every_question_has_a_service_with_the_answers_of_the_cli(
    call: Call, simulation: Simulation, local_node: LocalNode
) -> None:
    offered = {each.name for each in local_node.graph_info().services}
    for question in list_questions():
        assert f"/mindstage/{question.name}" in offered
        if question.uses_current_state:
            continue  # tested with the simulation, below
        expected = json.loads(json.dumps(answers_to_builtins(simulation.knowledge, simulation.ask(question))))
        reply = call(f"/mindstage/{question.name}")
        assert reply["success"], question.name
        assert json.loads(reply["answers"]) == expected
        assert call("/mindstage/ask", question=question.name) == reply


def test_arguments_are_given_by_name(call: Call, ask: Ask, knowledge: KnowledgeBase) -> None:
    answers = ask("storage_place", item="CowsMilk")
    assert answers["args"]["item"].endswith("#CowsMilk")
    assert answers["answers"][0]["id"] == "Refrigerator"
    reply = call("/mindstage/ask", question="storage-place", args='{"item": "CowsMilk"}')
    assert json.loads(reply["answers"]) == answers


def test_a_question_without_an_answer_returns_what_is_missing(ask: Ask) -> None:
    answers = ask("storage_place", item="Drawer")
    assert not answers["answers"]
    assert answers["missing"]


def test_questions_are_about_the_current_state(call: Call, ask: Ask) -> None:
    def under_the_mug() -> set[str]:
        answers = ask("where_is", thing="Mug", relation="on")["answers"]
        return {row["other"].rpartition("#")[2] for row in answers}

    assert under_the_mug() == {"Cupboard"}
    call("set_model_pose", id="Mug", pose=pose_message(0.0, -2.0, 0.05))
    assert under_the_mug() == {"Floor"}


@pytest.mark.parametrize(
    ("service", "args", "text"),
    [
        ("/mindstage/ask", {"question": "storage_plase"}, "storage_place"),
        ("/mindstage/ask", {"question": "storage_place", "args": "[]"}, "send an object in a string"),
        ("/mindstage/ask", {"question": "storage_place", "args": "{"}, "send an object in a string"),
        (
            "/mindstage/ask",
            {"question": "storage_place", "args": '{"question": 1}'},
            "the argument names question and self are reserved",
        ),
        ("/mindstage/storage_place", {"args": '{"itm": "Milk"}'}, "it has no argument 'itm'"),
        ("/mindstage/storage_place", {"args": '{"item": "NothingAtAll"}'}, "NothingAtAll"),
        ("/mindstage/storage_place", {"question": "handle_of"}, "this service is for storage_place"),
    ],
)
def test_invalid_questions_are_errors(call: Call, service: str, args: dict[str, str], text: str) -> None:
    with pytest.raises(ServiceCallError) as failure:
        call(service, **args)
    assert text in str(failure.value)


# -- queries of the shell ----------------------------------------------------------------------------------------------


def test_the_query_service_answers_sparql_within_its_limits(call: Call) -> None:
    query = "SELECT ?x { ?x rdfs:subClassOf knowrob:Door }"
    for service in ("/mindstage/query", "mindstage/query"):
        reply = call(service, language="sparql", query=query, timeout_s=1e9)
        assert json.loads(reply["answers"])["columns"] == ["x"]


@pytest.mark.parametrize(
    ("args", "text"),
    [
        (
            {"language": "cypher", "query": "x"},
            "'cypher' is no language of queries; the languages are question,",
        ),
        ({"language": "sparql", "query": "SELECT" * 4000}, "it has 24,000 characters, and a query at most 20,000"),
        ({"language": "sparql", "query": "SELECT {"}, "the query cannot be answered"),
        ({"language": "sparql", "query": "SELECT * { SERVICE <http://x.example/> { ?s ?p ?o } }"}, "SERVICE"),
        ({"language": "question", "query": "handle_of", "highlight": "plaid"}, "no color 'plaid'"),
        ({"language": "question", "query": "handle_of", "args": '{"question": 1}'}, "are reserved"),
    ],
)
def test_invalid_queries_are_errors(call: Call, args: dict[str, str], text: str) -> None:
    with pytest.raises(ServiceCallError) as failure:
        call("/mindstage/query", **args)
    assert text in str(failure.value)
