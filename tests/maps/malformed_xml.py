"""Documents that are not well-formed or not RDF/XML, as real maps may be, each made from one valid document."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["MALFORMED", "WELL_FORMED", "Malformed"]

HEAD = """<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE rdf:RDF[
\t<!ENTITY owl "http://www.w3.org/2002/07/owl#">
\t<!ENTITY xsd "http://www.w3.org/2001/XMLSchema#">
\t<!ENTITY knowrob "http://knowrob.org/kb/knowrob.owl#">
\t<!ENTITY m "http://example.org/m.owl#">
]>
<rdf:RDF xmlns="http://example.org/m.owl#" xml:base="http://example.org/m.owl#"
  xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#" xmlns:rdfs="http://www.w3.org/2000/01/rdf-schema#"
  xmlns:owl="http://www.w3.org/2002/07/owl#" xmlns:knowrob="http://knowrob.org/kb/knowrob.owl#">
  <owl:Ontology rdf:about="http://example.org/m.owl"/>
"""
BODY = """  <owl:NamedIndividual rdf:about="&m;cup">
    <rdf:type rdf:resource="&knowrob;Cup"/>
    <knowrob:mass rdf:datatype="&xsd;float">0.5</knowrob:mass>
    <rdfs:label>A cup</rdfs:label>
  </owl:NamedIndividual>
