"""The index in the folder of a store: it gives the same answers, and is never used for other statements."""

from __future__ import annotations

import shutil
from pathlib import Path

import pyoxigraph as ox
import pytest

from mindstage.errors import SourceParseError
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge import knowledge_base as module
from mindstage.knowledge.names import EntityType
from mindstage.knowledge.queries import list_questions
from mindstage.knowledge.reasoner import Reasoner
from mindstage.knowledge.sources import SourceRegistry
from mindstage.knowledge.store import OxigraphStore
from mindstage.maps import bundled_kitchen
from mindstage.rdf.graphs import local_name
from mindstage.rdf.vocabulary import TYPE, knowrob
from tests.maps.dialect_maps import soma_map
from tests.maps.small_maps import body_turtle, room_map
from tests.maps.test_soma import CASE, DOOR, DOOR_JOINT, HANDLE, located

ANONYMOUS = """<e:tub> a <http://knowrob.org/kb/knowrob.owl#Bowl> , [ a owl:Restriction ; owl:onProperty <e:holds> ;
    owl:someValuesFrom <e:Water> ] . [] a <e:Puddle> ; <e:holds> <e:tub> . <e:holds> a owl:ObjectProperty .
    <e:Wet> owl:equivalentClass [ a owl:Restriction ; owl:onProperty <e:holds> ; owl:someValuesFrom <e:Water> ] ."""


@pytest.fixture(scope="module")
def kitchen_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("stores") / "kitchen"
    with KnowledgeBase(store=folder) as kb:
        kb.load(bundled_kitchen())
    return folder


@pytest.fixture
def folder(kitchen_store: Path, tmp_path: Path) -> Path:
    return shutil.copytree(kitchen_store, tmp_path / "kitchen")


