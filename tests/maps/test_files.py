"""Invalid and unusual files: each is refused with line and cause, or read."""

from __future__ import annotations

from pathlib import Path

import pytest

from mindstage.errors import SourceParseError
from mindstage.maps.io.xml import UnsafeXmlError, expand_safe_entities
from tests.maps.small_maps import body_turtle, knowledge_base_from, room_map

RDF = "http://www.w3.org/1999/02/22-rdf-syntax-ns#"
HEAD = f'<rdf:RDF xmlns:rdf="{RDF}" xmlns:k="http://knowrob.org/kb/knowrob.owl#" xmlns:e="http://e#">\n'
TAIL = "\n</rdf:RDF>\n"
MAP = '<k:SemanticEnvironmentMap rdf:about="http://e#map"><e:note>a note</e:note></k:SemanticEnvironmentMap>'
DOCUMENT = HEAD + MAP + TAIL
OWL_XML = """<?xml version="1.0"?>
<Ontology xmlns="http://www.w3.org/2002/07/owl#"><Declaration><Class IRI="#Cup"/></Declaration></Ontology>
"""


def refused(tmp_path: Path, content: bytes | str, *, name: str = "map.owl") -> SourceParseError:
    path = tmp_path / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    with pytest.raises(SourceParseError) as caught:
        knowledge_base_from(path)
    assert caught.value.source == str(path)
    return caught.value


def read_maps(tmp_path: Path, content: bytes | str, *, name: str = "map.owl") -> tuple[str, ...]:
    path = tmp_path / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return knowledge_base_from(path).maps()


def test_the_unchanged_document_is_valid(tmp_path: Path) -> None:
    assert read_maps(tmp_path, DOCUMENT) == ("http://e#map",)


@pytest.mark.parametrize(
    ("content", "line", "cause"),
    [
        ("", 1, "empty"),
        (" \n\n ", 3, "empty"),
        ("once upon a time", 1, "not XML"),
        (b"\x89PNG\r\n\x1a\n\x00\x00", 1, "not XML"),
        (DOCUMENT[:-2], 3, "truncated"),
        (DOCUMENT.replace("</rdf:RDF>", ""), 4, "truncated"),
        (DOCUMENT[: DOCUMENT.index("note</")], 2, "truncated"),
        (DOCUMENT[: DOCUMENT.index("Map rdf:about")], 2, "truncated"),
        (DOCUMENT + "<more/>", 4, "junk after document element"),
        (f"{DOCUMENT}\ntwice", 5, "junk after document element"),
        (f"<!DOCTYPE rdf:RDF [ <!ENTITY e 'http://e#'>\n{DOCUMENT}", 2, "not well-formed"),
        (HEAD + MAP.replace("note>a", "note><![CDATA[a").replace("</e:note>", ""), 2, "truncated"),
        (HEAD + "<!-- " + MAP + TAIL, 2, "truncated"),
        ("<html>\n<body>not found</body></html>", 1, "<html>"),
        ('<?xml version="1.0"?>\n<svg width="1"><rect width="1"/></svg>', 2, "<svg>"),
        (OWL_XML, 2, "OWL/XML"),
    ],
)
def test_an_invalid_file_is_refused_with_line_and_cause(
    content: bytes | str, line: int | None, cause: str, tmp_path: Path
) -> None:
    error = refused(tmp_path, content)
    assert cause in str(error)
    assert error.line == line


def test_invalid_turtle_is_refused_with_line_and_cause(tmp_path: Path) -> None:
    error = refused(tmp_path, "@prefix e: <http://e#> .\n\ne:a e:b 'c\n", name="map.ttl")
    assert error.line == 3
    assert refused(tmp_path, "<http://e#a> <http://e#b>\n", name="map.nt").line == 2


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SourceParseError, match="no such file"):
        knowledge_base_from(tmp_path / "nowhere.owl")


def test_a_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SourceParseError, match="folder"):
        knowledge_base_from(tmp_path)


