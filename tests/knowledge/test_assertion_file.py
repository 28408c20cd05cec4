"""Files of assertions."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pyoxigraph as ox
import pytest

from mindstage.errors import InvalidArgumentError, NameNotFoundError, SourceParseError
from mindstage.knowledge import AssertionFile, KnowledgeBase
from mindstage.knowledge.assertion_file import TripleStoreView
from mindstage.rdf.graphs import RdfTerm, local_name
from mindstage.scene import Iri
from tests.maps.small_maps import KNOWROB, OWL, RDFS

CONTAINER_FOR = "typePrimaryFunction-containerFor"

_TERMS = f"""@prefix k: <{KNOWROB}> . @prefix owl: <{OWL}> . @prefix rdfs: <{RDFS}> .
k:{CONTAINER_FOR} a owl:ObjectProperty . k:mass a owl:DatatypeProperty .
k:Perishable a owl:Class . k:Bread a owl:Class ; rdfs:subClassOf k:Perishable . k:Breadbasket a owl:Class .
k:Refrigerator a owl:Class ; rdfs:subClassOf
    [ a owl:Restriction ; owl:onProperty k:{CONTAINER_FOR} ; owl:someValuesFrom k:Perishable ] .
"""


@pytest.fixture
def terms(tmp_path: Path) -> Path:
    path = tmp_path / "terms.ttl"
    path.write_text(_TERMS, encoding="utf-8")
    return path


def assertion_file(path: Path, terms: Path) -> AssertionFile:
    """The file, opened with a new knowledge base."""
    kb = KnowledgeBase(bundled_ontology=False)
    kb.load((), ontologies=terms)
    return AssertionFile(path, kb)


def places(terms: Path, *more: Path) -> list[str]:
    kb = KnowledgeBase(bundled_ontology=False)
    kb.load((), ontologies=[terms, *more])
    return [local_name(row.place) for row in kb.ask("storage_place", item="Bread")]


def test_assertions_can_be_loaded_and_retracted(terms: Path, tmp_path: Path) -> None:
    path = tmp_path / "assertions.ttl"
    assert places(terms) == ["Refrigerator"]
    assert assertion_file(path, terms).tell("Breadbasket", CONTAINER_FOR, "Bread")
    assert places(terms, path) == ["Breadbasket", "Refrigerator"]
    assert assertion_file(path, terms).retract("Breadbasket", CONTAINER_FOR, "Bread")
    assert places(terms, path) == ["Refrigerator"]
    assert not list(ox.parse(path=str(path), format=ox.RdfFormat.TURTLE)), "no half of a restriction stays"


def test_several_assertions_in_sequence(terms: Path, tmp_path: Path) -> None:
    path = tmp_path / "assertions.ttl"
    assertion_file(path, terms).tell("ms:Rack", "subClassOf", "Breadbasket")
    assertion_file(path, terms).tell("ms:joe", "type", "Rack")
    assertion_file(path, terms).tell("joe", "mass", 0.1)
    assertion_file(path, terms).tell("Breadbasket", CONTAINER_FOR, "Bread")
    assert assertion_file(path, terms).retract("joe", "mass", 0.1)
    text = path.read_text(encoding="utf-8")
    assert text.count("@prefix ms:") == 1
    assert "mass" not in text
    kb = KnowledgeBase(bundled_ontology=False)
    kb.load((), ontologies=[terms, path])
    assert [local_name(row.place) for row in kb.ask("storage_place", item="Bread")] == ["Breadbasket", "Refrigerator"]
    assert [local_name(cls) for row in kb.ask("what_is", individual="joe") for cls in row.classes] == ["Rack"]


def test_a_known_statement_is_not_written_again(terms: Path, tmp_path: Path) -> None:
    path = tmp_path / "assertions.ttl"
    assert not assertion_file(path, terms).tell("Refrigerator", CONTAINER_FOR, "Perishable")
    assert not path.exists()
    assertion_file(path, terms).tell("Breadbasket", CONTAINER_FOR, "Bread")
    before = path.read_bytes()
    assert not assertion_file(path, terms).tell("Breadbasket", CONTAINER_FOR, "Bread")
    assert path.read_bytes() == before


def test_a_statement_of_another_source_is_not_retracted_from_the_file(terms: Path, tmp_path: Path) -> None:
    path = tmp_path / "assertions.ttl"
    assertion_file(path, terms).tell("Breadbasket", CONTAINER_FOR, "Bread")
    before = path.read_bytes()
    assert not assertion_file(path, terms).retract("Refrigerator", CONTAINER_FOR, "Perishable")
    assert path.read_bytes() == before


def test_a_foreign_file_is_only_appended_to(terms: Path, tmp_path: Path) -> None:
    path = tmp_path / "mine.ttl"
    mine = f'# My terms.\n@prefix ms: <e:> .\n@prefix knowrob: <{KNOWROB}> .\nms:me ms:weighs "1.50"^^ms:kg'
    path.write_text(f"{mine} .", encoding="utf-8")
    assertion_file(path, terms).tell("http://mindstage.org/ontology#Rack", "subClassOf", "Breadbasket")
    text = path.read_text(encoding="utf-8")
    assert text.startswith(mine)
    assert text.count("@prefix knowrob:") == 1
    triples = {str(quad.triple) for quad in ox.parse(text, ox.RdfFormat.TURTLE)}
    assert any("<e:me> <e:weighs>" in each for each in triples)
    assert any("<http://mindstage.org/ontology#Rack>" in each for each in triples)
    with pytest.raises(
        InvalidArgumentError, match=r"it was not created by Mindstage, .*; remove the statement in an editor"
    ):
        assertion_file(path, terms).retract("Rack", "subClassOf", "Breadbasket")
    assert path.read_text(encoding="utf-8") == text


def test_an_invalid_statement_creates_no_file(terms: Path, tmp_path: Path) -> None:
    path = tmp_path / "assertions.ttl"
    with pytest.raises(NameNotFoundError, match="near: 'Breadbasket'"):
        assertion_file(path, terms).tell("Bredbasket", CONTAINER_FOR, "Bread")
    assert not path.exists()


def test_only_turtle_files_are_accepted(terms: Path, tmp_path: Path) -> None:
    with pytest.raises(InvalidArgumentError, match=r"assertions\.owl: assertions are written as Turtle; call it \.ttl"):
        assertion_file(tmp_path / "assertions.owl", terms)


def test_an_unreadable_file_is_not_written(terms: Path, tmp_path: Path) -> None:
    path = tmp_path / "assertions.ttl"
    path.write_text("@prefix : <", encoding="utf-8")
    with pytest.raises(SourceParseError, match=r"assertions\.ttl"):
        assertion_file(path, terms)
    with pytest.raises(FileNotFoundError):
        assertion_file(tmp_path / "none.ttl", terms).retract("Breadbasket", CONTAINER_FOR, "Bread")


# -- several writers ---------------------------------------------------------------------------------------------------


def test_two_open_files_keep_each_others_statements(terms: Path, tmp_path: Path) -> None:
    path = tmp_path / "assertions.ttl"
    one, other = assertion_file(path, terms), assertion_file(path, terms)
    assert one.tell("ms:Rack", "subClassOf", "Breadbasket")
    assert other.tell("ms:Box", "subClassOf", "Breadbasket")
    assert one.tell("Breadbasket", CONTAINER_FOR, "Bread")
    assert not other.tell("Breadbasket", CONTAINER_FOR, "Bread"), "the other one has told it"
    assert not other.tell("ms:Rack", "subClassOf", "Breadbasket")
    assert other.retract("Box", "subClassOf", "Breadbasket")
    assert one.tell("ms:Bin", "subClassOf", "Breadbasket")
    text = path.read_text(encoding="utf-8")
    assert ("Rack" in text, "Bin" in text, text.count("someValuesFrom")) == (True, True, 1)
    assert not assertion_file(path, terms).retract("Box", "subClassOf", "Breadbasket")
    assert places(terms, path) == ["Breadbasket", "Refrigerator"]


def test_an_own_statement_can_be_retracted(terms: Path, tmp_path: Path) -> None:
    file = assertion_file(tmp_path / "assertions.ttl", terms)
    assert file.tell("Breadbasket", CONTAINER_FOR, "Bread")
    assert file.retract("Breadbasket", CONTAINER_FOR, "Bread")
    assert not list(ox.parse(path=str(file.path), format=ox.RdfFormat.TURTLE))
    assert file.tell("Breadbasket", CONTAINER_FOR, "Bread"), "and told again"


def test_processes_that_write_at_once_lose_nothing(terms: Path, tmp_path: Path) -> None:
    path = tmp_path / "assertions.ttl"
    script = """