@pytest.fixture
def no_scan(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fails a test in which a reasoner reads all statements."""

    def build(store: OxigraphStore) -> Reasoner:
        assert store._folder is None, "the statements were read instead of the index"
        return Reasoner(store)

    monkeypatch.setattr(module, "Reasoner", build)


def problems(kb: KnowledgeBase) -> list[str]:
    return [finding.problem for finding in kb.findings() if "its index" in finding.problem]


def assert_same_answers(kb: KnowledgeBase, other: KnowledgeBase) -> None:
    for question in list_questions():
        assert set(kb.ask(question)) == set(other.ask(question)), question.name
    names = {name for name in other.names.short_names() if not name.startswith("_:")}
    assert {name for name in kb.names.short_names() if not name.startswith("_:")} == names
    for name in names:
        iris = other.names.by_local_name[name]
        assert set(kb.names.by_local_name[name]) == set(iris)
        assert [kb.reasoner.is_property(iri) for iri in iris] == [other.reasoner.is_property(iri) for iri in iris]


def test_the_index_is_there_after_loading_and_gives_the_same_answers(folder: Path, no_scan: None) -> None:
    memory = KnowledgeBase()
    memory.load(bundled_kitchen())
    with KnowledgeBase(store=folder) as kb:
        assert_same_answers(kb, memory)
        assert not problems(kb)


@pytest.mark.parametrize("text", [room_map(body_turtle("cup"), ANONYMOUS), soma_map(DOOR_JOINT, CASE, DOOR, HANDLE)])
def test_maps_with_blank_nodes_are_indexed_too(text: str, tmp_path: Path) -> None:
    (tmp_path / "room.ttl").write_text(text, encoding="utf-8")
    (tmp_path / "two.ttl").write_text(soma_map(located("mug")).replace("old.owl", "two.owl"), encoding="utf-8")
    memory = KnowledgeBase()
    memory.load([tmp_path / "room.ttl", tmp_path / "two.ttl"])
    with KnowledgeBase(store=tmp_path / "store") as kb:
        kb.load([tmp_path / "room.ttl", tmp_path / "two.ttl"])
    with KnowledgeBase(store=tmp_path / "store") as kb:
        assert kb._registry.saved_index()
        for question in list_questions():
            assert len(kb.ask(question)) == len(memory.ask(question)), question.name
        assert kb.maps() == memory.maps()


def test_what_is_loaded_later_is_indexed(folder: Path, tmp_path: Path, no_scan: None) -> None:
    (tmp_path / "room.ttl").write_text(room_map(body_turtle("cup")), encoding="utf-8")
    with KnowledgeBase(store=folder) as kb:
        kb.load(tmp_path / "room.ttl")
    with KnowledgeBase(store=folder) as kb:
        assert kb.names.find("cup", EntityType.INDIVIDUAL)
        assert kb.ask("storage_place", "CowsMilk")
        assert len(kb.maps()) == 2


def test_assertions_are_in_the_index_of_the_next_process(folder: Path, no_scan: None) -> None:
    with KnowledgeBase(store=folder) as kb:
        kb.tell("Cupboard", "typePrimaryFunction-containerFor", "Robot")
        kb.tell("ms:shed", "type", "Cupboard")
    with KnowledgeBase(store=folder) as kb:
        assert [local_name(row.place) for row in kb.ask("storage_place", "Robot")] == ["Cupboard"]
        assert kb.ask("what_is", "shed")[0].classes == (knowrob("Cupboard"),)
        kb.retract("ms:shed", "type", "Cupboard")
        kb.retract("Cupboard", "typePrimaryFunction-containerFor", "Robot")
    with KnowledgeBase(store=folder) as kb:
        assert not kb.ask("storage_place", "Robot")
        assert not problems(kb)


def damage(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


@pytest.mark.parametrize(
    "change", [damage, lambda path: path.write_bytes(b""), lambda path: path.write_bytes(b"x" * 99)]
)
def test_a_damaged_index_is_reported_and_rebuilt(change: object, folder: Path) -> None:
    change(folder / "index.msgpack")  # type: ignore[operator]
    with KnowledgeBase(store=folder) as kb:
        assert kb.ask("storage_place", "CowsMilk")
        assert problems(kb) == ["its index cannot be used: it is damaged"]
    with KnowledgeBase(store=folder) as kb:
        assert kb.ask("storage_place", "CowsMilk")
        assert not problems(kb), "it was rebuilt"


def test_an_older_index_put_back_is_not_used(folder: Path) -> None:
    old = (folder / "index.msgpack").read_bytes()
    with KnowledgeBase(store=folder) as kb:
        kb.tell("ms:shed", "type", "Cupboard")
    (folder / "index.msgpack").write_bytes(old)
    with KnowledgeBase(store=folder) as kb:
        assert kb.ask("what_is", "shed")[0].classes == (knowrob("Cupboard"),)
        assert problems(kb) == ["its index cannot be used: the statements have changed since it was made"]


@pytest.mark.parametrize("opened_between", [False, True])
def test_a_change_by_another_program_is_noticed(opened_between: bool, folder: Path) -> None:
    store = ox.Store(folder / "triples")
    shed = ox.NamedNode("http://e.org/shed")
    store.add(ox.Quad(shed, ox.NamedNode(TYPE), ox.NamedNode(knowrob("Cupboard")), shed))
    store.flush()
    del store
    if opened_between:
        KnowledgeBase(store=folder).close()
    with KnowledgeBase(store=folder) as kb:
        assert kb.ask("what_is", "shed")[0].classes == (knowrob("Cupboard"),)
        assert len(problems(kb)) == 1


def test_a_missing_index_is_made_by_the_first_question(folder: Path) -> None:
    (folder / "index.msgpack").unlink()
    with KnowledgeBase(store=folder) as kb:
        assert kb.ask("storage_place", "CowsMilk")
        assert not problems(kb)
        assert (folder / "index.msgpack").exists()


def test_a_failed_load_does_not_leave_an_index_of_what_failed(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "good.ttl").write_text("<e:Good> a <http://www.w3.org/2002/07/owl#Class> .")
    (tmp_path / "bad.ttl").write_text("<e:Bad> a <")
    with KnowledgeBase(store=folder) as kb, pytest.raises(SourceParseError):
        kb.load((), ontologies=[tmp_path / "good.ttl", tmp_path / "bad.ttl"])
    with KnowledgeBase(store=folder) as kb:
        assert not kb.sparql("ASK { <e:Good> ?p ?o }")
        assert "Good" not in kb.names.by_local_name
        assert kb.ask("storage_place", "CowsMilk")


def several_maps() -> str:
    """One file with three maps, which are not in the order of their names."""
    described = "@prefix knowrob: <http://knowrob.org/kb/knowrob.owl#> .\n"
    for name in ("zoo", "attic", "mill"):
        described += f"<urn:{name}> a knowrob:SemanticEnvironmentMap .\n"
        described += f"<urn:{name}-cup> a knowrob:Cup ; knowrob:describedInMap <urn:{name}> .\n"
    return described


def test_several_maps_of_a_file_are_listed_in_its_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "maps.ttl"
    file.write_text(several_maps(), encoding="utf-8")
    plain = KnowledgeBase()
    plain.load(file)
    assert plain.maps() == ("urn:zoo", "urn:attic", "urn:mill")
    # The index has them from the one time that the text is read.
    monkeypatch.setattr(SourceRegistry, "source_graph", lambda *_: pytest.fail("the graph was made again"))
    with KnowledgeBase(store=tmp_path / "store") as kb:
        kb.load(file)
        assert kb.maps() == plain.maps()
    with KnowledgeBase(store=tmp_path / "store") as again:
        assert again.maps() == plain.maps()


def test_a_file_that_is_repaired_is_indexed_once(tmp_path: Path) -> None:
    whole = bundled_kitchen().read_text(encoding="utf-8")
    broken = whole.replace('rdf:about="', "rdf:about=", 1)
    assert broken != whole
    file = tmp_path / "kitchen.owl"
    file.write_text(broken, encoding="utf-8")
    plain = KnowledgeBase()
    plain.load(file)
    assert plain.findings()
    with KnowledgeBase(store=tmp_path / "store") as kb:
        kb.load(file)
        assert kb.findings() == plain.findings()
    with KnowledgeBase(store=tmp_path / "store") as again:
        assert not problems(again)
        assert_same_answers(again, plain)


def test_a_file_that_cannot_be_repaired_leaves_no_names_behind(folder: Path, tmp_path: Path) -> None:
    file = tmp_path / "wrong.ttl"
    file.write_text("<urn:Phantom> a <http://www.w3.org/2002/07/owl#Class> .\n<urn:", encoding="utf-8")
    with KnowledgeBase(store=folder) as kb:
        with pytest.raises(SourceParseError):
            kb.load(file)
        assert "Phantom" not in kb.names.by_local_name
        assert not list(kb.store.quads_for_pattern(ox.NamedNode("urn:Phantom"), None, None))
    with KnowledgeBase(store=folder) as again:
        assert "Phantom" not in again.names.by_local_name
