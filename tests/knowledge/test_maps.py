"""Which maps there are, how they stay apart, and what is counted in them."""

from __future__ import annotations

from pathlib import Path

import pytest

from mindstage.errors import MapAmbiguous, MapMissing
from mindstage.knowledge import Analysis, KnowledgeBase
from tests.knowledge.maps import KNOWROB, body, constraint, knowing, m, room

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
    with pytest.raises(MapMissing, match=str(path)):
        knowing(path).world()
    with pytest.raises(MapMissing, match=str(path)):
        knowing(path).analyse("kitchen")
    with pytest.raises(MapMissing):
        KnowledgeBase().world()


def test_a_map_of_another_name_is_missing(tmp_path: Path) -> None:
    path = write(tmp_path, "map.ttl", room())
    with pytest.raises(MapMissing, match=r"'kitchen'.*room\.owl#room"):
        knowing(path).world("kitchen")


def test_of_several_maps_one_must_be_named(tmp_path: Path) -> None:
    path = write(tmp_path, "maps.ttl", room(body("cup"), ":other a k:SemanticEnvironmentMap ."))
    knowledge = knowing(path)
    assert knowledge.maps() == (m("room"), m("other"))
    with pytest.raises(MapAmbiguous, match=r"room.*other"):
        knowledge.world()
    assert [len(knowledge.world(name).bodies) for name in ("room", m("other"))] == [1, 0]


def test_two_maps_of_one_local_name_are_told_apart_by_their_iris(tmp_path: Path) -> None:
    first = write(tmp_path, "first.ttl", room(body("a")))
    second = write(tmp_path, "second.ttl", in_map(room(body("b")), "room", "http://elsewhere.org/room.owl#"))
    knowledge = knowing(first, second)
    with pytest.raises(MapAmbiguous):
        knowledge.world("room")
    assert [thing.id for thing in knowledge.world("http://elsewhere.org/room.owl#room").bodies] == ["b"]


# -- apart -------------------------------------------------------------------------------------------------------------


def test_two_maps_in_one_file_have_their_own_individuals(tmp_path: Path) -> None:
    other = in_map(body("mug", "e:near :cup"), "other")
    text = room(body("cup"), ":other a k:SemanticEnvironmentMap .", other, "k:Cup a owl:Class .")
    knowledge = knowing(write(tmp_path, "maps.ttl", text))
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
    first = write(tmp_path, "first.ttl", in_map(room(body("cup", at="1 0 0"), *sizes[0]), "first"))
    second = write(tmp_path, "second.ttl", in_map(room(body("cup", at="2 0 0"), *sizes[1]), "second"))
    knowledge = knowing(first, second)
    for map, extent in (("first", 1.0), ("second", 2.0)):
        (cup,) = knowledge.world(map).bodies
        assert cup.pose.position == (extent, 0.0, 0.0)
        assert cup.size == (extent, extent, extent)
    assert knowledge.findings() == ()


def test_labels_of_two_files_are_two_things(tmp_path: Path) -> None:
    shared = ':cup e:near _:x ; e:on _:x . _:x e:is "{}" .'
    first = write(tmp_path, "first.ttl", in_map(room(body("cup"), shared.format("one")), "first"))
    second = write(tmp_path, "second.ttl", in_map(room(body("cup"), shared.format("two")), "second"))
    knowledge = knowing(first, second)
    assert [str(knowledge.world(map).resources).count("_:") for map in ("first", "second")] == [1, 1]
    assert knowledge.world("first").resources[0].iri != knowledge.world("second").resources[0].iri


def test_a_file_that_tells_of_no_map_adds_to_all(tmp_path: Path) -> None:
    map = write(tmp_path, "map.ttl", room(body("cup")))
    more = write(tmp_path, "more.ttl", f'<{m("cup")}> <http://e#owner> "Jo" . <http://e#Jo> <http://e#age> 7 .')
    world = knowing(map, more).world()
    assert [fact.property for fact in world.bodies[0].facts] == ["http://e#owner"]
    assert [resource.iri for resource in world.resources] == ["http://e#Jo"]
    # As an ontology it is only background.
    assert knowing(map, ontologies=(more,)).world() == knowing(map).world()


def test_one_path_needs_no_list(tmp_path: Path) -> None:
    path = write(tmp_path, "map.ttl", room(body("cup")))
    for given in (path, str(path)):
        knowledge = KnowledgeBase(bundled_ontology=False)
        knowledge.load(given, ontologies=given)
        assert knowledge.maps() == (m("room"),)


