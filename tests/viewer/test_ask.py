"""The Ask panel without a browser: forms, tables, explanations, highlights and assertions."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from mindstage import KnowledgeBase, NullEngine, Simulation
from mindstage.knowledge.queries import list_questions
from mindstage.maps import bundled_kitchen
from mindstage.prolog import is_installed, solve_query
from mindstage.simulation.question_pool import QuestionPool
from mindstage.viewer.ask import AskHandler
from mindstage.viewer.server import RpcChannel
from tests.viewer.fake_page import FakePage, RequestFailedError

needs_prolog = pytest.mark.skipif(not is_installed() and not os.environ.get("CI"), reason="Prolog is not installed")


@pytest.fixture(scope="module")
def knowledge() -> KnowledgeBase:
    """The bundled kitchen; tests retract what they assert."""
    knowledge = KnowledgeBase()
    knowledge.load(bundled_kitchen())
    return knowledge


@pytest.fixture
def simulation(knowledge: KnowledgeBase) -> Iterator[Simulation]:
    with Simulation(knowledge, NullEngine(), primitive_shapes=True) as simulation:
        simulation.spawn()
        yield simulation


@pytest.fixture
def channel() -> Iterator[RpcChannel]:
    channel = RpcChannel()
    yield channel
    channel.close()


@pytest.fixture
def handler(simulation: Simulation, channel: RpcChannel) -> AskHandler:
    return AskHandler(simulation, channel, prolog=solve_query if is_installed() else None)


@pytest.fixture
def page(handler: AskHandler, channel: RpcChannel) -> FakePage:
    return FakePage(channel)


def texts(table: dict, column: str) -> list[object]:
    at = table["columns"].index(column)
    return [row[at]["text"] for row in table["rows"]]


# -- forms and names ---------------------------------------------------------------------------------------------------


def test_every_declared_question_has_a_form_with_arguments_and_text(page: FakePage) -> None:
    offered = {each["name"]: each for each in page.ask("ask.questions")}
    assert list(offered) == [question.name for question in list_questions()]
    storage = offered["storage_place_in_environment"]
    assert [argument["name"] for argument in storage["arguments"]] == [
        argument.name for argument in next(q for q in list_questions() if q.name == storage["name"]).arguments
    ]
    assert {argument["completion"] for argument in storage["arguments"]} <= {"CLASS", "INDIVIDUAL", "MAP", ""}
    assert storage["text"]
    states = next(argument for argument in offered["articulated_parts"]["arguments"] if argument["choices"])
    assert "open" in states["choices"]


def test_names_are_completed_by_prefix_ignoring_case(page: FakePage) -> None:
    found = page.ask("ask.complete", prefix="cowsm", kind="CLASS")
    assert found[0]["name"] == "CowsMilk"
    assert found[0]["iri"].endswith("#CowsMilk")
    inside = [each["name"] for each in page.ask("ask.complete", prefix="fridgerat", kind="CLASS")]
    assert not inside
    assert "Refrigerator" in [each["name"] for each in page.ask("ask.complete", prefix="frigerat", kind="CLASS")]


def test_individuals_are_completed_with_their_class(page: FakePage) -> None:
    found = page.ask("ask.complete", prefix="Fridge", kind="INDIVIDUAL")
    assert {"name": "fridge", "description": "FridgeW60H140"}.items() <= found[0].items()


def test_prefixed_names_are_completed(page: FakePage) -> None:
    assert "CowsMilk" in [each["name"] for each in page.ask("ask.complete", prefix="knowrob:CowsM", kind="CLASS")]
    assert page.ask("ask.complete", prefix="dul:CowsM", kind="CLASS") == []


def test_the_number_of_completions_is_limited(page: FakePage) -> None:
    assert len(page.ask("ask.complete", prefix="", kind="CLASS", limit=3)) == 3
    assert len(page.ask("ask.complete", prefix="", kind="CLASS", limit=100_000)) == 50
    with pytest.raises(RequestFailedError, match="not a kind of entity; the kinds are CLASS"):
        page.ask("ask.complete", prefix="x", kind="SECRET")


# -- questions ---------------------------------------------------------------------------------------------------------


def test_the_storage_place_of_milk_is_a_body_that_can_be_selected(page: FakePage, simulation: Simulation) -> None:
    table = page.ask("ask", question="storage_place_in_environment", args={"item": "CowsMilk"})
    assert (table["total"], table["ids"]) == (1, ["fridge"])
    assert "fridge" in simulation.state.ids
    assert table["title"] == "storage_place_in_environment item=CowsMilk"


def test_empty_arguments_are_unbound(page: FakePage) -> None:
    some = page.ask("ask", question="storage_place", args={"item": "CowsMilk", "place": " "})
    assert "Refrigerator" in texts(some, "place")
    assert page.ask("ask", question="storage_place", args={})["total"] > some["total"]


def test_an_unknown_name_is_an_error_with_suggestions(page: FakePage) -> None:
    with pytest.raises(RequestFailedError, match=r"NameNotFoundError: .*CowsMilkk.*CowsMilk"):
        page.ask("ask", question="storage_place", args={"item": "CowsMilkk"})
    with pytest.raises(RequestFailedError, match="QuestionNotFoundError"):
        page.ask("ask", question="storage_plase")
    with pytest.raises(RequestFailedError, match=r"InvalidArgumentError: .*has no argument 'thing'"):
        page.ask("ask", question="storage_place", args={"thing": "x"})
    with pytest.raises(RequestFailedError, match=r"InvalidArgumentError: .*has no argument 'self'"):
        page.ask("ask", question="storage_place", args={"self": "x"})


def test_what_if_takes_a_question_as_an_argument(page: FakePage) -> None:
    args = {"edit": "open the fridge", "question": "where_is milk_carton_1", "wait_s": "0.2"}
    table = page.ask("ask", question="what_if", args=args)
    assert set(texts(table, "asked")) == {"where_is"}


def test_an_explanation_has_several_lines(page: FakePage) -> None:
    table = page.ask("ask", question="storage_place", args={"item": "CowsMilk"})
    assert table["explainable"]
    lines = page.ask("ask.explain", key=table["key"], row=0)
    assert len(lines) >= 2
    assert any("Refrigerator" in line for line in lines)


def test_only_recent_answers_are_kept(page: FakePage) -> None:
    first = page.ask("ask", question="storage_place", args={"item": "CowsMilk"})
    for _ in range(8):
        last = page.ask("ask", question="maps")
    assert page.ask("ask.explain", key=last["key"], row=0)
    with pytest.raises(RequestFailedError, match="not kept any more; ask again"):
        page.ask("ask.explain", key=first["key"], row=0)
    with pytest.raises(RequestFailedError, match="row 99 does not exist"):
        page.ask("ask.explain", key=last["key"], row=99)


def test_sessions_cannot_use_the_answers_of_one_another(page: FakePage, channel: RpcChannel) -> None:
    table = page.ask("ask", question="maps")
    with pytest.raises(RequestFailedError, match="ask again"):
        FakePage(channel).ask("ask.highlight", key=table["key"], color="blue")


# -- highlights --------------------------------------------------------------------------------------------------------


def test_highlighting_answers_replaces_other_highlights_and_publishes_the_group(
    page: FakePage, handler: AskHandler, simulation: Simulation
) -> None:
    handler.publish(simulation.state)
    assert page.latest_value("highlights") == []
    simulation.highlight([simulation.state.ids[0]], (1.0, 0.0, 0.0))
    table = page.ask("ask", question="storage_place_in_environment", args={"item": "CowsMilk"})
    shown = page.ask("ask.highlight", key=table["key"], color="#1f5fe0")
    assert shown["highlighted"] == sorted(set(table["ids"]), key=table["ids"].index)
    assert set(simulation.state.highlights) == set(table["ids"])
    handler.publish(simulation.state)
    (group,) = page.latest_value("highlights")
    assert (group["label"], group["color"]) == (table["title"], "#1f5fe0")
    assert set(group["ids"]) == set(table["ids"])


def test_single_rows_can_be_added_to_the_highlights(page: FakePage, simulation: Simulation) -> None:
    doors = page.ask("ask", question="individual_of_class", args={"cls": "Door"})
    with_bodies = [row for row, id in enumerate(doors["ids"]) if id]
    assert len(with_bodies) > 2
    page.ask("ask.highlight", key=doors["key"], color="green", rows=with_bodies[:1])
    mugs = page.ask("ask", question="storage_place_in_environment", args={"item": "CowsMilk"})
    page.ask("ask.highlight", key=mugs["key"], color="blue", replace=False)
    assert set(simulation.state.highlights) == {doors["ids"][with_bodies[0]], *mugs["ids"]}
    page.ask("ask.clear_highlights", label=mugs["title"])
    assert set(simulation.state.highlights) == {doors["ids"][with_bodies[0]]}
    page.ask("ask.clear_highlights")
    assert not simulation.state.highlights


def test_answers_without_a_body_are_reported_with_the_reason(page: FakePage) -> None:
    table = page.ask("ask", question="storage_place", args={"item": "CowsMilk"})
    shown = page.ask("ask.highlight", key=table["key"], color="blue")
    assert shown["highlighted"] == []
    assert "class" in shown["not_highlighted"][0]["reason"]
    with pytest.raises(RequestFailedError, match="InvalidColorError"):
        page.ask("ask.highlight", key=table["key"], color="bluue")


# -- queries -----------------------------------------------------------------------------------------------------------


def test_a_query_is_answered_as_a_table_whose_rows_are_bodies(page: FakePage, simulation: Simulation) -> None:
    found = page.ask("ask.sparql", query="SELECT ?x WHERE { ?x a ms:FridgeW60H140 }")
    assert found["columns"] == ["x"]
    assert found["ids"]
    assert set(found["ids"]) <= set(simulation.state.ids)
    page.ask("ask.highlight", key=found["key"], color="yellow")
    assert set(simulation.state.highlights) == set(found["ids"])
    assert page.ask("ask.sparql", query="ASK { knowrob:Refrigerator a owl:Class }")["boolean"] is True


@pytest.mark.parametrize(
    "query",
    [
        "INSERT DATA { <urn:a> <urn:b> <urn:c> }",
        "LOAD <file:///etc/passwd>",
        "SELECT * { SERVICE <http://127.0.0.1:1/> { ?s ?p ?o } }",
        "SELEKT *",
        "SELECT * FROM <file:///etc/passwd> { ?s ?p ?o",
    ],
)
def test_a_query_cannot_write_or_contact_other_servers(page: FakePage, query: str) -> None:
    with pytest.raises(RequestFailedError, match="SparqlSyntaxError"):
        page.ask("ask.sparql", query=query)


def test_a_query_does_not_read_files(page: FakePage) -> None:
    query = 'SELECT * FROM <file:///etc/passwd> { ?s ?p ?o FILTER(CONTAINS(?o, "root:")) }'
    with pytest.raises(RequestFailedError, match="no graph is named <file:///etc/passwd>, and nothing is fetched"):
        page.ask("ask.sparql", query=query)
    near = query.replace("/etc/passwd", f"{bundled_kitchen()}x")
    with pytest.raises(RequestFailedError) as refused:
        page.ask("ask.sparql", query=near)
    assert str(bundled_kitchen().parent) not in str(refused.value).partition("nothing is fetched")[2], (
        "no path is shown"
    )
    with pytest.raises(RequestFailedError, match="more than 20000 characters"):
        page.ask("ask.sparql", query="#" * 20_001)


# -- Prolog queries ----------------------------------------------------------------------------------------------------


@needs_prolog
def test_a_prolog_query_is_answered_as_a_table_of_its_variables(page: FakePage, simulation: Simulation) -> None:
    assert page.ask("ask.languages") == {"prolog": True, "prolog_missing": ""}
    line = "storage_place_in_environment(Map, knowrob:'CowsMilk', Place), articulated_parts(Map, Place, State, Part)"
    found = page.ask("ask.prolog", line=line)
    assert found["columns"] == ["Map", "Place", "State", "Part"]
    assert (found["ids"], texts(found, "Part"), texts(found, "State")) == (["fridge"], ["fridge_door"], ["closed"])
    assert (found["total"], found["complete"]) == (1, True)
    page.ask("ask.highlight", key=found["key"], color="red")
    assert set(simulation.state.highlights) == {"fridge"}
    assert page.ask("ask.prolog", line="storage_place(knowrob:'CowsMilk', knowrob:'Dishwasher')")["boolean"] is False
    assert page.ask("ask.prolog", line="1 < 2")["boolean"] is True


@needs_prolog
def test_a_prolog_query_cannot_call_other_predicates(page: FakePage, tmp_path: Path) -> None:
    mark = tmp_path / "mark"
    with pytest.raises(RequestFailedError, match=r"PrologGoalError: .*shell/1 cannot be asked here, only questions"):
        page.ask("ask.prolog", line=f"storage_place(X, Y), shell('touch {mark}')")
    assert not mark.exists()


# -- assertions --------------------------------------------------------------------------------------------------------


def test_a_missing_fact_can_be_asserted_and_retracted(page: FakePage) -> None:
    asked = {"question": "storage_place", "args": {"item": "Door"}}
    before = page.ask("ask", **asked)
    statement = {"subject": "ToolBox", "property": "typePrimaryFunction-containerFor", "value": "Door"}
    assert before["rows"] == []
    (fact,) = before["missing"]
    assert (fact["subject"], fact["value"]) == ("", "knowrob:Door")
    assert fact["property"] == "knowrob:typePrimaryFunction-containerFor"
    assert "Door" in fact["reason"]
    assert page.ask("ask.tell", **statement) is True
    try:
        assert "ToolBox" in texts(page.ask("ask", **asked), "place")
        assert page.ask("ask.tell", **statement) is False
    finally:
        assert page.ask("ask.tell", **statement, retract=True) is True
    assert page.ask("ask", **asked)["rows"] == before["rows"]


def test_an_assertion_about_an_unknown_name_is_refused(page: FakePage) -> None:
    with pytest.raises(RequestFailedError, match="NameNotFoundError"):
        page.ask("ask.tell", subject="Nonsense", property="subClassOf", value="Mug")
    with pytest.raises(RequestFailedError, match="InvalidRequestError"):
        page.ask("ask.tell", subject="Mug")


# -- time limits -------------------------------------------------------------------------------------------------------


def test_a_question_has_a_timeout_and_other_requests_are_answered(
    simulation: Simulation, channel: RpcChannel, monkeypatch: pytest.MonkeyPatch
) -> None:
    pool = QuestionPool(simulation, time_s=0.2)
    AskHandler(simulation, channel, timeout_s=0.2, pool=pool)
    page, enough = FakePage(channel), threading.Event()
    monkeypatch.setattr(simulation, "ask", lambda *_, **__: enough.wait(60.0))
    try:
        with pytest.raises(RequestFailedError, match=r"QuestionTimeoutError: maps was not answered within 0.2 s"):
            page.ask("ask", question="maps")
        for _ in range(4):
            with pytest.raises(
                RequestFailedError, match=r"QuestionTimeoutError: .*'stays' was not answered within 0.2 s"
            ):
                page.ask("ask", question="stays")
        with pytest.raises(RequestFailedError, match=r"QueryLimitError: .*4 other questions are being answered"):
            page.ask("ask", question="stays")
        for method, arguments, label in (
            ("ask.sparql", {"query": "ASK {}"}, "the query"),
            ("ask.complete", {"prefix": "Cup"}, "the completion"),
        ):
            with pytest.raises(RequestFailedError, match=rf"QueryLimitError: .*{label}"):
                page.ask(method, **arguments)
        assert page.ask("ask.questions")
        assert simulation.engine.ping() < 10.0
    finally:
        enough.set()
        pool.close()


def test_a_page_is_told_the_place_of_its_question_while_it_waits(
    simulation: Simulation, channel: RpcChannel, monkeypatch: pytest.MonkeyPatch
) -> None:
    pool, enough = QuestionPool(simulation, processes=1), threading.Event()
    monkeypatch.setattr(pool, "start_processes", lambda: None)
    handler = AskHandler(simulation, channel, pool=pool)
    ask = simulation.ask
    monkeypatch.setattr(simulation, "ask", lambda *args, **named: enough.wait(60.0) and ask(*args, **named))
    told: list[tuple[str, object]] = []
    page = FakePage(channel)
    page.session.send_event = lambda topic, value: told.append((topic, value))
    try:
        first, end_s = pool.submit("maps", {}, client="another"), time.monotonic() + 60.0
        while pool.place(first)[0] and time.monotonic() < end_s:
            time.sleep(0.01)
        with ThreadPoolExecutor(1) as threads:
            answered = threads.submit(page.ask, "ask", question="where_is", args={"thing": "fridge"})
            while not told and time.monotonic() < end_s:
                handler.publish(simulation.state)
                time.sleep(0.01)
            enough.set()
            assert answered.result(60.0)["total"] > 0
        assert told[0] == ("ask.place", {"place": 1, "waiting": 1})
        assert first.result.result(60.0).json
        told.clear()
        handler.publish(simulation.state)
        assert not told
    finally:
        enough.set()
        pool.close()


# -- sentences ---------------------------------------------------------------------------------------------------------


def test_a_sentence_is_answered_with_what_was_understood(page: FakePage) -> None:
    table = page.ask("ask", question="where is the milk?")
    assert table["notes"] == ["understood: where is the milk?"]
    assert table["sentence"] == "Milk carton 1 and milk carton 2 are in fridge."
    assert {"milk_carton_1", "milk_carton_2"} == {*texts(table, "thing")}


def test_a_sentence_that_is_not_understood_is_an_error_with_the_nearest_names(page: FakePage) -> None:
    with pytest.raises(RequestFailedError, match="near: 'Milk'"):
        page.ask("ask", question="where is the milc?")
