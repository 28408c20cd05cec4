"""Knowledge bases at a SPARQL endpoint: the same answers as from files, and errors for all faults."""

from __future__ import annotations

import socket
from collections.abc import Container, Iterator
from http.client import HTTPConnection
from pathlib import Path

import pyoxigraph as ox
import pytest
from msgspec.structs import replace

from mindstage.errors import (
    EndpointError,
    EndpointUnreachableError,
    InvalidArgumentError,
    ReasonerUnavailableError,
    SparqlSyntaxError,
    SparqlTimeoutError,
)
from mindstage.knowledge import KnowledgeBase, SparqlEndpoint
from mindstage.knowledge.queries import list_questions
from mindstage.maps import bundled_kitchen, bundled_ontology
from mindstage.rdf.graphs import local_name
from mindstage.scene import diff
from mindstage.scene.world_diff import ChangeKind
from tests.cases import each_case
from tests.knowledge.faulty_server import FaultyServerStarter, start_faulty_server
from tests.knowledge.sparql_server import SparqlServer
from tests.maps.dialect_maps import soma_map

__all__ = ["start_faulty_server"]

CONTAINER_FOR = "typePrimaryFunction-containerFor"
OF_THE_WORLD = {
    *("direction_of", "is_between", "distance", "nearest", "larger_than", "similar_to", "fits", "free_place"),
    *("can_hold_liquid", "path", "reachable", "visible_from", "misplaced"),
}
"""Questions whose answers are computed from the world, which is compared itself."""
ENDLESS = "SELECT (COUNT(*) AS ?n) WHERE { GRAPH ?x { ?a ?b ?c . ?d ?e ?f . ?g ?h ?i } }"


@pytest.fixture(scope="module")
def server(oxigraph: Path) -> Iterator[SparqlServer]:
    """A server with the bundled kitchen and ontology."""
    server = SparqlServer(oxigraph)
    try:
        server.load_files(bundled_kitchen(), bundled_ontology())
        yield server
    finally:
        server.stop()


@pytest.fixture(scope="module")
def at_server(server: SparqlServer) -> KnowledgeBase:
    return KnowledgeBase(endpoint=server.url, bundled_ontology=False)


@pytest.fixture(scope="module")
def local() -> KnowledgeBase:
    kb = KnowledgeBase()
    kb.load(bundled_kitchen())
    return kb


def assert_same_answers(remote: KnowledgeBase, local: KnowledgeBase, *, but: Container[str] = ()) -> None:
    """Compares all answers, regardless of order and of the number format (177.512833 may become 177.51283)."""
    for question in list_questions():
        if question.name in but or question.name in OF_THE_WORLD:
            continue
        found, expected = remote.ask(question), local.ask(question)
        assert sorted(map(rounded, found)) == sorted(map(rounded, expected)), question.name
        assert found.missing == expected.missing


def rounded(value: object) -> str:
    """A value with sorted facts and rounded numbers."""
    fields = getattr(value, "__struct_fields__", None)
    if fields:
        return f"{type(value).__name__}({', '.join(rounded(getattr(value, name)) for name in fields)})"
    if isinstance(value, tuple):
        return str(sorted(map(rounded, value)))
    try:
        return f"{float(value):.4g}"  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return str(value)


def test_every_question_has_the_answers_of_the_bundled_kitchen(at_server: KnowledgeBase, local: KnowledgeBase) -> None:
    assert_same_answers(at_server, local)
    assert diff(at_server.world(), local.world()).identical(1e-6)


