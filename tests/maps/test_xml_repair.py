"""Malformed files that are repaired: each repair is reported, and SWI-Prolog reads the same statements."""

from __future__ import annotations

import subprocess
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

import pyoxigraph as ox
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mindstage.errors import SourceParseError
from mindstage.maps.io.files import SourceFile, read_file
from mindstage.rdf import Severity
from tests.maps.malformed_xml import MALFORMED, WELL_FORMED
from tests.maps.small_maps import knowledge_base_from

each_malformation = pytest.mark.parametrize("name", MALFORMED)

ASK_SWI = """
:- use_module(library(rdf)).
main :- current_prolog_flag(argv, Files), forall(member(File, Files), print_count(File)).
print_count(File) :-
    load_rdf(file(File), Triples, [base_uri('http://example.org/base')]),
    exclude(of_syntax, Triples, Statements), sort(Statements, Set), length(Set, Count), format("~d~n", [Count]).
of_syntax(rdf(_, Property, _)) :-
    atom_concat('http://www.w3.org/1999/02/22-rdf-syntax-ns#', Name, Property), memberchk(Name, [about, 'ID']).
:- initialization((catch(main, Error, (print_message(error, Error), halt(1))), halt)).
"""
"""Prints the number of statements of each file, without those whose property belongs to the syntax of RDF/XML."""


BETTER_THAN_SWI = {"a statement without its end", "a statement with two objects"}
"""Cases in which SWI-Prolog reports that it cannot interpret something, and omits it."""


def reading(path: Path) -> tuple[SourceFile, set[ox.Quad]]:
    file = read_file(path)
    try:
        return file, set(ox.parse(file.data, file.format, base_iri=file.iri))
    except SyntaxError as error:
        file = file.repair(error)
        return file, set(ox.parse(file.data, file.format, base_iri=file.iri))


def written(tmp_path: Path, text: str | bytes) -> Path:
    path = tmp_path / "map.owl"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def swi_prolog_statement_counts(swipl: Path, files: Iterable[Path], tmp_path: Path) -> list[int]:
    script = tmp_path / "count.pl"
    script.write_text(ASK_SWI, encoding="utf-8")
    asked = [str(swipl), str(script), *map(str, files)]
    completed = subprocess.run(asked, capture_output=True, text=True, timeout=120, check=True)
    return [int(line) for line in completed.stdout.split()]


def test_the_valid_document_needs_no_repair(tmp_path: Path) -> None:
    file, statements = reading(written(tmp_path, WELL_FORMED))
    assert file.repairs == ()
    assert len(statements) == 5


@each_malformation
def test_a_malformed_document_is_read_and_its_repair_is_reported_with_the_line(name: str, tmp_path: Path) -> None:
    case = MALFORMED[name]
    expected = reading(written(tmp_path, WELL_FORMED))[1]
    path = written(tmp_path, case.text)
    file, statements = reading(path)
    assert any(
        repair.line == case.line and case.expected_text in f"{repair.problem} {repair.action}"
        for repair in file.repairs
    )
    if case.is_equivalent:
        assert statements == expected
    knowledge = knowledge_base_from(path)
    repairs = [finding for finding in knowledge.findings() if finding.individual == str(path)]
    assert repairs
    assert all(finding.severity is Severity.WARNING and finding.action for finding in repairs)
    assert any(finding.problem.startswith(f"line {case.line}: ") for finding in repairs)


def test_documents_that_swi_prolog_reads_are_read(swipl: Path, tmp_path: Path) -> None:
    files = []
    for number, case in enumerate(MALFORMED.values()):
        files.append(tmp_path / f"{number:02}.owl")
        files[-1].write_text(case.text, encoding="utf-8")
    ours = dict(zip(MALFORMED, (len(reading(path)[1]) for path in files), strict=True))
    theirs = dict(zip(MALFORMED, swi_prolog_statement_counts(swipl, files, tmp_path), strict=True))
    assert {name for name in MALFORMED if ours[name] != theirs[name]} == BETTER_THAN_SWI
    assert all(ours[name] > theirs[name] for name in BETTER_THAN_SWI)


SPOILINGS = [
    ("entities without blanks", b'<!ENTITY owl "', b'<!ENTITY owl"'),
    ("an ontology that is about itself twice", b"<owl:Ontology rdf:about=", b'<owl:Ontology rdf:about="a" rdf:about='),
]