def test_statements_about_statements_are_refused(tmp_path: Path) -> None:
    text = room_map("e:Jo e:says <<( e:the e:moon e:shines )>> .")
    (tmp_path / "map.ttl").write_text(text, encoding="utf-8")
    with pytest.raises(SourceParseError, match="statement about a statement"):
        knowledge_base_from(tmp_path / "map.ttl").world()


# -- formats -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["map.ttl", "map.owl", "map.rdf", "map.txt", "map"])
def test_turtle_is_recognized_under_any_name(name: str, tmp_path: Path) -> None:
    assert len(read_maps(tmp_path, room_map(), name=name)) == 1


@pytest.mark.parametrize("name", ["map.owl", "map.rdf", "map.XML", "map.txt", "map"])
def test_rdf_xml_is_recognized_under_any_name(name: str, tmp_path: Path) -> None:
    assert len(read_maps(tmp_path, DOCUMENT, name=name)) == 1
    assert len(read_maps(tmp_path, '<?xml version="1.0"?>' + DOCUMENT, name=name)) == 1


@pytest.mark.parametrize("name", ["map.nt", "map.txt"])
def test_n_triples_are_recognized(name: str, tmp_path: Path) -> None:
    line = f"<http://e#map> <{RDF}type> <http://knowrob.org/kb/knowrob.owl#SemanticEnvironmentMap> .\n"
    assert len(read_maps(tmp_path, line, name=name)) == 1


def test_an_unknown_suffix_with_unknown_content_is_refused(tmp_path: Path) -> None:
    error = refused(tmp_path, "{}", name="map.json")
    assert ".json" in error.cause
    assert ".owl" in error.cause


@pytest.mark.parametrize("encoding", ["latin-1", "utf-16", "utf-8", "utf-8-sig"])
def test_other_encodings_are_read(encoding: str, tmp_path: Path) -> None:
    name = {"utf-8-sig": "UTF-8", "latin-1": "ISO-8859-1"}.get(encoding, encoding.upper())
    text = f'<?xml version="1.0" encoding="{name}"?>\n' + DOCUMENT.replace("a note", "Küche")
    (tmp_path / "map.owl").write_bytes(text.encode(encoding))
    world = knowledge_base_from(tmp_path / "map.owl").world()
    assert "Küche" in str(world.facts)


@pytest.mark.parametrize(
    "content",
    [
        DOCUMENT + "<!-- made by hand -->\n<!-- yesterday -->",
        "<!-- <nothing> -->" + DOCUMENT,
        HEAD + MAP.replace("a note", "<![CDATA[</rdf:RDF>]]>") + TAIL,
        DOCUMENT.replace("</rdf:RDF>", "</rdf:RDF >"),
        f'<!DOCTYPE rdf:RDF [ <!ENTITY e "http://e#"> ]>{DOCUMENT.replace("http://e#map", "&e;map")}',
        f"<!DOCTYPE rdf:RDF [ <!ENTITY e 'http://e#'> ]>{DOCUMENT.replace('http://e#map', '&e;map')}",
        f'<!DOCTYPE rdf:RDF SYSTEM "http://e/never-fetched.dtd">{DOCUMENT}',
        MAP.replace(
            " rdf:about",
            f' xmlns:k="http://knowrob.org/kb/knowrob.owl#" xmlns:e="http://e#" xmlns:rdf="{RDF}" rdf:about',
        ),
    ],
)
def test_unusual_documents_are_read(content: str, tmp_path: Path) -> None:
    assert read_maps(tmp_path, content) == ("http://e#map",)


# -- entities ----------------------------------------------------------------------------------------------------------


def with_entities(*entities: str) -> str:
    return f"<!DOCTYPE rdf:RDF [\n{chr(10).join(entities)}\n]>\n{DOCUMENT.replace('a note', '&last;')}"


