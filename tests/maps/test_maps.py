"""Which maps there are, how they stay apart, and what is counted in them."""

from __future__ import annotations

from pathlib import Path

import pytest

from mindstage.errors import AmbiguousMapError, MapNotFoundError
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import MapStatistics
from tests.cases import each_case
from tests.maps.small_maps import KNOWROB, body_turtle, individual, knowledge_base_from, room_map, slide_joint

THESIS = {"classes": 64, "individuals": 136, "objects": 114, "constraints": 22, "relations": 55}


def write(tmp_path: Path, name: str, text: str) -> Path:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def in_map(text: str, map: str, namespace: str = "") -> str:
    told = text.replace("describedInMap :room", f"describedInMap :{map}").replace(":room a", f":{map} a")
    return told.replace("<http://example.org/room.owl#>", f"<{namespace}>") if namespace else told


# -- which -------------------------------------------------------------------------------------------------------------


def test_without_any_map_the_files_are_named(tmp_path: Path) -> None:
    path = write(tmp_path, "no.ttl", "<http://e#a> <http://e#b> <http://e#c> .")
    with pytest.raises(MapNotFoundError, match=str(path)):
        knowledge_base_from(path).world()
    with pytest.raises(MapNotFoundError, match=str(path)):
        knowledge_base_from(path).map_statistics("kitchen")
    with pytest.raises(MapNotFoundError):
        KnowledgeBase().world()


def test_a_map_of_another_name_is_missing(tmp_path: Path) -> None:
    path = write(tmp_path, "map.ttl", room_map())
    with pytest.raises(MapNotFoundError, match=r"'kitchen'.*room\.owl#room"):
        knowledge_base_from(path).world("kitchen")


def test_of_several_maps_one_must_be_named(tmp_path: Path) -> None:
    path = write(tmp_path, "maps.ttl", room_map(body_turtle("cup"), ":other a k:SemanticEnvironmentMap ."))
    knowledge = knowledge_base_from(path)
    assert knowledge.maps() == (individual("room"), individual("other"))
    with pytest.raises(AmbiguousMapError, match=r"room.*other"):
        knowledge.world()
    assert [len(knowledge.world(name).bodies) for name in ("room", individual("other"))] == [1, 0]


def test_two_maps_of_one_local_name_are_told_apart_by_their_iris(tmp_path: Path) -> None:
    first = write(tmp_path, "first.ttl", room_map(body_turtle("a")))
    second = write(tmp_path, "second.ttl", in_map(room_map(body_turtle("b")), "room", "http://elsewhere.org/room.owl#"))
    knowledge = knowledge_base_from(first, second)
    with pytest.raises(AmbiguousMapError):
        knowledge.world("room")
    assert [thing.id for thing in knowledge.world("http://elsewhere.org/room.owl#room").bodies] == ["b"]


# -- apart -------------------------------------------------------------------------------------------------------------


def test_two_maps_in_one_file_have_their_own_individuals(tmp_path: Path) -> None:
    other = in_map(body_turtle("mug", "e:near :cup"), "other")
    text = room_map(body_turtle("cup"), ":other a k:SemanticEnvironmentMap .", other, "k:Cup a owl:Class .")
    knowledge = knowledge_base_from(write(tmp_path, "maps.ttl", text))
    here, there = knowledge.world("room"), knowledge.world("other")
    assert [thing.id for thing in here.bodies] == ["cup"]
    assert [thing.id for thing in there.bodies] == ["mug"]
    # What belongs to neither belongs to both; the parts of the other one's individuals are the other one's.
    assert [resource.iri for resource in here.resources] == [resource.iri for resource in there.resources]
    assert [resource.iri for resource in here.resources] == [KNOWROB + "Cup"]


def test_two_files_may_tell_of_the_same_individuals_in_two_maps(tmp_path: Path) -> None:
    # This is what loggers do: names of things stay, the map gets a new one, and everything may have moved.
    size = "k:Cup rdfs:subClassOf [ owl:onProperty k:{}OfObject ; owl:hasValue {} ] ."
    sizes = [[size.format(axis, extent) for axis in ("depth", "width", "height")] for extent in (1, 2)]
    first = write(tmp_path, "first.ttl", in_map(room_map(body_turtle("cup", position="1 0 0"), *sizes[0]), "first"))
    second = write(tmp_path, "second.ttl", in_map(room_map(body_turtle("cup", position="2 0 0"), *sizes[1]), "second"))
    knowledge = knowledge_base_from(first, second)
    for map, extent in (("first", 1.0), ("second", 2.0)):
        (cup,) = knowledge.world(map).bodies
        assert cup.pose.position == (extent, 0.0, 0.0)
        assert cup.size == (extent, extent, extent)
    assert knowledge.findings() == ()


def test_labels_of_two_files_are_two_things(tmp_path: Path) -> None:
    shared = ':cup e:near _:x ; e:on _:x . _:x e:is "{}" .'
    first = write(tmp_path, "first.ttl", in_map(room_map(body_turtle("cup"), shared.format("one")), "first"))
    second = write(tmp_path, "second.ttl", in_map(room_map(body_turtle("cup"), shared.format("two")), "second"))
    knowledge = knowledge_base_from(first, second)
    assert [str(knowledge.world(map).resources).count("_:") for map in ("first", "second")] == [1, 1]
    assert knowledge.world("first").resources[0].iri != knowledge.world("second").resources[0].iri


