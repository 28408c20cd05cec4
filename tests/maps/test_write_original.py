"""Writing in the dialect of the source: unchanged maps give the same statements, changed ones the changed world."""

from __future__ import annotations

from pathlib import Path

import pyoxigraph as ox
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from mindstage.knowledge import KnowledgeBase
from mindstage.maps import (
    Handedness,
    LengthUnit,
    MapDialect,
    MapFormat,
    UnitConventions,
    lost_statements,
    save_map,
    write_map,
)
from mindstage.scene import Attachment, Body, BodyId, BodyPhysics, Iri, Mobility, Pose, World, diff
from tests.maps.dialect_maps import knowrob1_map, perception, soma_map
from tests.maps.small_maps import KNOWROB, assert_worlds_equal, body_turtle, knowledge_base_from, room_map, slide_joint
from tests.maps.small_urdf import KITCHEN_URDF
from tests.maps.test_ameva import fridge
from tests.maps.test_arbitrary_maps import mutated_maps, normalized
from tests.worlds import worlds

MS = "http://mindstage.org/ontology#"
SAMPLES = {
    "ameva-task-two": "AMEVA",
    "iai-kitchen-original": "SemLog",
    "knowrob1-ccrl": "KnowRob 1",
    "soma-iai-room": "SOMA",
}
SUFFIXES = {MapFormat.RDF_XML: ".owl", MapFormat.TURTLE: ".ttl"}
ELSEWHERE = Pose((1.23456789012345, -0.7, 1e-3), (0.5, -0.5, 0.5, 0.5))
each_sample = pytest.mark.parametrize("name", SAMPLES)

DRAWER = """:box a soma:Cupboard ; soma:hasLocalization [ soma:hasSpaceRegion [ k:translation "0 0 1" ;
    k:quaternion "0 0 0 1" ] ] ; dul:hasComponent :cup ; urdf:hasJoint [ a urdf:PrismaticJoint ;
    urdf:hasChildLink :drawer ; urdf:hasJointLimits [ urdf:hasLowerLimit 0.1 ; urdf:hasUpperLimit 0.5 ] ] .
:drawer a soma:Drawer ; soma:hasLocalization [ soma:hasSpaceRegion [ k:translation "0.2 0 1" ;
    k:quaternion "0 0 0 1" ] ] ; soma:hasShape [ dul:hasRegion [ soma:hasDepth 0.5 ; soma:hasWidth 0.4 ;
    soma:hasHeight 0.1 ] ] .
:cup a soma:Cup ; k:mobility "dynamic" ; soma:hasLocalization [ soma:hasSpaceRegion [ k:translation "0 0 2" ;
    k:quaternion "0 0 0 1" ] ] ."""