@pytest.mark.parametrize("options", [(), ("--union-default-graph",)], ids=["graphs", "union"])
def test_every_question_has_the_answers_of_the_thesis_map(
    options: tuple[str, ...], oxigraph: Path, shared_data: Path
) -> None:
    map = shared_data / "maps" / "iai-kitchen-original.owl"
    ontologies = sorted((shared_data / "ontology").glob("*/owl/*.owl"))
    local = KnowledgeBase(bundled_ontology=False)
    local.load(map, ontologies=ontologies)
    server = SparqlServer(oxigraph, *options)
    try:
        server.load_files(map, *ontologies)
        # An endpoint has no order of individuals, which decides about three ambiguous boxes of this map.
        remote = KnowledgeBase(endpoint=server.url, bundled_ontology=False)
        assert_same_answers(remote, local, but=["where_is"])
        worlds = remote.world(), local.world()
        differing = {change.id for change in diff(*worlds).changed if change.kind == ChangeKind.SIZE and change.error}
        assert len({body.cls for body in worlds[1].bodies if body.id in differing}) <= 3
    finally:
        server.stop()


def test_a_map_can_be_in_the_default_graph(oxigraph: Path, local: KnowledgeBase) -> None:
    server = SparqlServer(oxigraph)
    try:
        server.load_files(bundled_kitchen(), default=True)
        remote = KnowledgeBase(endpoint=server.url)
        assert remote.maps() == local.maps()
        assert len(remote.world().bodies) == len(local.world().bodies)
        assert {row.individual for row in remote.ask("storage_place_in_environment", item="CowsMilk")}
    finally:
        server.stop()


def test_the_bundled_ontology_and_local_files_are_joined(oxigraph: Path, shared_data: Path) -> None:
    server = SparqlServer(oxigraph)
    try:
        with KnowledgeBase(endpoint=server.url) as remote:
            remote.load(shared_data / "maps" / "iai-kitchen-original.owl")
            assert remote.ask("storage_place_in_environment", item="CowsMilk")
        with KnowledgeBase(endpoint=server.url, bundled_ontology=False) as remote:
            assert remote.maps() == ()
    finally:
        server.stop()


def test_the_order_of_rooms_and_bodies_does_not_depend_on_the_server(
    at_server: KnowledgeBase, local: KnowledgeBase
) -> None:
    assert list(map(rounded, at_server.ask("in_room"))) == list(map(rounded, local.ask("in_room")))
    names = [body.iri for body in at_server.world().bodies]
    assert names == sorted(names)
    assert len(names) > 200


def test_the_alignment_with_soma_is_loaded_if_the_endpoint_uses_soma(oxigraph: Path, tmp_path: Path) -> None:
    path = tmp_path / "soma.ttl"
    path.write_text(
        soma_map(
            ":map a k:SemanticEnvironmentMap .",
            ":drawer a soma:DesignedContainer ; k:describedInMap :map ; soma:hasPhysicalComponent :handle .",
            ":handle a soma:DesignedHandle ; k:describedInMap :map .",
        )
    )
    server = SparqlServer(oxigraph)
    try:
        server.load_files(path)
        with KnowledgeBase(endpoint=server.url) as remote, KnowledgeBase() as local:
            local.load(path)
            for question in ("handle_of", "part_of", "device_for_action_in_environment", "storage_place"):
                found, expected = remote.ask(question), local.ask(question)
                assert sorted(map(str, found)) == sorted(map(str, expected)), question
            assert [local_name(row.handle) for row in remote.ask("handle_of", individual="drawer")] == ["handle"]
            (assumption,) = [each for each in remote.assumptions() if each.topic == "vocabulary"]
            assert "DesignedHandle" in assumption.evidence
        with KnowledgeBase(endpoint=server.url, bundled_ontology=False) as bare:
            assert not bare.ask("device_for_action_in_environment")
            assert bare.sources() == ()
    finally:
        server.stop()