def test_a_file_that_tells_of_no_map_adds_to_all(tmp_path: Path) -> None:
    map = write(tmp_path, "map.ttl", room_map(body_turtle("cup")))
    more = write(
        tmp_path, "more.ttl", f'<{individual("cup")}> <http://e#owner> "Jo" . <http://e#Jo> <http://e#age> 7 .'
    )
    world = knowledge_base_from(map, more).world()
    assert [fact.property for fact in world.bodies[0].facts] == ["http://e#owner"]
    assert [resource.iri for resource in world.resources] == ["http://e#Jo"]
    # As an ontology it is only background.
    assert knowledge_base_from(map, ontologies=(more,)).world() == knowledge_base_from(map).world()


def test_one_path_needs_no_list(tmp_path: Path) -> None:
    path = write(tmp_path, "map.ttl", room_map(body_turtle("cup")))
    for given in (path, str(path)):
        knowledge = KnowledgeBase(bundled_ontology=False)
        knowledge.load(given, ontologies=given)
        assert knowledge.maps() == (individual("room"),)


def test_the_same_file_twice_is_one(tmp_path: Path) -> None:
    path = write(tmp_path, "map.ttl", room_map(body_turtle("cup"), "k:Cup rdfs:subClassOf [ e:a 1 ] ."))
    knowledge = knowledge_base_from(path, path)
    once = knowledge_base_from(path).world()
    assert knowledge.world() == once
    knowledge.load([path])
    assert knowledge.world() == once


def test_an_ontology_that_is_then_asked_for_as_a_map_is_one(tmp_path: Path) -> None:
    path = write(tmp_path, "extra.ttl", "<http://e#Jo> <http://e#age> 7 .")
    knowledge = knowledge_base_from(write(tmp_path, "map.ttl", room_map()), ontologies=(path,))
    assert knowledge.world().resources == ()
    knowledge.load([path])
    assert [resource.iri for resource in knowledge.world().resources] == ["http://e#Jo"]


def test_reading_again_gives_the_same_world_and_no_more_findings(tmp_path: Path) -> None:
    path = write(
        tmp_path, "map.ttl", room_map(body_turtle("cup", position="none"), "[] e:a [ e:b _:c ] . _:c e:d _:c .")
    )
    knowledge = knowledge_base_from(path)
    first, findings = knowledge.world(), knowledge.findings()
    assert knowledge.world() == first == knowledge_base_from(path).world()
    assert knowledge.findings() == findings == (knowing_findings(path))


def knowing_findings(path: Path) -> object:
    knowledge = knowledge_base_from(path)
    knowledge.world()
    return knowledge.findings()


# -- counted -----------------------------------------------------------------------------------------------------------


@each_case("name", ["original", "spawned"])
@each_case("with_ontologies", [True, False])
@each_case("bundled", [True, False])
def test_the_table_of_the_thesis(name: str, with_ontologies: bool, bundled: bool, shared_data: Path) -> None:
    map = shared_data / "maps" / f"iai-kitchen-{name}.owl"
    ontologies = (shared_data / "ontology",) if with_ontologies else ()
    knowledge = knowledge_base_from(map, ontologies=ontologies, bundled_ontology=bundled)
    assert knowledge.map_statistics() == MapStatistics(map=knowledge.maps()[0], **THESIS)
    world = knowledge.world()
    assert (len(world.bodies), len(world.joints), len(world.attachments)) == (114, 22, 33)
    assert all(thing.size for thing in world.bodies)


def test_both_maps_of_the_thesis_stay_apart(shared_data: Path) -> None:
    paths = [shared_data / "maps" / f"iai-kitchen-{name}.owl" for name in ("original", "spawned")]
    knowledge = knowledge_base_from(*paths)
    for path, map in zip(paths, knowledge.maps(), strict=True):
        assert knowledge.world(map) == knowledge_base_from(path).world()


def test_what_was_left_out_still_counts(tmp_path: Path) -> None:
    text = room_map(
        body_turtle("a", position="none"),
        body_turtle("b", "k:parent :a"),
        slide_joint("slide", "a", "b"),
        body_turtle("c", cls="k:Mug"),
    )
    analysis = knowledge_base_from(write(tmp_path, "map.ttl", text)).map_statistics()
    assert analysis == MapStatistics(
        map=individual("room"), classes=3, individuals=4, objects=3, constraints=1, relations=1
    )


def test_subclasses_of_constraint_are_constraints(tmp_path: Path) -> None:
    text = room_map(body_turtle("hinge", cls="e:Hinge"), "e:Hinge rdfs:subClassOf k:Constraint .")
    analysis = knowledge_base_from(write(tmp_path, "map.ttl", text)).map_statistics()
    assert (analysis.objects, analysis.constraints) == (0, 1)


def test_parts_that_are_described_in_the_map_are_no_individuals(tmp_path: Path) -> None:
    text = room_map(body_turtle("cup"), ":cup-pose k:describedInMap :room .")
    knowledge = knowledge_base_from(write(tmp_path, "map.ttl", text))
    assert knowledge.map_statistics().individuals == 1
    assert [thing.id for thing in knowledge.world().bodies] == ["cup"]


@pytest.mark.parametrize("name", ["ameva-task-two", "knowrob1-ccrl"])
def test_maps_of_other_dialects_do_no_harm(name: str, shared_data: Path) -> None:
    knowledge = knowledge_base_from(shared_data / "maps" / f"{name}.owl")
    assert knowledge.world().iri == knowledge.map_statistics().map


def test_a_map_without_map_is_missing(shared_data: Path) -> None:
    with pytest.raises(MapNotFoundError):
        knowledge_base_from(shared_data / "ontology" / "knowrob_common" / "owl" / "knowrob.owl").world()