HINGE = """:case a k:Cupboard ; k:describedInMap :old ; k:properPhysicalParts :door, :hinge ; k:widthOfObject -0.5 .
:door a k:Door ; k:properPhysicalParts :handle . :handle a k:Handle .
:hinge a k:HingedJoint ; k:minJointValue "0.1" ; k:maxJointValue "1.5" ; k:connectedTo-Rigidly :door, :case ."""
EARLY = room_map(
    body_turtle("table", 'k:tagsData "SemLog;Id,table;Mobility,Static;Mass,3.5;"'),
    body_turtle("door", 'k:tagsData "SemLog;Id,door;Mobility,Dynamic;Gravity,True;"'),
    slide_joint("slide", "table", "door").replace("k:describedInMap :room ;", ""),
)
SMALL = {
    "AMEVA": fridge(),
    "KnowRob 1": knowrob1_map(
        HINGE,
        *(perception(name, "5", n, 0, 1) for n, name in enumerate(("case", "door", "handle"))),
        perception("door", "9", 0.9, 0.1, 1),
    ),
    "SOMA": soma_map(DRAWER),
    "SemLog, early": EARLY,
    "SemLog": room_map(
        body_turtle("table"), body_turtle("cup"), slide_joint("slide", "table", "cup"), ":table k:child :cup ."
    ),
}
each_dialect = pytest.mark.parametrize("dialect", SMALL)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of files that Hypothesis writes, which may overwrite one another."""
    return tmp_path_factory.mktemp("own")


def small(dialect: str, folder: Path) -> KnowledgeBase:
    path = folder / "map.ttl"
    path.write_text(SMALL[dialect], encoding="utf-8")
    knowledge = knowledge_base_from(path)
    assert knowledge.source_view().dialect == dialect
    return knowledge


def returned(world: World, knowledge: KnowledgeBase, folder: Path, format: MapFormat) -> KnowledgeBase:
    path = folder / f"back{SUFFIXES[format]}"
    save_map(world, path, source_view=knowledge.source_view(world.iri))
    return knowledge_base_from(path)


def predicates(path: Path) -> set[str]:
    return {quad.predicate.value for quad in ox.parse(path=path)}


# -- unchanged worlds --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("format", MapFormat)
@each_sample
def test_a_map_is_written_with_the_same_statements(
    name: str, format: MapFormat, shared_data: Path, tmp_path: Path
) -> None:
    knowledge = knowledge_base_from(shared_data / "maps" / f"{name}.owl", bundled_ontology=True)
    world, origin = knowledge.world(), knowledge.source_view()
    assert origin.dialect == SAMPLES[name]
    back = returned(world, knowledge, tmp_path, format)
    assert back.source_view().dialect == origin.dialect
    assert_worlds_equal(world, back.world())
    assert lost_statements(origin, back.source_view()) == ()
    assert lost_statements(back.source_view(), origin) == ()


@each_dialect
def test_a_small_map_is_written_with_the_same_statements(dialect: str, tmp_path: Path) -> None:
    knowledge = small(dialect, tmp_path)
    back = returned(knowledge.world(), knowledge, tmp_path, MapFormat.RDF_XML)
    assert back.source_view().dialect == dialect
    assert_worlds_equal(knowledge.world(), back.world())
    assert lost_statements(knowledge.source_view(), back.source_view()) == ()
    assert lost_statements(back.source_view(), knowledge.source_view()) == ()


@pytest.mark.parametrize("dialect", MapDialect)
def test_duplicate_values_are_kept(dialect: MapDialect, tmp_path: Path) -> None:
    """Also if one of the two has a notation that Mindstage does not write."""
    for first, second in (("e:truth", "xsd:boolean"), ("xsd:boolean", "e:truth")):
        cup = body_turtle(
            "cup", f'k:gravity "true"^^{first}, "true"^^{second}', 'k:mass "0.50"^^xsd:float, "0.5"^^e:kg'
        )
        (tmp_path / "map.ttl").write_text(room_map(cup), encoding="utf-8")
        knowledge = knowledge_base_from(tmp_path / "map.ttl")
        save_map(knowledge.world(), tmp_path / "back.ttl", dialect=dialect)
        back = knowledge_base_from(tmp_path / "back.ttl")
        assert_worlds_equal(knowledge.world(), back.world())
        assert lost_statements(knowledge.source_view(), back.source_view()) == ()


def test_numbers_keep_their_digits(tmp_path: Path) -> None:
    save_map(
        small("AMEVA", tmp_path).world(), tmp_path / "back.ttl", source_view=small("AMEVA", tmp_path).source_view()
    )
    text = (tmp_path / "back.ttl").read_text(encoding="utf-8")
    assert '"126.0 172.0 97.0"' in text
    assert MS not in text


@each_sample
def test_from_dialect_to_dialect_and_back(name: str, shared_data: Path, tmp_path: Path) -> None:
    knowledge = knowledge_base_from(shared_data / "maps" / f"{name}.owl")
    world, origin = knowledge.world(), knowledge.source_view()
    for number, dialect in enumerate((MapDialect.SOMA, MapDialect.SEMLOG, MapDialect.SOMA)):
        path = tmp_path / f"{number}.ttl"
        save_map(knowledge.world(world.iri), path, dialect=dialect)
        knowledge = knowledge_base_from(path)
        assert_worlds_equal(world, knowledge.world(world.iri))
        assert lost_statements(origin, knowledge.source_view()) == ()


@settings(max_examples=30)
@given(world=worlds(labels=True))
def test_any_world_survives_a_round_trip(world: World, folder: Path) -> None:
    path = folder / "any.ttl"
    path.write_text(write_map(world, format=MapFormat.TURTLE), encoding="utf-8")
    knowledge = knowledge_base_from(path)
    back = returned(knowledge.world(world.iri), knowledge, folder, MapFormat.TURTLE)
    assert_worlds_equal(knowledge.world(world.iri), back.world(world.iri))
    assert lost_statements(knowledge.source_view(world.iri), back.source_view(world.iri)) == ()


@settings(max_examples=30)
@given(quads=mutated_maps())
def test_any_statements_survive_a_round_trip(quads: list[ox.Quad], folder: Path) -> None:
    path = folder / "incomplete.ttl"
    ox.serialize(quads, path, ox.RdfFormat.TURTLE)
    knowledge = knowledge_base_from(path)
    for map in knowledge.maps():
        back = returned(knowledge.world(map), knowledge, folder, MapFormat.TURTLE)
        assert normalized(back.world(map)) == normalized(knowledge.world(map))
        assert lost_statements(knowledge.source_view(map), back.source_view(map)) == ()


@settings(max_examples=40)
@given(data=st.data(), dialect=st.sampled_from(sorted(SMALL)))
def test_incomplete_maps_survive_a_round_trip(data: st.DataObject, dialect: str, folder: Path) -> None:
    quads = list(ox.parse(SMALL[dialect], ox.RdfFormat.TURTLE))
    away = data.draw(st.sets(st.integers(0, len(quads) - 1), max_size=8))
    path = folder / "cut.ttl"
    ox.serialize([quad for at, quad in enumerate(quads) if at not in away], path, ox.RdfFormat.TURTLE)
    knowledge = knowledge_base_from(path)
    for map in knowledge.maps():
        back = returned(knowledge.world(map), knowledge, folder, MapFormat.TURTLE)
        assert_worlds_equal(knowledge.world(map), back.world(map))
        assert lost_statements(knowledge.source_view(map), back.source_view(map)) == ()


# -- changed worlds ----------------------------------------------------------------------------------------------------


def changed(world: World, what: str) -> World:
    first, *rest = world.bodies
    if what == "moved":
        return replace(world, bodies=(replace(first, pose=ELSEWHERE), *rest))
    if what == "let go":
        return replace(world, attachments=world.attachments[1:])
    if what == "made movable":
        physics = BodyPhysics(mobility=Mobility.KINEMATIC, mass_kg=7.25)
        return replace(world, bodies=(replace(first, physics=physics), *rest))
    new = Body(id=BodyId("new"), iri=Iri(f"{world.iri}-new"), cls=Iri(KNOWROB + "Cup"), pose=ELSEWHERE)
    attachment = Attachment(parent=first.id, child=new.id)
    return replace(world, bodies=(*world.bodies, new), attachments=(*world.attachments, attachment))


@pytest.mark.parametrize("what", ["moved", "let go", "made movable", "added"])
@each_dialect
def test_a_changed_world_survives_a_round_trip(what: str, dialect: str, tmp_path: Path) -> None:
    knowledge = small(dialect, tmp_path)
    world = changed(knowledge.world(), what)
    back = returned(world, knowledge, tmp_path, MapFormat.TURTLE).world()
    if dialect == "AMEVA":
        assert_same_in_si(world, back)
    else:
        assert_worlds_equal(world, back)


def assert_same_in_si(a: World, b: World) -> None:
    """Compares worlds without the original numbers, which differ after a change."""
    found = diff(a, b)
    assert {change.kind for change in found.changed} <= {"facts"}
    parts = ("#pose>", "#linearConstraint>", "#angularConstraint>")
    assert all(MS + "given" in str(line) or any(map(str(line).__contains__, parts)) for line in found.lost)
    assert all(MS + "given" in str(line) or any(map(str(line).__contains__, parts)) for line in found.gained)


@pytest.mark.parametrize("dialect", ["AMEVA", "KnowRob 1", "SOMA"])
def test_changed_poses_are_written_in_the_dialect(dialect: str, tmp_path: Path) -> None:
    """As a reader that supports only this dialect needs them."""
    knowledge = small(dialect, tmp_path)
    world = knowledge.world()
    moved = changed(world, "moved")
    path = tmp_path / "back.ttl"
    notes = save_map(moved, path, source_view=knowledge.source_view())
    # AMEVA's poses are SemLog's, but the limits of joints that were inferred from the old pose are stated now.
    assert any("changed" in note for note in notes)
    known = [quad.triple for quad in ox.parse(path=path) if _is_known(quad, dialect)]
    ox.serialize(known, tmp_path / "known.nt", ox.RdfFormat.N_TRIPLES)
    seen = knowledge_base_from(tmp_path / "known.nt")
    assert seen.source_view().dialect == dialect
    pose = seen.world().body(world.bodies[0].id).pose
    assert pose.position == pytest.approx(ELSEWHERE.position, abs=1e-12)
    assert pose.quaternion == pytest.approx(ELSEWHERE.quaternion, abs=1e-12)


def _is_known(quad: ox.Quad, dialect: str) -> bool:
    is_ours = quad.predicate.value.startswith(MS)
    return not is_ours and (dialect == "AMEVA" or quad.predicate.value != KNOWROB + "pose")


def test_changed_poses_are_written_in_the_units_of_the_map(tmp_path: Path) -> None:
    knowledge = small("AMEVA", tmp_path)
    save_map(changed(knowledge.world(), "moved"), tmp_path / "back.ttl", source_view=knowledge.source_view())
    assert '"123.456789012345 70.0 0.1"' in (tmp_path / "back.ttl").read_text(encoding="utf-8")


def test_earlier_perceptions_are_kept_and_the_latest_counts(tmp_path: Path) -> None:
    knowledge = small("KnowRob 1", tmp_path)
    world = knowledge.world()
    door = world.body("door")
    moved = replace(world, bodies=tuple(replace(b, pose=ELSEWHERE) if b is door else b for b in world.bodies))
    save_map(moved, tmp_path / "back.ttl", source_view=knowledge.source_view())
    text = (tmp_path / "back.ttl").read_text(encoding="utf-8")
    assert all(f"timepoint_{when}" in text for when in (5, 9, 10))


def test_units_chosen_by_the_user_are_declared_in_the_map(tmp_path: Path) -> None:
    path = tmp_path / "map.ttl"
    path.write_text(SMALL["SemLog"], encoding="utf-8")
    knowledge = KnowledgeBase(bundled_ontology=False)
    knowledge.load(path, conventions=UnitConventions(units=LengthUnit.CENTIMETERS, frame=Handedness.UNREAL))
    back = returned(knowledge.world(), knowledge, tmp_path, MapFormat.TURTLE)
    assert_worlds_equal(knowledge.world(), back.world())
    assert '"1.0 2.0 3.0"' in (tmp_path / "back.ttl").read_text(encoding="utf-8")
    assert {MS + "units", MS + "frame"} <= predicates(tmp_path / "back.ttl")
    assert lost_statements(knowledge.source_view(), back.source_view()) == ()


def test_a_map_with_a_robot_description_is_written_without_needing_it(tmp_path: Path) -> None:
    (tmp_path / "kitchen.urdf").write_text(KITCHEN_URDF, encoding="utf-8")
    path = tmp_path / "map.ttl"
    path.write_text(soma_map(':drawer a soma:Drawer ; urdf:hasBaseLinkName "counter_drawer_main" .'), encoding="utf-8")
    knowledge = KnowledgeBase(bundled_ontology=False)
    knowledge.load(path, urdf=tmp_path / "kitchen.urdf")
    back = returned(knowledge.world(), knowledge, tmp_path, MapFormat.TURTLE)
    assert_worlds_equal(knowledge.world(), back.world())
    assert back.findings() == ()
    assert lost_statements(knowledge.source_view(), back.source_view()) == ()


def test_a_converted_map_stays_converted_or_is_written_with_its_original_numbers(tmp_path: Path) -> None:
    world = small("AMEVA", tmp_path).world()
    save_map(world, tmp_path / "si.ttl")
    knowledge = knowledge_base_from(tmp_path / "si.ttl")
    back = returned(knowledge.world(), knowledge, tmp_path, MapFormat.TURTLE)
    assert back.source_view().dialect == knowledge.source_view().dialect == "SemLog"
    assert_worlds_equal(world, back.world())
    assert lost_statements(knowledge.source_view(), back.source_view()) == ()
    save_map(world, tmp_path / "own.ttl", source_view=knowledge.source_view().before_conversion())
    own = knowledge_base_from(tmp_path / "own.ttl")
    assert own.source_view().dialect == "AMEVA"
    assert_same_in_si(world, own.world())
    assert '"126.0 172.0 97.0"' in (tmp_path / "own.ttl").read_text(encoding="utf-8")
    assert small("SOMA", tmp_path).source_view().before_conversion() is None


@each_dialect
def test_maps_written_by_mindstage_survive_a_round_trip(dialect: str, tmp_path: Path) -> None:
    """In SOMA's vocabulary, and with changed poses restated in the dialect of the map."""
    first = small(dialect, tmp_path)
    save_map(first.world(), tmp_path / "soma.ttl", dialect=MapDialect.SOMA)
    save_map(changed(first.world(), "moved"), tmp_path / "moved.ttl", source_view=first.source_view())
    for name in ("soma", "moved"):
        knowledge = knowledge_base_from(tmp_path / f"{name}.ttl")
        back = returned(knowledge.world(), knowledge, tmp_path, MapFormat.TURTLE)
        assert_worlds_equal(knowledge.world(), back.world())
        assert lost_statements(knowledge.source_view(), back.source_view()) == ()
        assert lost_statements(back.source_view(), knowledge.source_view()) == ()