@pytest.mark.parametrize("name", ["soma-iai-room.owl", "knowrob1-ccrl.owl"])
def test_maps_that_do_not_state_their_members_are_found_as_in_files(
    name: str, oxigraph: Path, shared_data: Path
) -> None:
    server = SparqlServer(oxigraph)
    try:
        server.load_files(shared_data / "maps" / name)
        with KnowledgeBase(endpoint=server.url) as remote, KnowledgeBase() as local:
            local.load(shared_data / "maps" / name)
            assert remote.maps() == local.maps() != ()
            there, here = remote.world(), local.world()
            assert {body.iri for body in there.bodies if "_:" not in body.iri} == {
                body.iri for body in here.bodies if "_:" not in body.iri
            }
            assert len(there.bodies) == len(here.bodies) > 5
            named = [
                replace(world, bodies=tuple(body for body in world.bodies if "_:" not in body.iri), joints=())
                for world in (there, here)
            ]
            # A server has no order of statements, which decides about a cup with two poses in the map of KnowRob 1.
            assert len(diff(*named).changed) <= (2 if name == "knowrob1-ccrl.owl" else 0)
            for question in ("storage_place", "handle_of", "device_for_action"):
                found, expected = (
                    {str(row) for row in kb.ask(question) if "_:" not in str(row)} for kb in (remote, local)
                )
                assert found == expected, question
    finally:
        server.stop()


def test_without_soma_at_the_endpoint_nothing_is_aligned(server: SparqlServer) -> None:
    with KnowledgeBase(endpoint=server.url) as remote:
        assert remote.ask("maps")
        assert [path.name for path in remote.sources()] == ["household.ttl"]


def test_few_requests_are_made(server: SparqlServer) -> None:
    endpoint = Counting(server.url)
    kb = KnowledgeBase(endpoint=endpoint, bundled_ontology=False)
    for _ in range(2):
        for question in list_questions():
            kb.ask(question)
        assert endpoint.requests < 30, "for 300 individuals and 18 questions"


def test_all_triples_come_with_one_request(server: SparqlServer, local: KnowledgeBase) -> None:
    endpoint = Counting(server.url)
    kb = KnowledgeBase(endpoint=endpoint, bundled_ontology=False)
    found = {quad.triple for quad in kb.store.quads_for_pattern(None, None, None) if not has_blank(quad)}
    assert found == {quad.triple for quad in local.store.quads_for_pattern(None, None, None) if not has_blank(quad)}
    assert endpoint.requests == 1


def has_blank(quad: ox.Quad) -> bool:
    return isinstance(quad.subject, ox.BlankNode) or isinstance(quad.object, ox.BlankNode)


class Counting(SparqlEndpoint):
    """Counts the queries."""

    requests = 0

    def query(self, *args: object, **kwargs: object) -> object:  # type: ignore[override]
        self.requests += 1
        return super().query(*args, **kwargs)  # type: ignore[arg-type]


# -- assertions --------------------------------------------------------------------------------------------------------


def test_assertions_persist_at_the_endpoint_and_others_can_retract_them(server: SparqlServer) -> None:
    with KnowledgeBase(endpoint=server.url) as one:
        assert not one.ask("storage_place", item="Robot")
        assert one.tell("Cupboard", CONTAINER_FOR, "Robot")
        one.tell("ms:cup_of_joe", "type", "Cup")
        one.tell("cup_of_joe", "mass", 0.25)
        assert [local_name(row.place) for row in one.ask("storage_place", item="Robot")] == ["Cupboard"]
    with KnowledgeBase(endpoint=server.url) as other:
        assert [local_name(row.place) for row in other.ask("storage_place", item="Robot")] == ["Cupboard"]
        assert not other.tell("Cupboard", CONTAINER_FOR, "Robot"), "known already"
        assert other.sparql("ASK { GRAPH ?g { ms:cup_of_joe knowrob:mass 0.25e0 } }").boolean
        assert other.retract("Cupboard", CONTAINER_FOR, "Robot")
        assert other.retract("cup_of_joe", "mass", 0.25)
        assert not other.ask("storage_place", item="Robot")
    with KnowledgeBase(endpoint=server.url) as third:
        assert not third.ask("storage_place", item="Robot")
        assert third.ask("what_is", individual="cup_of_joe")
        assert third.retract("cup_of_joe", "type", "Cup")