@pytest.mark.parametrize(("name", "old", "new"), SPOILINGS, ids=[name for name, *_ in SPOILINGS])
@pytest.mark.parametrize("map", ["iai-kitchen-original", "ameva-task-two"])
def test_a_corrupted_real_map_gives_the_statements_that_swi_prolog_reads(
    map: str, name: str, old: bytes, new: bytes, shared_data: Path, swipl: Path, tmp_path: Path
) -> None:
    data = (shared_data / "maps" / f"{map}.owl").read_bytes()
    assert old in data
    path = written(tmp_path, data.replace(old, new))
    file, statements = reading(path)
    assert file.repairs
    (count,) = swi_prolog_statement_counts(swipl, [path], tmp_path)
    assert len(statements) == count


# -- encodings ---------------------------------------------------------------------------------------------------------


def test_bytes_of_another_encoding_are_read_and_reported(tmp_path: Path) -> None:
    path = written(tmp_path, WELL_FORMED.replace("A cup", "Küche").encode("latin-1"))
    file, statements = reading(path)
    assert any("Küche" in str(quad.object) for quad in statements)
    assert file.repairs[0].line == 15
    assert "0xfc is not valid UTF-8" in file.repairs[0].problem


@pytest.mark.parametrize("encoding", ["klingon", "utf-16", "UTF-32LE", "ucs-2"])
def test_a_wrong_encoding_declaration_is_reported(encoding: str, tmp_path: Path) -> None:
    text = WELL_FORMED.replace('"utf-8"', f'"{encoding}"').replace("A cup", "Küche")
    file, statements = reading(written(tmp_path, text))
    assert any("Küche" in str(quad.object) for quad in statements)
    assert encoding in file.repairs[0].problem


def test_text_before_the_declaration_is_ignored_and_reported(tmp_path: Path) -> None:
    file, statements = reading(written(tmp_path, f"Here is my map:\n\n{WELL_FORMED}"))
    assert len(statements) == 5
    assert file.repairs[0].line == 1
    assert "Here is my map" in file.repairs[0].problem


@pytest.mark.parametrize("before", ["\ufeff", "\n\n  ", "<!-- mine -->\n", "\ufeff\n"])
def test_what_xml_allows_before_a_document_is_not_reported(before: str, tmp_path: Path) -> None:
    file, statements = reading(written(tmp_path, f"{before}{WELL_FORMED}"))
    assert len(statements) == 5
    assert file.repairs == ()


# -- many repairs, and random ones -------------------------------------------------------------------------------------


def test_many_repairs_are_counted(tmp_path: Path) -> None:
    individuals = "\n".join(f'<knowrob:Cup rdf:about="&m;a cup {number}"/>' for number in range(1000))
    path = written(tmp_path, WELL_FORMED.replace("</rdf:RDF>", f"{individuals}\n</rdf:RDF>"))
    findings = [finding for finding in knowledge_base_from(path).findings() if finding.individual == str(path)]
    assert len(findings) == 101
    assert "900 more places" in findings[-1].problem


def test_repairs_keep_line_numbers(tmp_path: Path) -> None:
    """An error after a repair is reported with the line of the file."""
    text = MALFORMED["an attribute twice"].text.replace("</rdf:RDF>", '<rdf:Description rdf:nodeID="1 2"/>\n</rdf:RDF>')
    with pytest.raises(SourceParseError) as caught:
        knowledge_base_from(written(tmp_path, text))
    assert caught.value.line == 17


LETTERS = st.sampled_from([*"<>&;\"'=/!-[]", "<!ENTITY ", "rdf:about=", "</rdf:RDF>", "\n", "\0", "ü", " "])


@given(data=st.data(), letters=st.lists(LETTERS, min_size=1, max_size=3))
def test_any_change_of_a_document_gives_statements_or_an_error(
    data: st.DataObject, letters: list[str], tmp_path_factory: pytest.TempPathFactory
) -> None:
    text = WELL_FORMED
    for letter in letters:
        at = data.draw(st.integers(0, len(text)))
        text = text[:at] + letter + text[at + data.draw(st.integers(0, 12)) :]
    path = tmp_path_factory.mktemp("any") / "map.owl"
    path.write_text(text, encoding="utf-8")
    with suppress(SourceParseError):
        assert all(finding.problem and finding.action for finding in knowledge_base_from(path).findings())
