"""The cache of worlds: another process gets the same world, findings and assumptions, never those of other files."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from mindstage.knowledge import KnowledgeBase, world_cache
from mindstage.knowledge.world_cache import WorldCache, WorldReading
from mindstage.maps import bundled_kitchen
from mindstage.maps.dialects import detection
from mindstage.maps.dialects.conventions import Handedness, LengthUnit, UnitConventions
from mindstage.rdf.graphs import Finding, Severity
from mindstage.scene import Body, BodyId, Iri, Pose, World

MAP = """<?xml version="1.0"?>
<rdf:RDF xmlns="http://test.org/m.owl#" xml:base="http://test.org/m.owl" xmlns:owl="http://www.w3.org/2002/07/owl#"
  xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#" xmlns:knowrob="http://knowrob.org/kb/knowrob.owl#">
  <owl:NamedIndividual rdf:about="#m"><rdf:type rdf:resource="http://knowrob.org/kb/knowrob.owl#SemanticEnvironmentMap"/></owl:NamedIndividual>
  <owl:NamedIndividual rdf:about="#cup">
    <rdf:type rdf:resource="http://knowrob.org/kb/knowrob.owl#Cup"/>
    <knowrob:describedInMap rdf:resource="#m"/>
    <knowrob:pose rdf:resource="#pose"/>
    <knowrob:depthOfObject>wide</knowrob:depthOfObject>
  </owl:NamedIndividual>
  <owl:NamedIndividual rdf:about="#pose">
    <rdf:type rdf:resource="http://knowrob.org/kb/knowrob.owl#Pose"/>
    <knowrob:translation>1.0 2.0 0.5</knowrob:translation>
    <knowrob:quaternion>1.0 0.0 0.0 0.0</knowrob:quaternion>
  </owl:NamedIndividual>
