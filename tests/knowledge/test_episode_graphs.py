"""Episodes in SPARQL: events are statements in a graph of each episode, and the present graph is that of any time."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage.episodes import EpisodeEvent, EpisodeEventKind, EpisodeFrame, FrameRecording
from mindstage.errors import EpisodeError, EpisodeTimeError, SparqlSyntaxError
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import write_map
from mindstage.scene import BodyId, Pose
from mindstage.scene.transforms import pose_array
from tests.kitchenette import MAP, kitchenette

KIND = EpisodeEventKind
EVENTS = (
    EpisodeEvent(
        id="PickingUp_1",
        kind=KIND.PICK_UP,
        begin_s=1.0,
        end_s=1.5,
        thing=BodyId("Mug"),
        other=BodyId("Cupboard"),
        agent="viewer",
        evidence=("it left Cupboard",),
    ),
    EpisodeEvent(
        id="SupportedBy_1", kind=KIND.SUPPORT, begin_s=2.0, end_s=None, thing=BodyId("Mug"), other=BodyId("Fridge")
    ),
    EpisodeEvent(
        id="Opening_1",
        kind=KIND.OPEN,
        begin_s=0.5,
        end_s=1.25,
        thing=BodyId("Drawer"),
        joint=BodyId("DrawerSlide"),
        agent="Mug",
        amount=0.4,
    ),
)


def recording(name: str, *, start_unix_s: float | None = 1000.0) -> FrameRecording:
    """The mug is on the cupboard, and from 2 s on on the fridge."""
    world = kitchenette()
    ids = tuple(body.id for body in world.bodies)
    later = replace(
        world,
        bodies=tuple(replace(body, pose=Pose((2.0, 1.0, 1.85))) if body.id == "Mug" else body for body in world.bodies),
    )
    frames = [
        EpisodeFrame(
            time_s=time_s, structure=each, ids=ids, poses=np.array(pose_array(body.pose for body in each.bodies))
        )
        for time_s, each in ((0.0, world), (2.0, later), (3.0, later))
    ]
    return FrameRecording(frames, name=name, start_unix_s=start_unix_s, events=EVENTS, source="mujoco")


@pytest.fixture(scope="module")
def knowledge(tmp_path_factory: pytest.TempPathFactory) -> Iterator[KnowledgeBase]:
    path: Path = tmp_path_factory.mktemp("map") / "kitchenette.owl"
    path.write_text(write_map(kitchenette()))
    with KnowledgeBase() as knowledge:
        knowledge.load(path)
        knowledge.add_episode(recording("run"))
        yield knowledge


def values(knowledge: KnowledgeBase, query: str, **options: object) -> set[tuple[str | None, ...]]:
    table = knowledge.sparql(query, **options)  # type: ignore[arg-type]
    return {tuple(None if term is None else term.value for term in row) for row in table.rows}


def test_events_have_an_interval_participants_and_roles(knowledge: KnowledgeBase) -> None:
    rows = values(
        knowledge,
        """SELECT ?begin ?end ?thing ?role WHERE { GRAPH <urn:mindstage:episode:run> {
            ?event a ms:PickingUp, dul:Action ; dul:hasTimeInterval ?interval ; dul:executesTask ?task .
            ?interval a dul:TimeInterval ; soma:hasIntervalBegin ?begin ; soma:hasIntervalEnd ?end .
            ?event dul:hasParticipant ?thing . ?task a soma:PickingUp ; dul:isTaskOf ?r .
            ?r a ?role ; dul:classifies ?thing } }""",
    )
    soma = "http://www.ease-crc.org/ont/SOMA.owl#"
    assert rows == {
        ("1001", "1001.5", MAP + "Mug", soma + "Patient"),
        ("1001", "1001.5", MAP + "Cupboard", soma + "Supporter"),
    }


def test_times_since_the_begin_agents_and_amounts_are_stated(knowledge: KnowledgeBase) -> None:
    rows = values(
        knowledge,
        """SELECT ?event ?begin ?end ?agent ?amount WHERE { GRAPH <urn:mindstage:episode:run> {
            ?event ms:beginTime ?begin ; dul:isClassifiedBy|dul:executesTask ?concept .
            OPTIONAL { ?event ms:endTime ?end } OPTIONAL { ?event ms:agent|soma:isPerformedBy ?agent }
            OPTIONAL { ?event ms:amount ?amount } } }""",
    )
    graph = "urn:mindstage:episode:run#"
    assert rows == {
        (graph + "PickingUp_1", "1", "1.5", "viewer", None),
        (graph + "SupportedBy_1", "2", None, None, None),
        (graph + "Opening_1", "0.5", "1.25", MAP + "Mug", "0.4"),
    }


def test_events_are_joined_with_the_ontology_and_the_map(knowledge: KnowledgeBase) -> None:
    query = """SELECT ?event ?cls WHERE { GRAPH <urn:mindstage:episode:run> {
        ?event a ?kind ; dul:hasParticipant ?thing } ?kind rdfs:subClassOf+ ms:DetectedAction . ?thing a ?cls }"""
    classes = {(event.rpartition("#")[2], cls.rpartition("#")[2]) for event, cls in values(knowledge, query)}  # type: ignore[union-attr]
    assert classes >= {("PickingUp_1", "Cup"), ("PickingUp_1", "Cupboard"), ("Opening_1", "Drawer")}
    assert not any(event.startswith("Supported") for event, _ in classes)


def test_a_variable_stands_for_the_graphs_of_all_episodes(knowledge: KnowledgeBase) -> None:
    knowledge.add_episode(recording("walk 2", start_unix_s=None))
    try:
        counted = "SELECT ?g (COUNT(*) AS ?n) WHERE { GRAPH ?g { ?event dul:hasTimeInterval ?i ; a dul:Action } }"
        query = f"{counted} GROUP BY ?g"
        assert values(knowledge, query) == {
            ("urn:mindstage:episode:run", "2"),
            ("urn:mindstage:episode:walk%202", "2"),
        }
        pattern = "?e a ms:Opening ; dul:hasTimeInterval/soma:hasIntervalBegin ?b"
        begin = f"SELECT ?b FROM <urn:mindstage:episode:walk%202> {{ {pattern} }}"
        assert values(knowledge, begin) == {("0.5",)}
    finally:
        knowledge.remove_episode("walk 2")


def test_an_event_is_explained_by_its_evidence(knowledge: KnowledgeBase) -> None:
    (row,) = knowledge.ask("occurs", "PickingUp")
    assert knowledge.explain("occurs", row) == (
        "PickingUp_1 of run lasts from 1.000 to 1.500 s",
        "it left Cupboard",
    )
    (row,) = knowledge.ask("occurs", "SupportedBy")
    assert knowledge.explain("occurs", row)[0].endswith("until the end of the episode")


def test_the_graphs_are_not_part_of_the_union(knowledge: KnowledgeBase) -> None:
    query = "ASK { ?event a dul:Action . GRAPH <urn:mindstage:episode:run> { ?event a dul:Action } }"
    assert knowledge.sparql(query).boolean is False
    assert not knowledge.sparql("ASK { ?event dul:hasTimeInterval ?interval }").boolean


@pytest.mark.parametrize(("at", "place"), [(0.0, "Cupboard"), (1.9, "Cupboard"), (2.0, "Fridge"), (3.0, "Fridge")])
def test_the_present_graph_is_that_of_a_time(knowledge: KnowledgeBase, at: float, place: str) -> None:
    query = f"SELECT ?on FROM <urn:mindstage:present> {{ <{MAP}Mug> knowrob:on-Physical ?on }}"
    assert values(knowledge, query, at=at) == {(MAP + place,)}
    source = "SELECT ?s FROM <urn:mindstage:present> { <urn:mindstage:present> ms:source ?s }"
    assert values(knowledge, source, at=at) == {("mujoco",)}


def test_wrong_names_and_times_are_errors(knowledge: KnowledgeBase) -> None:
    with pytest.raises(EpisodeTimeError):
        knowledge.sparql("ASK FROM <urn:mindstage:present> { ?s ?p ?o }", at=9.0)
    with pytest.raises(SparqlSyntaxError, match="no graph is named <urn:mindstage:episode:walk>"):
        knowledge.sparql("ASK FROM <urn:mindstage:episode:walk> { ?s ?p ?o }")
    with KnowledgeBase() as other, pytest.raises(EpisodeError, match="no episode"):
        other.sparql("ASK FROM <urn:mindstage:present> { ?s ?p ?o }", at=1.0)