import sys
import subprocess
import sys
from pathlib import Path
from mindstage.knowledge import AssertionFile, KnowledgeBase
kb = KnowledgeBase(bundled_ontology=False)
kb.load((), ontologies=sys.argv[1])
file = AssertionFile(Path(sys.argv[2]), kb)
print("ready", flush=True)
sys.stdin.readline()
for number in range(8):
    file.tell(f"ms:Rack{sys.argv[3]}{number}", "subClassOf", "Breadbasket")
"""
    command = [sys.executable, "-c", script, str(terms), str(path)]
    processes = [
        subprocess.Popen([*command, name], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) for name in "abc"
    ]
    for process in processes:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
    for process in processes:
        process.communicate("\n", timeout=120)
        assert process.returncode == 0
    found = {str(quad.subject) for quad in ox.parse(path=str(path), format=ox.RdfFormat.TURTLE)}
    assert len(found) == 24
    assert sorted(each.name for each in tmp_path.iterdir()) == ["assertions.ttl", "terms.ttl"]


# -- single triples ----------------------------------------------------------------------------------------------------

E = "http://example.org/e#"


@pytest.fixture
def triples(tmp_path: Path) -> TripleStoreView:
    path = tmp_path / "family.ttl"
    path.write_text(
        f"""@prefix : <{E}> . @prefix owl: <{OWL}> . @prefix rdfs: <{RDFS}> .
        :holds a owl:ObjectProperty . :carries rdfs:subPropertyOf :holds . :isIn owl:inverseOf :holds .
        :tray :holds :cup . :robot :carries :tray . :spoon :isIn :cup . :cup :holds "water" .
        """,
        encoding="utf-8",
    )
    kb = KnowledgeBase(bundled_ontology=False)
    kb.load((), ontologies=path)
    return TripleStoreView(kb)


def test_entailed_triples_have_the_property_and_the_direction_asked_for(triples: TripleStoreView) -> None:
    def found(subject: str | None = None, value: RdfTerm | None = None) -> set[tuple[str, str, str]]:
        return {
            (local_name(one), local_name(property), local_name(Iri(other.value)))
            for one, property, other in triples.find_entailed(subject, f"{E}holds", value)
        }

    assert found() == {
        ("tray", "holds", "cup"), ("robot", "holds", "tray"), ("cup", "holds", "spoon"), ("cup", "holds", "water"),
    }  # fmt: skip
    assert found(f"{E}cup") == {("cup", "holds", "spoon"), ("cup", "holds", "water")}
    assert found(value=RdfTerm("iri", f"{E}spoon")) == {("cup", "holds", "spoon")}
    assert found(value=RdfTerm("iri", f"{E}robot")) == set()
    assert [each.property for each in triples.find(f"{E}robot")] == [f"{E}carries"], "as asserted"


def test_removing_triples_returns_their_number_and_leaves_the_others(triples: TripleStoreView) -> None:
    cup = RdfTerm("iri", f"{E}cup")
    triples.add(f"{E}tray", f"{E}holds", RdfTerm("iri", f"{E}fork"))
    assert triples.remove(f"{E}tray", f"{E}holds", RdfTerm("iri", f"{E}knife")) == 0
    assert triples.remove(f"{E}tray", None, cup) == 1
    assert [each.value.value for each in triples.find(f"{E}tray", f"{E}holds")] == [f"{E}fork"]
    assert triples.remove(f"{E}cup") == 1
    assert triples.remove(property=f"{E}isIn") == 1
    assert list(triples.find_entailed(None, f"{E}holds", cup)) == []
    assert [each.subject for each in triples.find(None, f"{E}carries")] == [f"{E}robot"]
