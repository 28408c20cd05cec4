"""Questions as services: all by one service, and each by its own."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from mindstage.bridge import LocalNode, RosbridgeClient, RosbridgeServer
from mindstage.episodes import Recorder
from mindstage.episodes.episode import Episode
from mindstage.errors import ServiceCallError
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.queries import answers_to_builtins, list_questions
from mindstage.ros import RosInterface
from mindstage.scene import BodyId
from mindstage.scene.edits import SetLabel
from mindstage.simulation import Simulation
from tests.kitchenette import MAP
from tests.knowledge.test_inverse_restrictions import lids_ontology
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


def test_a_restriction_on_an_inverse_is_marked_and_asked_for(
    ask: Ask, knowledge: KnowledgeBase, tmp_path: Path
) -> None:
    knowledge.load(lids_ontology(tmp_path))
    for given, expected in (({}, {"Crate", "Screw"}), ({"inverse": True}, {"Crate"}), ({"inverse": False}, {"Screw"})):
        rows = ask("class_properties", cls="http://example.org/o#Lid", **given)["answers"]
        assert {row["value"].rpartition("#")[2] for row in rows} == expected
        assert all(row["inverse"] is row["value"].endswith("Crate") for row in rows)


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


def test_an_answer_has_the_time_and_the_revision_of_its_state(call: Call, ask: Ask, simulation: Simulation) -> None:
    simulation.step(0.25)
    before = ask("where_is", thing="Mug")["state"]
    assert before == {"time_s": pytest.approx(simulation.state.time_s), "revision": simulation.state.revision}
    simulation.engine.run(lambda engine: engine.apply(SetLabel(BodyId("Mug"), "mine")), edits=True)
    assert ask("where_is", thing="Mug")["state"]["revision"] == before["revision"] + 1


def test_all_questions_of_several_clients_are_answered(
    local_node: LocalNode, simulation: Simulation, ros_interface: RosInterface
) -> None:
    expected = {
        name: json.loads(json.dumps(answers_to_builtins(simulation.knowledge, simulation.ask("pose_of", name))))
        for name in ("Mug", "Cupboard", "Floor")
    }

    def asked_by(client: RosbridgeClient, name: str) -> tuple[str, object]:
        call = {"question": "pose_of", "args": json.dumps({"thing": name})}
        answers = json.loads(client.call_service("/mindstage/ask", call, timeout_s=60.0)["answers"])
        assert answers.pop("state")
        return name, answers

    with (
        RosbridgeServer(local_node, port=0) as server,
        RosbridgeClient(server.url) as many,
        RosbridgeClient(server.url) as one,
        ThreadPoolExecutor(31) as threads,
    ):
        many.wait_connected(60.0)
        one.wait_connected(60.0)
        asked = [threads.submit(asked_by, many, name) for name in list(expected) * 10]
        asked.append(threads.submit(asked_by, one, "Mug"))
        for each in asked:
            name, answers = each.result(60.0)
            assert answers == expected[name]


def test_questions_and_queries_are_about_a_time_of_what_is_recorded(
    call: Call, ask: Ask, simulation: Simulation, tmp_path: Path
) -> None:
    with Recorder(simulation, tmp_path / "run.mcap", rate_hz=100.0):
        simulation.step(0.1)
        call("set_model_pose", id="Mug", pose=pose_message(0.0, -2.0, 0.05))
        simulation.step(0.1)
        for at, place in ((0.05, "Cupboard"), (0.2, "Floor")):
            answers = ask("where_is", thing="Mug", relation="on", at=at)["answers"]
            assert [row["other"].rpartition("#")[2] for row in answers] == [place]
    with pytest.raises(ServiceCallError, match="there is no episode"):
        ask("where_is", thing="Mug", at=0.05)
    with Episode(tmp_path / "run.mcap") as episode:
        simulation.knowledge.add_episode(episode)
        query = f"SELECT ?on FROM <urn:mindstage:present> {{ <{MAP}Mug> knowrob:on-Physical ?on }}"
        fields = {"language": "sparql", "query": query, "args": '{"at": 0.05}'}
        rows = json.loads(call("/mindstage/query", **fields)["answers"])["rows"]
        assert [row[0]["value"] for row in rows] == [MAP + "Cupboard"]
        with pytest.raises(ServiceCallError, match="has no argument 'when'"):
            call("/mindstage/query", **(fields | {"args": '{"when": 1}'}))


@pytest.mark.parametrize(
    ("service", "args", "text"),
    [
        ("/mindstage/ask", {"question": "storage_plase"}, "storage_place"),
        ("/mindstage/ask", {"question": "storage_place", "args": "[]"}, "send an object in a string"),
        ("/mindstage/ask", {"question": "storage_place", "args": "{"}, "send an object in a string"),
        ("/mindstage/ask", {"question": "storage_place", "args": '{"question": 1}'}, "it has no argument 'question'"),
        ("/mindstage/ask", {"question": "storage_place", "args": '{"self": 1}'}, "it has no argument 'self'"),
        ("/mindstage/storage_place", {"args": '{"itm": "Milk"}'}, "it has no argument 'itm'"),
        ("/mindstage/storage_place", {"args": '{"item": "NothingAtAll"}'}, "NothingAtAll"),
        ("/mindstage/storage_place", {"question": "handle_of"}, "this service is for storage_place"),
    ],
)
def test_invalid_questions_are_errors(call: Call, service: str, args: dict[str, str], text: str) -> None:
    with pytest.raises(ServiceCallError) as failure:
        call(service, **args)
    assert text in str(failure.value)


def test_what_if_takes_a_question_as_an_argument(ask: Ask) -> None:
    answers = ask("what_if", edit="place Mug on Fridge", question="where_is Mug", wait_s=0.2)["answers"]
    under = [{each["name"]: each["value"] for each in row["answer"]} for row in answers]
    assert "Fridge" in {each["other"].rpartition("#")[2] for each in under if each["relation"] == "on"}


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
        ({"language": "question", "query": "handle_of", "args": '{"self": 1}'}, "it has no argument 'self'"),
    ],
)
def test_invalid_queries_are_errors(call: Call, args: dict[str, str], text: str) -> None:
    with pytest.raises(ServiceCallError) as failure:
        call("/mindstage/query", **args)
    assert text in str(failure.value)


def test_a_plain_sentence_is_a_question(call: Call) -> None:
    reply = call("/mindstage/ask", question="where is the Mug?")
    answers = json.loads(reply["answers"])
    assert answers["question"] == "in_words"
    assert answers["notes"] == ["understood: where is the mug?"]
    assert answers["sentence"].endswith(" on Cupboard.")
    assert {row["other"].rpartition("#")[2] for row in answers["answers"]} == {"Cupboard"}


def test_a_sentence_that_is_not_understood_is_an_error(call: Call) -> None:
    with pytest.raises(ServiceCallError, match="'wher'"):
        call("/mindstage/ask", question="wher is the mug?")