def test_entities_that_expand_exponentially_are_refused_before_expansion(tmp_path: Path) -> None:
    doubling = [f'<!ENTITY e{n} "{f"&e{n - 1};" * 10}">' for n in range(1, 30)]
    error = refused(tmp_path, with_entities('<!ENTITY e0 "ha">', *doubling, '<!ENTITY last "&e29;">'))
    assert "e5" in error.cause
    assert error.line == 7


def test_one_long_entity_used_often_is_refused(tmp_path: Path) -> None:
    text = with_entities(f'<!ENTITY last "{"ha" * 20_000}">').replace("&last;", "&last;" * 1000)
    assert "would expand to 40" in refused(tmp_path, text).cause


@pytest.mark.parametrize("order", [1, -1])
def test_of_an_entity_that_is_declared_twice_the_longer_one_counts(tmp_path: Path, order: int) -> None:
    both = [f'<!ENTITY last "{"ha" * 20_000}">', '<!ENTITY last "ha">'][::order]
    text = with_entities(*both).replace("&last;", "&last;" * 1000)
    assert "would expand to 40" in refused(tmp_path, text).cause
    with pytest.raises(UnsafeXmlError, match="would expand to 40"):  # before the first one is chosen
        expand_safe_entities(text.encode())


def test_recursive_entities_are_refused(tmp_path: Path) -> None:
    error = refused(tmp_path, with_entities('<!ENTITY a "&last;">', '<!ENTITY last "&a;">'))
    assert "recursive" in error.cause


@pytest.mark.parametrize(
    "outside", ['SYSTEM "file:///etc/passwd"', 'PUBLIC "-//x" "http://e/x"', "SYSTEM 'http://e/x'", "system 'x'"]
)
def test_external_entities_are_refused(outside: str, tmp_path: Path) -> None:
    error = refused(tmp_path, with_entities(f"<!ENTITY last {outside}>"))
    assert "another file" in error.cause
    assert error.line == 2


def test_external_parameter_entities_are_refused(tmp_path: Path) -> None:
    error = refused(tmp_path, with_entities('<!ENTITY % all SYSTEM "http://e/x.dtd">', "%all;", '<!ENTITY last "x">'))
    assert "'all' refers to another file" in error.cause


def test_entity_expansion_in_a_document_that_needs_repair_is_refused(tmp_path: Path) -> None:
    doubling = [f'<!ENTITY e{n}"{f"&e{n - 1};" * 10}">' for n in range(1, 30)]
    error = refused(tmp_path, with_entities('<!ENTITY e0"ha">', *doubling, '<!ENTITY last"&e29;">'))
    assert "e5" in error.cause


def test_a_long_entity_that_is_used_once_is_read(tmp_path: Path) -> None:
    (tmp_path / "map.owl").write_text(with_entities(f'<!ENTITY last "{"ha" * 20_000}">'), encoding="utf-8")
    assert "ha" * 20_000 in str(knowledge_base_from(tmp_path / "map.owl").world().facts)


# -- atomicity ---------------------------------------------------------------------------------------------------------


def test_an_invalid_file_leaves_the_knowledge_base_unchanged(tmp_path: Path) -> None:
    good, better, bad = (tmp_path / name for name in ("good.ttl", "better.ttl", "bad.ttl"))
    good.write_text(room_map(body_turtle("cup").replace(":room", ":good"), map="good"), encoding="utf-8")
    better.write_text(room_map("k:Cup rdfs:subClassOf k:Vessel .", map="better"), encoding="utf-8")
    bad.write_text("this is no turtle", encoding="utf-8")
    knowledge = knowledge_base_from(good)
    before = knowledge.maps(), knowledge.findings()
    with pytest.raises(SourceParseError):
        knowledge.load([better, bad])
    assert (knowledge.maps(), knowledge.findings()) == before
    assert knowledge.ancestors("http://knowrob.org/kb/knowrob.owl#Cup") == ()  # type: ignore[arg-type]
    bad.unlink()
    knowledge.load([better])
    assert [map.split("#")[1] for map in knowledge.maps()] == ["good", "better"]
