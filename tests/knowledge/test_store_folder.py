"""Knowledge bases in a folder: everything persists, and an incomplete folder is never used."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from mindstage.errors import InvalidArgumentError, SourceParseError, StoreError
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge import sources as library
from mindstage.knowledge.queries import list_questions
from mindstage.knowledge.store import OxigraphStore
from mindstage.maps import bundled_kitchen, bundled_ontology
from mindstage.rdf import Finding
from mindstage.rdf.graphs import local_name
from tests.maps.small_maps import body_turtle, individual, room_map

CONTAINER_FOR = "typePrimaryFunction-containerFor"


@pytest.fixture(scope="module")
def kitchen_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("stores") / "kitchen"
    with KnowledgeBase(store=folder) as kb:
        kb.load(bundled_kitchen())
    return folder


@pytest.fixture
def folder(kitchen_folder: Path, tmp_path: Path) -> Path:
    """A folder with the kitchen."""
    return shutil.copytree(kitchen_folder, tmp_path / "kitchen")


@pytest.fixture
def small(tmp_path: Path) -> tuple[Path, Path]:
    """A folder and the map that was loaded into it, which has a cup and imports an ontology."""
    map = tmp_path / "room.ttl"
    ontology = tmp_path / "words.ttl"
    ontology.write_text("@prefix owl: <http://www.w3.org/2002/07/owl#> . <e:Word> a owl:Class .", encoding="utf-8")
    map.write_text(room_map(body_turtle("cup"), f"<> owl:imports <{ontology.as_uri()}> ."), encoding="utf-8")
    with KnowledgeBase(store=tmp_path / "store", bundled_ontology=False) as kb:
        kb.load(map)
    return tmp_path / "store", map


def reopened(folder: Path) -> KnowledgeBase:
    return KnowledgeBase(store=folder)


# -- persistence -------------------------------------------------------------------------------------------------------


def test_a_reopened_folder_has_everything_without_parsing(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fresh = KnowledgeBase()
    fresh.load(bundled_kitchen())
    answers = {question: set(fresh.ask(question)) for question in list_questions()}

    def refuse(*_: object) -> None:
        raise AssertionError("a source was parsed")

    monkeypatch.setattr(OxigraphStore, "load", refuse)
    monkeypatch.setattr(library, "read_file", refuse)
    with reopened(folder) as kb:
        assert kb.maps() == fresh.maps()
        for question, expected in answers.items():
            assert set(kb.ask(question)) == expected, question.name
        assert kb.world() == fresh.world(), "to the letter"
        assert kb.sources() == (bundled_ontology(), bundled_kitchen())


def test_a_reopened_folder_has_its_findings(tmp_path: Path) -> None:
    map = tmp_path / "room.ttl"
    map.write_text(room_map(body_turtle("cup"), "<> owl:imports <package://nowhere/x.owl> ."), encoding="utf-8")
    with KnowledgeBase(store=tmp_path / "store") as kb:
        kb.load(map)
        found = kb.findings()
    assert "package://nowhere/x.owl" in found[0].problem
    with reopened(tmp_path / "store") as kb:
        assert kb.findings() == found


def test_assertions_and_retractions_persist(folder: Path) -> None:
    with reopened(folder) as kb:
        kb.tell("Cupboard", CONTAINER_FOR, "Robot")
        assert kb.retract("Refrigerator", CONTAINER_FOR, "Perishable")
    with reopened(folder) as kb:
        assert [local_name(row.place) for row in kb.ask("storage_place", item="Robot")] == ["Cupboard"]
        assert not kb.ask("storage_place", item="CowsMilk")
        assert kb.retract("Cupboard", CONTAINER_FOR, "Robot")
    with reopened(folder) as kb:
        assert not kb.ask("storage_place", item="Robot")


def test_loading_the_same_sources_again_changes_nothing(folder: Path) -> None:
    before = (folder / "mindstage.json").read_bytes()
    with reopened(folder) as kb:
        kb.load(bundled_kitchen())
        assert len(kb.maps()) == 1
    assert (folder / "mindstage.json").read_bytes() == before


def test_more_can_be_loaded_later(folder: Path, tmp_path: Path) -> None:
    map = tmp_path / "room.ttl"
    map.write_text(room_map(body_turtle("cup")), encoding="utf-8")
    with reopened(folder) as kb:
        kb.load(map)
    with reopened(folder) as kb:
        assert [local_name(map) for map in kb.maps()] == ["kitchen", "room"]
        assert len(kb.world("room").bodies) == 1


def test_queries_see_the_folder_and_recent_assertions(folder: Path) -> None:
    ask = "ASK { ms:Rack rdfs:subClassOf knowrob:Refrigerator }"
    with reopened(folder) as kb:
        assert kb.sparql("ASK { ?map a knowrob:SemanticEnvironmentMap }").boolean
        assert not kb.sparql(ask).boolean
        kb.tell("ms:Rack", "subClassOf", "Refrigerator")
        assert kb.sparql(ask).boolean
    expected = ["index.msgpack", "index.state", "mindstage.json", "texts", "triples"]
    assert sorted(path.name for path in folder.iterdir()) == expected
    (folder / "triples-as-asked-7").mkdir()  # left by a process that was killed during a query
    reopened(folder).close()
    assert not (folder / "triples-as-asked-7").exists()


def test_a_folder_keeps_the_choice_of_the_bundled_ontology(small: tuple[Path, Path], folder: Path) -> None:
    with reopened(small[0]) as kb:
        assert bundled_ontology() not in kb.sources()
    with pytest.raises(StoreError, match="it was made with the bundled ontology; create another one without it"):
        KnowledgeBase(store=folder, bundled_ontology=False)


def test_the_bundled_ontology_of_another_version_is_replaced(folder: Path) -> None:
    manifest = json.loads((folder / "mindstage.json").read_text())
    manifest["sources"][0]["file_hash"] = "0" * 64
    text = json.dumps(manifest).replace(str(bundled_ontology()), "/elsewhere/household.ttl")
    (folder / "mindstage.json").write_text(text)
    with reopened(folder) as kb:
        assert bundled_ontology() in kb.sources()
        assert len(kb.sources()) == 2
        assert [local_name(row.place) for row in kb.ask("storage_place", item="CowsMilk")] == ["Refrigerator"]


# -- changed sources ---------------------------------------------------------------------------------------------------


def test_a_changed_source_is_read_again_and_reported(small: tuple[Path, Path]) -> None:
    folder, map = small
    map.write_text(room_map(body_turtle("cup"), body_turtle("jug")), encoding="utf-8")
    with reopened(folder) as kb:
        assert [each.id for each in kb.world().bodies] == ["cup", "jug"]
        (finding,) = changes(kb)
        assert (finding.individual, finding.action) == (str(map), "it is reloaded")
        assert kb.sources() == (map,), "what it imports no more is gone"
        assert not kb.sparql("ASK { <e:Word> ?p ?o }").boolean
    with reopened(folder) as kb:
        assert not changes(kb), "once"
        assert len(kb.world().bodies) == 2


def test_a_changed_ontology_is_read_again(small: tuple[Path, Path]) -> None:
    folder, map = small
    map.with_name("words.ttl").write_text("<e:Other> a <http://www.w3.org/2002/07/owl#Class> .", encoding="utf-8")
    with reopened(folder) as kb:
        assert kb.sparql("ASK { <e:Other> a owl:Class }").boolean
        assert not kb.sparql("ASK { <e:Word> a owl:Class }").boolean
        assert len(kb.sources()) == 2


def test_a_source_with_a_new_time_only_is_unchanged(small: tuple[Path, Path]) -> None:
    folder, map = small
    os.utime(map, (1, 1))
    with reopened(folder) as kb:
        assert not changes(kb)


def test_a_deleted_source_stays_loaded(small: tuple[Path, Path]) -> None:
    folder, map = small
    map.unlink()
    with reopened(folder) as kb:
        assert [each.id for each in kb.world().bodies] == ["cup"]
        assert not kb.findings()


def test_an_unreadable_changed_source_stays_as_it_was_and_is_reported(small: tuple[Path, Path]) -> None:
    folder, map = small
    map.write_text("@prefix : <", encoding="utf-8")
    with reopened(folder) as kb:
        assert [each.id for each in kb.world().bodies] == ["cup"]
        (finding,) = changes(kb)
        assert "cannot read" in finding.problem
        assert finding.action == "the stored version is used"


def test_a_failed_load_leaves_the_folder_unchanged(small: tuple[Path, Path], tmp_path: Path) -> None:
    folder, _ = small
    before = (folder / "mindstage.json").read_bytes()
    (tmp_path / "bad.ttl").write_text("@prefix : <", encoding="utf-8")
    with reopened(folder) as kb, pytest.raises(SourceParseError):
        kb.load(tmp_path / "bad.ttl")
    assert (folder / "mindstage.json").read_bytes() == before
    with reopened(folder) as kb:
        assert kb.maps() == (individual("room"),)


def test_a_failed_bulk_load_leaves_nothing_behind(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mindstage.knowledge.store._MIN_BULK_SIZE", 0)
    (tmp_path / "bad.ttl").write_text("<e:a> <e:b> <e:c> .\n" * 100 + "<e:a> <", encoding="utf-8")
    (tmp_path / "good.ttl").write_text("<e:d> <e:b> <e:c> .", encoding="utf-8")
    with reopened(folder) as kb:
        kb.load((), ontologies=tmp_path / "good.ttl")
        with pytest.raises(SourceParseError):
            kb.load((), ontologies=tmp_path / "bad.ttl")
        assert len(kb.sparql("SELECT ?s { ?s <e:b> ?o }").rows) == 1


# -- invalid folders ---------------------------------------------------------------------------------------------------


def test_a_folder_with_other_files_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(StoreError, match="there are other files in it; name a new folder"):
        reopened(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_a_file_in_place_of_the_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(StoreError, match=r"mine\.txt cannot be used: a file is in its place; name a new"):
        reopened(tmp_path / "mine.txt")


def test_a_folder_of_a_newer_format_is_refused(folder: Path) -> None:
    (folder / "mindstage.json").write_text('{"format_version": 99, "feelings": []}')
    with pytest.raises(
        StoreError, match="it has format version 99, and this version of Mindstage reads 3; use a newer Mindstage"
    ):
        reopened(folder)


@pytest.mark.parametrize("text", ["", "{", "[]", '{"format_version": 3, "sources": [{"path": 3}]}'])
def test_a_damaged_manifest_is_reported(text: str, folder: Path) -> None:
    (folder / "mindstage.json").write_text(text)
    with pytest.raises(StoreError, match=r"mindstage\.json: .*; delete the folder and load the sources"):
        reopened(folder)


def test_damaged_triples_are_reported(folder: Path) -> None:
    (folder / "triples" / "CURRENT").write_text("nonsense")
    with pytest.raises(StoreError, match="cannot be used"):
        reopened(folder)


def test_a_missing_text_is_reported_when_it_is_needed(folder: Path) -> None:
    shutil.rmtree(folder / "texts")
    with reopened(folder) as kb:
        assert kb.ask("storage_place", item="CowsMilk")
        with pytest.raises(StoreError, match="No such file"):
            kb.world()


def test_a_folder_used_by_another_process_is_refused(folder: Path) -> None:
    with reopened(folder):
        script = f"from mindstage.knowledge import KnowledgeBase; KnowledgeBase(store={str(folder)!r})"
        command = [sys.executable, "-c", script]
        done = subprocess.run(command, stderr=subprocess.PIPE, text=True, timeout=120, check=False)
    assert "another process holds it; wait until that has ended" in done.stderr.splitlines()[-1]
    reopened(folder).close()


def test_a_folder_is_marked_incomplete_if_the_process_dies_while_loading(folder: Path, tmp_path: Path) -> None:
    map = tmp_path / "room.ttl"
    map.write_text(room_map(body_turtle("cup")), encoding="utf-8")
    script = f"""
