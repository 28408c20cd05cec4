"""Imports are loaded once and never downloaded; missing ones are reported."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from mindstage.errors import ReferenceRefusedError, SourceParseError
from mindstage.knowledge import KnowledgeBase
from mindstage.rdf import Severity
from mindstage.scene import Iri
from tests.maps.small_maps import body_turtle, knowledge_base_from, room_map

CLASS = "http://example.org/terms#Leaf"
OWL = "http://www.w3.org/2002/07/owl#"


def importing(*imports: str, iri: str = "http://example.org/room.owl") -> str:
    return f"<{iri}> a owl:Ontology . " + " ".join(f"<{iri}> owl:imports <{name}> ." for name in imports)


def write(path: Path, *statements: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(room_map(*statements).replace("k:SemanticEnvironmentMap", "e:Nothing"), encoding="utf-8")
    return path


def write_map(path: Path, *statements: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(room_map(*statements), encoding="utf-8")
    return path


def contains_class(knowledge: KnowledgeBase, name: str = "Stem") -> bool:
    return Iri(f"http://example.org/terms#{name}") in knowledge.ancestors(Iri(CLASS))


@pytest.fixture
def packages(tmp_path: Path) -> Path:
    """A package folder with packages that import one another."""
    folder = tmp_path / "packages"
    write(folder / "first" / "owl" / "a.ttl", importing("package://second/b.ttl", iri="http://e/a"))
    write(folder / "second" / "b.ttl", "e:Leaf rdfs:subClassOf e:Stem .", importing(iri="http://e/b"))
    return folder


def test_packages_are_searched_in_the_package_folders(packages: Path, tmp_path: Path) -> None:
    map = write_map(tmp_path / "map.ttl", importing("package://first/owl/a.ttl"))
    knowledge = knowledge_base_from(map, ontologies=(packages,))
    assert contains_class(knowledge)
    assert knowledge.findings() == ()


def test_a_folder_may_be_the_package_itself(packages: Path, tmp_path: Path) -> None:
    map = write_map(tmp_path / "map.ttl", importing("package://second/b.ttl"))
    assert contains_class(knowledge_base_from(map, ontologies=(packages / "second",)))


def test_packages_in_subfolders_of_a_workspace_are_found(packages: Path, tmp_path: Path) -> None:
    (packages / "second" / "package.xml").write_text("<package/>", encoding="utf-8")
    packages.rename(tmp_path / "workspace")
    map = write_map(tmp_path / "map.ttl", importing("package://second/b.ttl"))
    assert contains_class(knowledge_base_from(map, ontologies=(tmp_path,)))


def test_a_missing_package_is_reported_with_its_importer(tmp_path: Path) -> None:
    map = write_map(tmp_path / "map.ttl", importing("package://first/owl/a.ttl"), body_turtle("cup"))
    knowledge = knowledge_base_from(map)
    (finding,) = knowledge.findings()
    assert finding.severity is Severity.WARNING
    assert finding.individual == str(map)
    assert "package://first/owl/a.ttl" in finding.problem
    assert len(knowledge.world().bodies) == 1


def test_a_loaded_file_satisfies_a_package_import(packages: Path, tmp_path: Path) -> None:
    map = write_map(tmp_path / "map.ttl", importing("package://second/b.ttl"))
    knowledge = knowledge_base_from(map, ontologies=(packages / "second" / "b.ttl",))
    assert contains_class(knowledge)
    assert knowledge.findings() == ()


@pytest.mark.parametrize(
    "iri",
    ["package://../second/b.ttl", "package://second/../../x.ttl", "package://..", "package://second/%2e%2e/x.ttl"],
)
def test_paths_outside_of_a_package_are_refused(iri: str, packages: Path, tmp_path: Path) -> None:
    write(tmp_path / "x.ttl", "e:Leaf rdfs:subClassOf e:Stem .")
    map = write_map(tmp_path / "map.ttl", importing(iri))
    knowledge = knowledge_base_from(map, ontologies=(packages,))
    (finding,) = knowledge.findings()
    assert finding.severity is Severity.ERROR
    assert not contains_class(knowledge)
    with pytest.raises(SourceParseError, match="outside of every package"):
        knowledge_base_from(map, ontologies=(packages, iri))


def test_an_ontology_may_be_a_package_name(packages: Path, tmp_path: Path) -> None:
    map = write_map(tmp_path / "map.ttl")
    assert contains_class(knowledge_base_from(map, ontologies=("package://first/owl/a.ttl", packages)))
    with pytest.raises(SourceParseError, match=str(packages)):
        knowledge_base_from(map, ontologies=("package://first/owl/c.ttl", packages))


def test_package_folders_are_used_for_later_loads(packages: Path, tmp_path: Path) -> None:
    knowledge = knowledge_base_from(ontologies=(packages,))
    knowledge.load([write_map(tmp_path / "map.ttl", importing("package://first/owl/a.ttl"))])
    assert contains_class(knowledge)


@pytest.mark.parametrize("name", ["file:parts/stem.ttl", "parts/stem.ttl", "file:parts/../parts/stem.ttl"])
def test_file_imports_are_relative_to_the_importer(name: str, tmp_path: Path) -> None:
    write(tmp_path / "in" / "parts" / "stem.ttl", "e:Leaf rdfs:subClassOf e:Stem .")
    knowledge = knowledge_base_from(write_map(tmp_path / "in" / "map.ttl", importing(name)))
    assert contains_class(knowledge)
    assert knowledge.findings() == ()


def test_file_imports_may_be_absolute(tmp_path: Path) -> None:
    part = write(tmp_path / "with blanks" / "stem.ttl", "e:Leaf rdfs:subClassOf e:Stem .")
    assert contains_class(knowledge_base_from(write_map(tmp_path / "map.ttl", importing(part.as_uri()))))


def test_imports_can_be_skipped(tmp_path: Path) -> None:
    part = write(tmp_path / "stem.ttl", "e:Leaf rdfs:subClassOf e:Stem .")
    map = write_map(tmp_path / "map.ttl", importing(part.as_uri()), body_turtle("cup"))
    knowledge = KnowledgeBase()
    knowledge.load(map, follow_imports=False)
    assert not contains_class(knowledge)
    (finding,) = knowledge.findings()
    assert "its imports are not followed" in finding.problem
    assert len(knowledge.world().bodies) == 1


RDF_XML = (
    '<?xml version="1.0"?>\n<!-- a map -->\n{}<r:RDF xmlns:r="http://www.w3.org/1999/02/22-rdf-syntax-ns#" '
    'xmlns:owl="http://www.w3.org/2002/07/owl#"><owl:Ontology r:about="http://x.org/m">{}</owl:Ontology></r:RDF>'
)
IMPORT = RDF_XML.format("", '<owl:imports r:resource="{}"/>')
INCLUDE = '<xi:include xmlns:xi="http://www.w3.org/2001/XInclude" href="{}"/>'
SECRET = "file:///etc/passwd"


@pytest.mark.parametrize(
    ("file", "text", "named"),
    [
        ("map.ttl", f"<> <{OWL}imports> <{SECRET}> .", SECRET),
        ("map.ttl", f"@base <file:///etc/> . <> <{OWL}imports> <passwd> .", SECRET),
        ("map.ttl", f"@prefix o: <{OWL}> . [] o:imports <http://x.org/onto.owl> .", "http://x.org/onto.owl"),
        ("map.ttl", f'<> <{OWL}imports> "https://x.org/onto"^^<http://www.w3.org/2001/XMLSchema#anyURI> .', "//x.org"),
        ("map.ttl", f"<> <{OWL}imports> <package://other/owl/other.owl> .", "package://other/owl/other.owl"),
        ("map.ttl", f"<> <{OWL}imports> <http://x/a>, <http://mindstage.org/ontology/household.ttl> .", "http://x/a;"),
        ("map.owl", IMPORT.format(SECRET), SECRET),
        ("map.owl", IMPORT.format("part.owl"), "part.owl"),
        ("map.owl", IMPORT.format("&#102;ile:///etc/passwd"), SECRET),
        ("map.owl", RDF_XML.format(f'<!DOCTYPE r:RDF SYSTEM "{SECRET}">', ""), SECRET),
        ("map.owl", RDF_XML.format("<!DOCTYPE r:RDF PUBLIC '-//x' 'http://x.org/m.dtd' []>", ""), "http://x.org/m.dtd"),
        ("map.owl", RDF_XML.format(f'<!DOCTYPE r:RDF [<!ENTITY s SYSTEM "{SECRET}">]>', "&s;"), "entity 's'"),
        ("map.owl", RDF_XML.format(f'<!DOCTYPE r:RDF [<!ENTITY % s SYSTEM "{SECRET}"> %s;]>', ""), "entity 's'"),
        ("map.owl", RDF_XML.format("", INCLUDE.format(SECRET)), "XInclude"),
        ("cart.urdf", f'<robot name="a"><link name="b"/>{INCLUDE.format(SECRET)}</robot>', "XInclude"),
        ("cart.urdf", f'<!DOCTYPE robot SYSTEM "{SECRET}"><robot name="a"><link name="b"/></robot>', SECRET),
    ],
)  # fmt: skip
def test_a_file_that_came_over_a_port_is_refused_if_it_refers_to_another(
    file: str, text: str, named: str, tmp_path: Path
) -> None:
    (tmp_path / "part.owl").write_text(RDF_XML.format("", ""), encoding="utf-8")
    path = tmp_path / file
    path.write_text(text, encoding="utf-8")
    knowledge = KnowledgeBase()
    before = knowledge.sources(), len(knowledge.store)
    with pytest.raises((ReferenceRefusedError, SourceParseError), match=re.escape(named)):
        knowledge.load(path, untrusted=True)
    assert (knowledge.sources(), len(knowledge.store)) == before
    assert knowledge.findings() == ()


def test_a_file_that_came_over_a_port_may_import_what_is_loaded(packages: Path, tmp_path: Path) -> None:
    ontology = write(
        tmp_path / "onto.ttl", "<http://x.org/onto> a owl:Ontology ; owl:versionIRI <http://x.org/onto/2> ."
    )
    knowledge = knowledge_base_from(ontologies=(packages, "package://first/owl/a.ttl", ontology))
    imports = importing("http://x.org/onto#", "http://x.org/onto/2", "package://first/owl/a.ttl")
    map = write_map(tmp_path / "map.ttl", imports, body_turtle("cup"))
    knowledge.load(map, untrusted=True)
    assert knowledge.findings() == ()
    assert len(knowledge.world().bodies) == 1
    other = write_map(tmp_path / "other.ttl", importing(ontology.as_uri()), body_turtle("jug"))
    with pytest.raises(ReferenceRefusedError, match=re.escape(ontology.as_uri())):
        knowledge.load(other, untrusted=True)


def test_markup_in_labels_is_no_reference(tmp_path: Path) -> None:
    label = "<!ENTITY a SYSTEM 'file:///etc/passwd'> <!DOCTYPE b SYSTEM 'c'> <d xmlns:xi='http://www.w3.org/2001/XInclude'/>"
    map = write_map(tmp_path / "map.ttl", body_turtle("cup"), f'e:cup rdfs:label "{label}", "owl:imports <http://x>" .')
    knowledge = KnowledgeBase()
    knowledge.load(map, untrusted=True)
    assert len(knowledge.world().bodies) == 1


@pytest.mark.parametrize("name", ["file:nowhere.ttl", "file://other-machine/stem.ttl", "http://e/stem", "ros:stem"])
def test_remote_imports_are_reported_and_not_downloaded(name: str, tmp_path: Path) -> None:
    knowledge = knowledge_base_from(write_map(tmp_path / "map.ttl", importing(name)))
    (finding,) = knowledge.findings()
    assert name in finding.problem


@pytest.mark.parametrize("name", ["http://e/stem", "http://e/stem#", "http://e/stem/1.0"])
def test_a_loaded_ontology_satisfies_an_import_of_its_iri(name: str, tmp_path: Path) -> None:
    version = "<http://e/stem> owl:versionIRI <http://e/stem/1.0> ."
    stem = write(tmp_path / "stem.ttl", importing(iri="http://e/stem"), version)
    knowledge = knowledge_base_from(write_map(tmp_path / "map.ttl", importing(name)), ontologies=(stem,))
    assert knowledge.findings() == ()


def test_the_bundled_ontology_satisfies_an_import_of_its_iri(tmp_path: Path) -> None:
    map = write_map(tmp_path / "map.ttl", importing("http://mindstage.org/ontology/household.ttl"))
    assert knowledge_base_from(map, bundled_ontology=True).findings() == ()
    assert len(knowledge_base_from(map, bundled_ontology=False).findings()) == 1


def test_cyclic_imports_are_loaded_once(tmp_path: Path) -> None:
    write(
        tmp_path / "a.ttl", importing("file:b.ttl", "file:a.ttl", iri="http://e/a"), "e:Leaf rdfs:subClassOf e:Stem ."
    )
    write(tmp_path / "b.ttl", importing("file:a.ttl", iri="http://e/b"))
    knowledge = knowledge_base_from(write_map(tmp_path / "map.ttl", importing("file:a.ttl", "file:map.ttl")))
    assert contains_class(knowledge)
    assert knowledge.findings() == ()


def test_an_invalid_import_is_reported_with_its_cause(tmp_path: Path) -> None:
    (tmp_path / "bad.owl").write_text("<rdf:RDF>", encoding="utf-8")
    map = write_map(tmp_path / "map.ttl", importing("file:bad.owl"), body_turtle("cup"))
    knowledge = knowledge_base_from(map)
    (finding,) = knowledge.findings()
    assert finding.severity is Severity.ERROR
    assert "bad.owl" in finding.problem
    assert "truncated" in finding.problem
    assert len(knowledge.world().bodies) == 1


def test_individuals_may_be_in_an_imported_file(tmp_path: Path) -> None:
    write(tmp_path / "things.ttl", body_turtle("cup", 'k:mass "177.512833"^^xsd:float'), "e:Jo e:likes e:Cy .")
    world = knowledge_base_from(write_map(tmp_path / "map.ttl", importing("file:things.ttl"))).world()
    assert [body.physics.mass_kg for body in world.bodies] == [177.512833]
    assert any(resource.iri.endswith("#Jo") for resource in world.resources)


def test_sizes_from_an_ontology_keep_their_digits(tmp_path: Path) -> None:
    extents = zip(("depth", "width", "height"), ("177.512833", "16777217.000001", "0.1"), strict=True)
    write(
        tmp_path / "classes.ttl",
        importing(iri="http://e/classes"),
        *(
            f"k:Cup rdfs:subClassOf [ a owl:Restriction ; owl:onProperty k:{axis}OfObject ;"
            f' owl:hasValue "{extent}"^^xsd:float ] .'
            for axis, extent in extents
        ),
    )
    world = knowledge_base_from(
        write_map(tmp_path / "map.ttl", importing("file:classes.ttl"), body_turtle("cup"))
    ).world()
    assert world.bodies[0].size == (177.512833, 16777217.000001, 0.1)
    assert [resource.iri for resource in world.resources] == ["http://example.org/room.owl"]


def test_the_kitchen_of_the_thesis_imports_its_ontologies(shared_data: Path) -> None:
    map = shared_data / "maps" / "iai-kitchen-original.owl"
    knowledge = knowledge_base_from(map, ontologies=(shared_data / "ontology",))
    assert knowledge.findings() == ()
    handle, knob = (Iri(f"http://knowrob.org/kb/knowrob.owl#{name}") for name in ("Handle", "IAIHandleW60"))
    assert handle in knowledge.ancestors(knob)
    assert knob in knowledge.descendants(handle)
    assert knowledge.is_a(knob, handle)
    assert {finding.severity for finding in knowledge_base_from(map).findings()} == {Severity.WARNING}