"""
WELL_FORMED = f"{HEAD}{BODY}</rdf:RDF>\n"
ONTOLOGY = '<owl:Ontology rdf:about="http://example.org/m.owl"/>'


class Malformed(NamedTuple):
    """One way to be wrong."""

    text: str
    line: int
    """Where it is."""
    expected_text: str
    """A part of what is reported."""
    is_equivalent: bool
    """Whether its statements equal those of the valid document."""


def _malformed_case(old: str, new: str, line: int, problem: str, *, same_statements: bool = True) -> Malformed:
    assert WELL_FORMED.count(old) >= 1, old
    return Malformed(WELL_FORMED.replace(old, new), line, problem, same_statements)


MALFORMED: dict[str, Malformed] = {
    "an entity without its blank": _malformed_case(
        '<!ENTITY owl "', '<!ENTITY owl"', 3, "entity 'owl' is not well-formed"
    ),
    "the map's entity without its blank": _malformed_case(
        '<!ENTITY m "', '<!ENTITY m"', 6, "entity 'm' is not well-formed"
    ),
    "an entity without its >": _malformed_case(
        'owl#">\n\t<!ENTITY x', 'owl#"\n\t<!ENTITY x', 3, "entity 'owl' is not well-f"
    ),
    "an entity without quotes": _malformed_case(
        '"http://example.org/m.owl#">\n]', "http://example.org/m.owl#>\n]", 6, "entity 'm'"
    ),
    "an entity in small letters": _malformed_case("<!ENTITY m", "<!entity m", 6, "entity 'm' is not well-formed"),
    "an entity declared twice": _malformed_case(
        "]>\n", '\t<!ENTITY m "http://example.org/other#">\n]>\n', 7, "entity 'm' is declared twice"
    ),
    "an undeclared entity": _malformed_case(
        '\t<!ENTITY xsd "http://www.w3.org/2001/XMLSchema#">\n', "\n", 14, "the entity 'xsd' is not declared"
    ),
    "an entity with a colon": _malformed_case('"&m;cup"', '"&m:cup"', 12, "used with a colon"),
    "an attribute twice": _malformed_case(
        ONTOLOGY, ONTOLOGY.replace("/>", ' rdf:about="http://e/b"/>'), 11, "rdf:about twice"
    ),
    "a namespace twice": _malformed_case(
        'xmlns:owl="', 'xmlns:owl="http://www.w3.org/2002/07/owl#" xmlns:owl="', 8, "xmlns:owl twice"
    ),
    "a value without quotes": _malformed_case(
        ONTOLOGY,
        ONTOLOGY.replace("/>", " rdfs:label=x/>"),
        11,
        "the value of rdfs:label has no quotes",
        same_statements=False,
    ),
    "a tag without its >": _malformed_case("</rdfs:label>\n", "</rdfs:label\n", 15, "an end tag has no >"),
    "a prefix declared as an entity only": _malformed_case(
        ' xmlns:knowrob="http://knowrob.org/kb/knowrob.owl#"', "", 14, "the prefix 'knowrob' is not declared"
    ),
    "a well-known prefix without a declaration": _malformed_case(
        ' xmlns:rdfs="http://www.w3.org/2000/01/rdf-schema#"', "", 15, "the prefix 'rdfs' is not declared"
    ),
    "an unknown prefix without a declaration": _malformed_case(
        "rdfs:label>", "foo:label>", 15, "the prefix 'foo' is not declared", same_statements=False
    ),
    "attributes without a prefix": _malformed_case(
        "rdf:about", "about", 11, "has the attribute 'about' without a prefix"
    ),
    "an & alone": _malformed_case("A cup", "A cup & saucer", 15, "there is an unescaped &", same_statements=False),
    "a < alone": _malformed_case("A cup", "1 < 2", 15, "there is a < in a text", same_statements=False),
    "an end that began as another name": _malformed_case(
        "</rdfs:label>", "</rdfs:Label>", 15, "has no start tag", same_statements=False
    ),
    "an end too few": _malformed_case("  </owl:NamedIndividual>\n", "\n", 17, "<owl:NamedIndividual> has no end tag"),
    "an end too many": _malformed_case("</rdf:RDF>", "</owl:Thing></rdf:RDF>", 17, "</owl:Thing> has no start tag"),
    "a statement without its end": _malformed_case(
        '<rdf:type rdf:resource="&knowrob;Cup"/>',
        '<rdf:type><owl:Class rdf:about="&knowrob;Cup"/>',
        14,
        "<rdf:type> has no end tag",
        same_statements=False,
    ),
    "a statement with two objects": _malformed_case(
        '<rdf:type rdf:resource="&knowrob;Cup"/>',
        '<rdf:type><owl:Class rdf:about="&knowrob;Cup"/><owl:Class rdf:about="&knowrob;Mug"/></rdf:type>',
        13,
        "<rdf:type> contains several nodes",
        same_statements=False,
    ),
    "text between nodes": _malformed_case("  <owl:Named", "  stray <owl:Named", 11, "is not allowed in"),
    "text beside a reference": _malformed_case('Cup"/>', 'Cup">x</rdf:type>', 13, "is not allowed in"),
    "a blank in a name": _malformed_case(
        "&m;cup", "&m;a cup", 12, "characters that IRIs exclude", same_statements=False
    ),
    "a backslash in a name": _malformed_case(
        '"&m;cup"', '"file:///C:\\maps\\a.owl"', 12, "characters that IRIs exclude", same_statements=False
    ),
    "a language with an underscore": _malformed_case(
        "<rdfs:label>", '<rdfs:label xml:lang="en_US">', 15, "en-US", same_statements=False
    ),
    "a language of no letters": _malformed_case("<rdfs:label>", '<rdfs:label xml:lang="">', 15, "the invalid language"),
    "an id that is no name": _malformed_case(
        'rdf:about="&m;cup"', 'rdf:ID="1cup"', 12, "is not an XML name", same_statements=False
    ),
    "an id twice": _malformed_case(
        "</rdf:RDF>",
        '<knowrob:Cup rdf:ID="a"/><knowrob:Cup rdf:ID="a"/></rdf:RDF>',
        17,
        "already used",
        same_statements=False,
    ),
    "a name and an id": _malformed_case('"&m;cup">', '"&m;cup" rdf:ID="cup2">', 12, "both rdf:about and rdf:ID"),
    "an encoding that it is not in": _malformed_case('"utf-8"', '"utf-16"', 1, "the encoding 'utf-16'"),
}
