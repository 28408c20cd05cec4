"""Maps that take poses and joints from a robot description."""

from __future__ import annotations

from pathlib import Path

import pyoxigraph as ox
import pytest

from mindstage.errors import SourceParseError
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import save_map
from mindstage.rdf import Severity
from tests.maps.small_maps import assert_worlds_equal, knowledge_base_from
from tests.maps.small_urdf import KITCHEN_URDF, box_urdf, link_urdf, robot_urdf

BASE = link_urdf("base", box_urdf("1 1 1"))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "kitchen.urdf"


_LINKED = """
@prefix : <http://example.org/linked.owl#> .
@prefix soma: <http://www.ease-crc.org/ont/SOMA.owl#> .
@prefix urdf: <http://knowrob.org/kb/urdf.owl#> .
@prefix owl: <http://www.w3.org/2002/07/owl#> .
<http://example.org/linked.owl> a owl:Ontology .
:drawer a owl:NamedIndividual, soma:Drawer ;
    urdf:hasBaseLinkName "counter_drawer_main" ; soma:hasPhysicalComponent :grip .
:grip a owl:NamedIndividual, soma:DesignedHandle ; urdf:hasEndLinkName "counter_drawer_handle" .
:cooler a owl:NamedIndividual, soma:Refrigerator ;
    urdf:hasBaseLinkName "fridge" ; urdf:hasEndLinkName "fridge_door_link" .
"""


@pytest.fixture
def linked(tmp_path: Path, file: Path) -> Path:
    file.write_text(KITCHEN_URDF, encoding="utf-8")
    path = tmp_path / "linked.ttl"
    path.write_text(_LINKED, encoding="utf-8")
    return path


def test_a_map_gets_its_poses_and_joints_from_the_description(linked: Path, file: Path, tmp_path: Path) -> None:
    knowledge = KnowledgeBase()
    knowledge.load(linked, urdf=file)
    world = knowledge.world()
    assert (world.name, knowledge.findings()) == ("linked", ())
    assert world.body("drawer").pose.position == pytest.approx((0.95, 0.4, 0.7))
    assert world.body("drawer").cls == "http://www.ease-crc.org/ont/SOMA.owl#Drawer"
    assert world.body("cooler").size == (0.6, 0.6, 2.0)
    assert {(each.parent, each.child) for each in world.joints} == {
        ("counter_main", "drawer"),
        ("cooler", "fridge_door_link"),
    }
    assert ("drawer", "grip") in {(each.parent, each.child) for each in world.attachments}
    assert "hasBaseLinkName" in str(world.body("drawer").facts)
    save_map(world, tmp_path / "back.owl")
    assert_worlds_equal(world, knowledge_base_from(tmp_path / "back.owl", bundled_ontology=True).world())


def test_rdf_xml_maps_can_use_a_description_too(linked: Path, file: Path, tmp_path: Path) -> None:
    quads = ox.parse(linked.read_bytes(), ox.RdfFormat.TURTLE)
    path = tmp_path / "linked.owl"
    path.write_bytes(ox.serialize((quad.triple for quad in quads), format=ox.RdfFormat.RDF_XML) or b"")
    first, second = KnowledgeBase(), KnowledgeBase()
    first.load(linked, urdf=file)
    second.load(path, urdf=file)
    assert_worlds_equal(first.world(), second.world())


def test_a_missing_description_is_reported_with_the_links_needed(linked: Path) -> None:
    knowledge = knowledge_base_from(linked)
    assert knowledge.world().bodies == ()
    (found,) = (finding for finding in knowledge.findings() if "robot description" in finding.problem)
    assert found.severity is Severity.ERROR
    assert "'fridge'" in found.problem
    assert "--urdf FILE" in str(knowledge.findings())


def test_unknown_and_unused_links_are_reported(linked: Path, file: Path) -> None:
    linked.write_text(_LINKED.replace('"fridge"', '"freezer"'), encoding="utf-8")
    other = file.with_name("other.urdf")
    other.write_text(robot_urdf(BASE), encoding="utf-8")
    knowledge = KnowledgeBase(bundled_ontology=False)
    knowledge.load(linked, urdf=[file, other])
    assert len(knowledge.world().joints) == 2
    texts = str(knowledge.findings())
    assert "that of the link 'freezer'" in texts
    assert "no map refers to one of its links" in texts


def test_a_file_that_is_not_a_robot_description_is_refused(linked: Path) -> None:
    with pytest.raises(SourceParseError, match="not well-formed XML"):
        KnowledgeBase(bundled_ontology=False).load(linked, urdf=linked)
    with pytest.raises(SourceParseError, match="No such file"):
        KnowledgeBase(bundled_ontology=False).load(linked, urdf=linked.with_name("gone.urdf"))