</rdf:RDF>
"""

Open = Callable[..., KnowledgeBase]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "worlds"
    made.mkdir()
    return made


@pytest.fixture
def reads(monkeypatch: pytest.MonkeyPatch) -> list[Iri]:
    """The maps that were read, and not taken from the cache."""
    done: list[Iri] = []
    read = detection.read_world

    def counting(source_map: detection.SourceMap) -> World:
        done.append(source_map.map)
        return read(source_map)

    monkeypatch.setattr(detection, "read_world", counting)
    return done


@pytest.fixture
def open_map(tmp_path: Path, folder: Path) -> Open:
    def make(text: str = MAP, **options: object) -> KnowledgeBase:
        path = tmp_path / "m.owl"
        path.write_text(text, encoding="utf-8")
        knowledge = KnowledgeBase(bundled_ontology=False)
        knowledge.load(path, **options)  # type: ignore[arg-type]
        knowledge.use_world_cache(folder)
        return knowledge

    return make


def test_a_second_process_gets_the_same_world_without_reading_the_map(open_map: Open, reads: list[Iri]) -> None:
    first, second = open_map(), open_map()
    world = first.world()
    assert [body.id for body in world.bodies] == ["cup"]
    assert second.world() == world
    assert len(reads) == 1
    assert first.findings()  # about the depth, which is no number
    assert first.assumptions()
    assert second.findings() == first.findings()
    assert second.assumptions() == first.assumptions()


def test_the_bundled_kitchen_is_the_same_from_the_cache(folder: Path, reads: list[Iri]) -> None:
    worlds, assumptions = [], []
    for _ in range(2):
        knowledge = KnowledgeBase()
        knowledge.load(bundled_kitchen())
        knowledge.use_world_cache(folder)
        worlds.append(knowledge.world())
        assumptions.append(knowledge.assumptions())
    plain = KnowledgeBase()
    plain.load(bundled_kitchen())
    assert worlds[0] == worlds[1] == plain.world()
    assert assumptions[0] == assumptions[1] == plain.assumptions()
    assert len(reads) == 2


def test_a_changed_map_is_read_again(open_map: Open, reads: list[Iri]) -> None:
    assert open_map().world().body("cup").pose.position == (1.0, 2.0, 0.5)
    assert open_map(MAP.replace("1.0 2.0 0.5", "1.0 2.0 0.7")).world().body("cup").pose.position == (1.0, 2.0, 0.7)
    assert len(reads) == 2


def test_other_conventions_are_another_world(open_map: Open, reads: list[Iri]) -> None:
    assert open_map().world().body("cup").pose.position == (1.0, 2.0, 0.5)
    in_cm = open_map(conventions=UnitConventions(units=LengthUnit.CENTIMETERS, frame=Handedness.ROS))
    assert in_cm.world().body("cup").pose.position == pytest.approx((0.01, 0.02, 0.005))
    assert len(reads) == 2


def test_another_ontology_is_another_world(open_map: Open, reads: list[Iri], tmp_path: Path) -> None:
    ontology = tmp_path / "sizes.ttl"
    text = "@prefix knowrob: <http://knowrob.org/kb/knowrob.owl#> . knowrob:Mug a knowrob:Thing ."
    open_map().world()
    for extra in ("", " knowrob:Cup a knowrob:Thing ."):
        ontology.write_text(text + extra, encoding="utf-8")
        open_map(ontologies=ontology).world()
    assert len(reads) == 3


@pytest.mark.parametrize(
    "change",
    [
        lambda kb: kb.tell("http://test.org/m.owl#Mug", "subClassOf", "http://knowrob.org/kb/knowrob.owl#Cup"),
        lambda kb: kb.retract("http://test.org/m.owl#cup", "type", "http://knowrob.org/kb/knowrob.owl#Cup"),
    ],
    ids=["tell", "retract"],
)
def test_after_a_change_of_the_statements_the_map_is_read(
    open_map: Open, reads: list[Iri], change: Callable[[KnowledgeBase], object]
) -> None:
    open_map().world()
    changed = open_map()
    change(changed)
    changed.world()
    assert len(reads) == 2


def test_bounds_of_meshes_are_not_cached(open_map: Open, reads: list[Iri]) -> None:
    open_map().world()
    knowledge = open_map()
    knowledge.use_meshes(lambda meshes: [None for _ in meshes])
    knowledge.world()
    assert len(reads) == 2


@pytest.mark.parametrize("at", [0, 20, -1])
def test_a_damaged_entry_is_replaced(open_map: Open, reads: list[Iri], folder: Path, at: int) -> None:
    world = open_map().world()
    (entry,) = folder.iterdir()
    whole = entry.read_bytes()
    damaged = bytearray(whole)
    damaged[at] ^= 1
    for content in (bytes(damaged), whole[: len(whole) // 2], b""):
        entry.write_bytes(content)
        assert open_map().world() == world
        assert entry.read_bytes() == whole
    assert len(reads) == 4


def test_a_folder_that_cannot_be_written_is_harmless(open_map: Open, reads: list[Iri], folder: Path) -> None:
    folder.rmdir()
    folder.write_text("a file is in its place")
    assert open_map().world() == open_map().world()
    assert len(reads) == 2


def test_worlds_with_labels_of_blank_nodes_are_not_kept(open_map: Open, reads: list[Iri], folder: Path) -> None:
    unnamed = MAP.replace('rdf:about="#cup"', 'rdf:nodeID="cup"')
    for _ in range(2):
        (body,) = open_map(unnamed).world().bodies
        assert body.iri.startswith("_:")
    assert not list(folder.iterdir())
    assert len(reads) == 2


def test_a_changed_program_does_not_use_entries_of_the_old_one(
    open_map: Open, reads: list[Iri], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    open_map().world()
    source = Path(world_cache.__file__).parents[1]
    copy = tmp_path / "mindstage"
    shutil.copytree(source, copy, ignore=shutil.ignore_patterns("__pycache__", "bundled", "viewer"))
    os.utime(copy / "maps" / "dialects" / "semlog.py")
    monkeypatch.setattr(world_cache, "__file__", str(copy / "knowledge" / "world_cache.py"))
    world_cache._program.cache_clear()
    open_map().world()
    monkeypatch.undo()
    world_cache._program.cache_clear()
    assert len(reads) == 2


def test_the_least_recently_used_entries_are_deleted(folder: Path) -> None:
    body = Body(id=BodyId("cup"), iri=Iri("urn:cup"), cls=Iri("urn:Cup"), pose=Pose((0, 0, 0), (1, 0, 0, 0)))
    finding = Finding(Severity.WARNING, "urn:cup", "", "a problem", "an action")
    reading = WorldReading(world=World(iri=Iri("urn:m"), bodies=(body,)), findings=(finding,))
    assert WorldCache(folder).put(Iri("urn:m"), b"0", reading)
    (size,) = (entry.stat().st_size for entry in folder.iterdir())
    cache = WorldCache(folder, max_bytes=3 * size)
    for number in range(1, 5):
        for at, entry in enumerate(sorted(folder.iterdir(), key=lambda each: each.stat().st_mtime_ns)):
            os.utime(entry, (at, at))
        assert cache.get(Iri("urn:m"), b"0") == reading  # used, so not the oldest
        assert cache.put(Iri("urn:m"), str(number).encode(), reading)
        assert sum(entry.stat().st_size for entry in folder.iterdir()) <= 3 * size
    found = [number for number in range(5) if cache.get(Iri("urn:m"), str(number).encode())]
    assert len(found) == 3
    assert {0, 4} <= {*found}


def test_an_entry_above_the_limit_is_not_written(folder: Path) -> None:
    reading = WorldReading(world=World(iri=Iri("urn:m")))
    assert not WorldCache(folder, max_bytes=10).put(Iri("urn:m"), b"0", reading)
    assert not list(folder.iterdir())