import time
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.store import OxigraphStore
def stop(*_, **__):
    print("filling", flush=True)
    time.sleep(600)
OxigraphStore.load = stop
KnowledgeBase(store={str(folder)!r}).load({str(map)!r})
"""
    process = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "filling\n"
        with pytest.raises(StoreError, match="another process holds it"):
            reopened(folder)
        process.send_signal(signal.SIGKILL)
        process.wait(60)
    finally:
        process.kill()
        process.communicate()
    with pytest.raises(StoreError, match="it is half-written: a process died while filling it; delete the folder"):
        reopened(folder)


def test_an_assertion_survives_the_death_of_the_process(folder: Path) -> None:
    script = f"""
import os
from mindstage.knowledge import KnowledgeBase
KnowledgeBase(store={str(folder)!r}).tell("Cupboard", {CONTAINER_FOR!r}, "Robot")
os.kill(os.getpid(), 9)
"""
    subprocess.run([sys.executable, "-c", script], timeout=120, check=False)
    with reopened(folder) as kb:
        assert kb.ask("storage_place", item="Robot")


def test_a_read_only_folder_answers_but_refuses_changes(
    small: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, map = small
    monkeypatch.setattr(os, "access", lambda *_: False)  # root may write everywhere
    before = sorted((path, path.stat().st_mtime_ns) for path in folder.rglob("*"))
    map.write_text(room_map(body_turtle("cup"), body_turtle("jug")), encoding="utf-8")
    with reopened(folder) as kb:
        assert [each.id for each in kb.world().bodies] == ["cup"]
        assert changes(kb)[0].action == "the stored version is used: the folder is read-only"
        assert kb.sparql("ASK { ?map a knowrob:SemanticEnvironmentMap }").boolean
        kb.load(map)
        with pytest.raises(StoreError, match="it is read-only; copy it, and use the copy"):
            kb.tell("ms:shed", "type", "Cup")
        with pytest.raises(StoreError, match="it is read-only"):
            kb.load(bundled_kitchen())
    assert sorted((path, path.stat().st_mtime_ns) for path in folder.rglob("*")) == before


def test_a_folder_and_an_endpoint_exclude_each_other(tmp_path: Path) -> None:
    with pytest.raises(InvalidArgumentError, match="it is kept in a folder or at an endpoint, not in both"):
        KnowledgeBase(store=tmp_path / "store", endpoint="http://localhost:7878/query")


def test_closing_twice_is_harmless_and_later_questions_are_refused(folder: Path) -> None:
    kb = reopened(folder)
    kb.close()
    kb.close()
    with pytest.raises(StoreError, match="it is closed; open it again"):
        kb.ask("maps")
    with pytest.raises(StoreError, match="it is closed"):
        kb.tell("Cupboard", CONTAINER_FOR, "Robot")


def changes(kb: KnowledgeBase) -> list[Finding]:
    return [finding for finding in kb.findings() if "changed since it was stored" in finding.problem]