def test_the_same_file_twice_is_one(tmp_path: Path) -> None:
    path = write(tmp_path, "map.ttl", room(body("cup"), "k:Cup rdfs:subClassOf [ e:a 1 ] ."))
    knowledge = knowing(path, path)
    once = knowing(path).world()
    assert knowledge.world() == once
    knowledge.load([path])
    assert knowledge.world() == once


def test_an_ontology_that_is_then_asked_for_as_a_map_is_one(tmp_path: Path) -> None:
    path = write(tmp_path, "extra.ttl", "<http://e#Jo> <http://e#age> 7 .")
    knowledge = knowing(write(tmp_path, "map.ttl", room()), ontologies=(path,))
    assert knowledge.world().resources == ()
    knowledge.load([path])
    assert [resource.iri for resource in knowledge.world().resources] == ["http://e#Jo"]


def test_reading_again_gives_the_same_world_and_no_more_findings(tmp_path: Path) -> None:
    path = write(tmp_path, "map.ttl", room(body("cup", at="none"), "[] e:a [ e:b _:c ] . _:c e:d _:c ."))
    knowledge = knowing(path)
    first, findings = knowledge.world(), knowledge.findings()
    assert knowledge.world() == first == knowing(path).world()
    assert knowledge.findings() == findings == (knowing_findings(path))


def knowing_findings(path: Path) -> object:
    knowledge = knowing(path)
    knowledge.world()
    return knowledge.findings()


# -- counted -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["original", "spawned"])
@pytest.mark.parametrize("with_ontologies", [True, False])
@pytest.mark.parametrize("bundled", [True, False])
def test_the_table_of_the_thesis(name: str, with_ontologies: bool, bundled: bool, shared_data: Path) -> None:
    map = shared_data / "maps" / f"iai-kitchen-{name}.owl"
    ontologies = (shared_data / "ontology",) if with_ontologies else ()
    knowledge = knowing(map, ontologies=ontologies, bundled_ontology=bundled)
    assert knowledge.analyse() == Analysis(map=knowledge.maps()[0], **THESIS)
    world = knowledge.world()
    assert (len(world.bodies), len(world.constraints), len(world.attachments)) == (114, 22, 33)
    assert all(thing.size for thing in world.bodies)


def test_both_maps_of_the_thesis_stay_apart(shared_data: Path) -> None:
    paths = [shared_data / "maps" / f"iai-kitchen-{name}.owl" for name in ("original", "spawned")]
    knowledge = knowing(*paths)
    for path, map in zip(paths, knowledge.maps(), strict=True):
        assert knowledge.world(map) == knowing(path).world()


def test_what_was_left_out_still_counts(tmp_path: Path) -> None:
    text = room(body("a", at="none"), body("b", "k:parent :a"), constraint("slide", "a", "b"), body("c", cls="k:Mug"))
    analysis = knowing(write(tmp_path, "map.ttl", text)).analyse()
    assert analysis == Analysis(map=m("room"), classes=3, individuals=4, objects=3, constraints=1, relations=1)


def test_subclasses_of_constraint_are_constraints(tmp_path: Path) -> None:
    text = room(body("hinge", cls="e:Hinge"), "e:Hinge rdfs:subClassOf k:Constraint .")
    analysis = knowing(write(tmp_path, "map.ttl", text)).analyse()
    assert (analysis.objects, analysis.constraints) == (0, 1)


def test_parts_that_are_described_in_the_map_are_no_individuals(tmp_path: Path) -> None:
    text = room(body("cup"), ":cup-pose k:describedInMap :room .")
    knowledge = knowing(write(tmp_path, "map.ttl", text))
    assert knowledge.analyse().individuals == 1
    assert [thing.id for thing in knowledge.world().bodies] == ["cup"]


@pytest.mark.parametrize("name", ["ameva-task-two", "knowrob1-ccrl"])
def test_maps_of_other_dialects_do_no_harm(name: str, shared_data: Path) -> None:
    knowledge = knowing(shared_data / "maps" / f"{name}.owl")
    assert knowledge.world().iri == knowledge.analyse().map


def test_a_map_without_map_is_missing(shared_data: Path) -> None:
    with pytest.raises(MapMissing):
        knowing(shared_data / "ontology" / "knowrob_common" / "owl" / "knowrob.owl").world()