def test_only_the_given_restriction_is_retracted(server: SparqlServer) -> None:
    with KnowledgeBase(endpoint=server.url) as one:
        one.tell("Cupboard", CONTAINER_FOR, "Robot")
        one.tell("Cupboard", CONTAINER_FOR, "Wine")
        one.retract("Cupboard", CONTAINER_FOR, "Robot")
    with KnowledgeBase(endpoint=server.url) as other:
        assert not other.ask("storage_place", item="Robot")
        assert "Cupboard" in [local_name(row.place) for row in other.ask("storage_place", item="Wine")]
        assert other.retract("Cupboard", CONTAINER_FOR, "Wine")


def test_local_statements_cannot_be_retracted_at_the_endpoint(oxigraph: Path) -> None:
    server = SparqlServer(oxigraph)
    try:
        with (
            KnowledgeBase(endpoint=server.url) as kb,
            pytest.raises(
                InvalidArgumentError, match=r"it is in a source that is loaded here, .* and not at the endpoint"
            ),
        ):
            kb.retract("Refrigerator", CONTAINER_FOR, "Perishable")
    finally:
        server.stop()


def test_derived_statements_stay_local(server: SparqlServer) -> None:
    everything = "SELECT (COUNT(*) AS ?n) { GRAPH ?g { ?s ?p ?o } }"
    with KnowledgeBase(endpoint=server.url, bundled_ontology=False) as kb:
        before = kb.sparql(everything)
        try:
            assert kb.materialize() > 1000
        except ReasonerUnavailableError as missing:
            pytest.skip(str(missing))
        assert kb.sparql(everything) == before
        assert kb.forget_derived()
        assert not kb.forget_derived()


# -- queries -----------------------------------------------------------------------------------------------------------


def test_queries_are_sent_unchanged(at_server: KnowledgeBase) -> None:
    table = at_server.sparql("SELECT ?super ?no { GRAPH ?g { knowrob:Bread rdfs:subClassOf ?super } }")
    assert table.columns == ("super", "no")
    assert any(super and super.value.endswith("#Baked") for super, _ in table.rows)
    triples = at_server.sparql("CONSTRUCT { ?s a owl:Class } { GRAPH ?g { ?s a owl:Class } }")
    assert len(triples.rows) == len(set(triples.rows)) > 100
    assert at_server.sparql("ASK { GRAPH ?g { knowrob:Bread a owl:Class } }").boolean


def test_a_syntax_error_has_the_message_of_the_server(at_server: KnowledgeBase) -> None:
    with pytest.raises(
        SparqlSyntaxError, match=r"400 Bad Request: .*; the error was reported by http://127\.0\.0\.1:\d+/query"
    ):
        at_server.sparql("SELEC")
    with pytest.raises(SparqlSyntaxError, match="it is an update"):
        at_server.sparql("CLEAR ALL")
    with pytest.raises(SparqlSyntaxError, match="SERVICE"):
        at_server.sparql("ASK { SERVICE <http://127.0.0.1:9/> { } }")


def test_a_query_with_too_long_a_response_times_out(oxigraph: Path) -> None:
    server = SparqlServer(oxigraph)
    try:
        server.load_files(bundled_ontology())
        with pytest.raises(SparqlTimeoutError, match=r"within 0\.3 s"):
            KnowledgeBase(endpoint=server.url).sparql(ENDLESS, timeout_s=0.3)
    finally:
        server.stop()


# -- errors ------------------------------------------------------------------------------------------------------------


@each_case("url", ["", "kitchen", "ftp://h/q", "http://", "http://h:0/", "http://h:99999/", "http://[/"])
def test_an_invalid_url_is_refused_at_once(url: str) -> None:
    with pytest.raises(InvalidArgumentError, match="give one such as http://localhost:7878/query"):
        KnowledgeBase(endpoint=url)


def test_an_unreachable_server_is_reported_without_the_password() -> None:
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))  # a free port without a server
        kb = KnowledgeBase(endpoint=f"http://me:secret@127.0.0.1:{closed.getsockname()[1]}/query")
        with pytest.raises(
            EndpointUnreachableError, match=r"127\.0\.0\.1:\d+/query does not answer: .*refused"
        ) as error:
            kb.maps()
        assert "secret" not in str(error.value)
        with pytest.raises(EndpointUnreachableError):
            kb.ask("storage_place", item="CowsMilk")


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (OSError("the tunnel is closed"), "the tunnel is closed"),
        (OSError(113, "No route to host"), "No route to host"),
        (ConnectionError(), "ConnectionError"),
    ],
)
def test_the_cause_of_a_failed_connection_is_reported(
    error: OSError, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def connect(connection: HTTPConnection) -> None:
        raise error

    monkeypatch.setattr(HTTPConnection, "connect", connect)
    with pytest.raises(EndpointUnreachableError, match=f"does not answer: .*{message}"):
        KnowledgeBase(endpoint="http://127.0.0.1:9/query").maps()


@pytest.mark.parametrize(
    ("fault", "error", "message"),
    [
        ("silent", EndpointUnreachableError, r"no answer within 0\.5 s"),
        ("trickling", EndpointUnreachableError, r"no answer within 0\.5 s"),
        ("hanging up", EndpointUnreachableError, "does not answer"),
        ("cut off", EndpointUnreachableError, "the connection ended in the middle of the reply"),
        ("no HTTP", EndpointUnreachableError, "it does not speak HTTP"),
        (
            "a page",
            EndpointError,
            "its reply is not in a SPARQL format: .*; is that the address where it takes SPARQL?",
        ),
        ("moved", EndpointError, "301 .*; it points to http://elsewhere.example/; give that address, if"),
        ("locked", EndpointError, "401 .*; give a name and password in the address"),
        ("broken", EndpointError, "500 .*: out of luck"),
        ("endless", EndpointError, "the reply is larger than 256 MiB; ask for less"),
    ],
)
def test_a_faulty_server_is_reported(
    fault: str,
    error: type[Exception],
    message: str,
    start_faulty_server: FaultyServerStarter,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("mindstage.knowledge.endpoint.REPLY_LIMIT", 256 * 1024**2 if fault != "endless" else 1024**2)
    message = message.replace("256 MiB", "1 MiB")
    url = start_faulty_server(fault)
    kb = KnowledgeBase(endpoint=SparqlEndpoint(url, timeout_s=0.5 if fault in {"silent", "trickling"} else 30.0))
    with pytest.raises(error, match=message):
        kb.maps()


def test_name_and_password_of_the_url_are_sent_to_the_server(start_faulty_server: FaultyServerStarter) -> None:
    url = start_faulty_server("protected").replace("://", "://me:s%20ecret@")
    assert KnowledgeBase(endpoint=url).sparql("ASK {}").boolean


def test_a_server_that_refuses_updates_is_reported(start_faulty_server: FaultyServerStarter) -> None:
    endpoint = SparqlEndpoint(start_faulty_server("read-only"))
    with pytest.raises(EndpointError, match=r"405 .*; is that the address .*, and does it allow that\?"):
        endpoint.update("INSERT DATA { <a:a> <a:b> <a:c> }")


def test_updates_go_to_the_derived_or_the_given_url(start_faulty_server: FaultyServerStarter) -> None:
    url = start_faulty_server("echoing the path")
    for endpoint, where in (
        (SparqlEndpoint(f"{url}/query"), "/update"),
        (SparqlEndpoint(f"{url}/sparql"), "/update"),
        (SparqlEndpoint(f"{url}/repositories/home"), "/repositories/home"),
        (SparqlEndpoint(f"{url}/query", update_url=f"{url}/changes"), "/changes"),
    ):
        with pytest.raises(EndpointError, match=f"at {where}$"):
            endpoint.update("CLEAR ALL")
