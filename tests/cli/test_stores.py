"""Persistent knowledge: store folders, endpoints and files of assertions, used by several commands."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.runner import Run, WriteMap, json_output

CONTAINER_FOR = "typePrimaryFunction-containerFor"
ENDLESS = "SELECT (COUNT(*) AS ?n) WHERE { ?a ?b ?c . ?d ?e ?f . ?g ?h ?i }"

_VOCABULARY = f"""@prefix k: <http://knowrob.org/kb/knowrob.owl#> . @prefix owl: <http://www.w3.org/2002/07/owl#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
k:{CONTAINER_FOR} a owl:ObjectProperty . k:Perishable a owl:Class . k:Breadbasket a owl:Class .
k:Bread a owl:Class ; rdfs:subClassOf k:Perishable .
k:Refrigerator a owl:Class ; rdfs:subClassOf
    [ a owl:Restriction ; owl:onProperty k:{CONTAINER_FOR} ; owl:someValuesFrom k:Perishable ] .
"""


@pytest.fixture
def vocabulary(tmp_path: Path) -> tuple[object, ...]:
    """Options for a vocabulary with breadbaskets, but without their function."""
    path = tmp_path / "vocabulary.ttl"
    path.write_text(_VOCABULARY, encoding="utf-8")
    return "--no-bundled-ontology", "--ontology", path


def storage_places(run: Run, *args: object) -> list[str]:
    result = run("ask", "storage_place", "Bread", *args, "--json")
    return [answer["place"].rpartition("#")[2] for answer in json_output(result)["answers"]]


@pytest.mark.parametrize(
    ("target", "source"),
    [(("-o", "told.ttl"), ("--ontology", "told.ttl")), (("--store", "known"), ("--store", "known"))],
)
def test_an_assertion_changes_the_answers_of_later_commands(
    target: tuple[str, str], source: tuple[str, str], vocabulary: tuple[object, ...], tmp_path: Path
) -> None:
    """Each command runs in a process of its own."""

    def shell(*args: object) -> str:
        command = [sys.executable, "-m", "mindstage", *map(str, args)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, cwd=tmp_path, check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout

    def answers(*args: object) -> list[str]:
        rows = json.loads(shell("ask", "storage_place", "Bread", "--json", *vocabulary, *args))["answers"]
        return [answer["place"].rpartition("#")[2] for answer in rows]

    assert answers() == ["Refrigerator"]
    printed = shell("tell", "Breadbasket", CONTAINER_FOR, "Bread", *vocabulary, *target)
    assert printed == f"asserted: Breadbasket {CONTAINER_FOR} Bread\n"
    assert answers(*source) == ["Breadbasket", "Refrigerator"]


def test_a_store_does_not_need_its_sources(run: Run, tmp_path: Path, write_map: WriteMap) -> None:
    store, map = tmp_path / "store", write_map(mugs={"Mug1": "1 2 3"})
    assert json_output(run("ask", "maps", "--store", store, "--map", map, "--json"))["answers"][0]["individuals"] == 1
    map.unlink()
    (thing,) = json_output(run("ask", "what_is", "Mug1", "--store", store, "--json"))["answers"]
    assert thing["pose"]
    assert run("sparql", "ASK { ?mug a knowrob:Mug }", "--store", store).stdout == "yes\n"


def test_a_changed_map_is_loaded_again_with_a_finding(run: Run, tmp_path: Path, write_map: WriteMap) -> None:
    store, map = tmp_path / "store", write_map(mugs={"Mug1": "1 2 3"})
    run("ask", "maps", "--store", store, "--map", map)
    write_map(mugs={"Mug1": "1 2 3", "Mug2": "1 2 3"})
    result = run("ask", "maps", "--store", store, "--json")
    assert json_output(result)["answers"][0]["individuals"] == 2
    assert json_output(result)["findings"][0]["action"] == "it is reloaded"
    assert not json_output(run("ask", "maps", "--store", store, "--json"))["findings"]


def test_an_assertion_can_be_retracted(run: Run, vocabulary: tuple[object, ...], tmp_path: Path) -> None:
    statement = ("Breadbasket", CONTAINER_FOR, "Bread")
    store = ("--store", tmp_path / "store")
    result = run("tell", *statement, *vocabulary, *store, "--json")
    assert result.exit_code == 0
    assert json_output(result) == {
        "done": True,
        "statement": {"subject": "Breadbasket", "property": CONTAINER_FOR, "value": "Bread"},
        "where": str(tmp_path / "store"),
        "findings": [],
    }
    assert run("tell", *statement, *store).stdout.startswith("already asserted: ")
    assert storage_places(run, *store) == ["Breadbasket", "Refrigerator"]
    assert run("tell", "--retract", *statement, *store).stdout.startswith("retracted: ")
    again = run("tell", "--retract", *statement, *store)
    assert (again.exit_code, again.stdout.split(":")[0]) == (1, f"not asserted in {tmp_path / 'store'}")
    assert storage_places(run, *store) == ["Refrigerator"]


@pytest.mark.parametrize(
    ("value", "literal"),
    [("2.5", "2.5e0"), ("3", "3"), ("-1e3", "-1e3"), ("true", "true"), ('"3"', '"3"'), ("heavy", '"heavy"')],
)
def test_the_type_of_a_value_follows_from_its_syntax(
    value: str, literal: str, run: Run, tmp_path: Path, write_map: WriteMap
) -> None:
    more = tmp_path / "more.ttl"
    more.write_text("<e:weight> a <http://www.w3.org/2002/07/owl#DatatypeProperty> .", encoding="utf-8")
    store = ("--store", tmp_path / "store")
    result = run("tell", "Mug1", "weight", "--map", write_map(), "--ontology", more, *store, "--", value)
    assert result.exit_code == 0, result.stderr
    assert run("sparql", f"ASK {{ ?mug <e:weight> {literal} }}", *store).stdout == "yes\n"


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("tell", "a", "b", "c"), "the statement would not be stored; give one of --store DIR, --endpoint URL and -o"),
        (("tell", "a", "b", "c", "-o", "x.ttl", "--store", "x"), "a statement is stored in one target; give one of"),
        (("tell", "Bredbasket", "type", "Bread", "-o", "{tmp}/x.ttl"), "'Bredbasket' is known; near: 'Breadbasket'"),
        (("tell", "Bread", "type", "Food", "-o", "{tmp}/x.owl"), "call it .ttl"),
        (("tell", "Bread", "type", "Perishable", "-o", "{tmp}/no/x.ttl"), "{tmp}/no/x.ttl"),
        (("tell", "Bread", "type", "Perishable", "--endpoint", "http://127.0.0.1:{closed}/"), "does not answer"),
        (
            ("ask", "maps", "--endpoint", "http://127.0.0.1:{closed}/query"),
            "does not answer: Connection refused; check",
        ),
        (("ask", "maps", "--endpoint", "kitchen"), "it is no address of HTTP; give one such as http://localhost:7878"),
        (
            ("ask", "maps", "--endpoint", "http://h/", "--store", "{tmp}/s"),
            "in a folder or at an endpoint, not in both",
        ),
        (("ask", "maps", "--store", "{tmp}"), "there are other files in it; name a new folder"),
        (("ask", "maps", "--store", "{tmp}/mine.txt"), "mine.txt cannot be used"),
        (("ask", "what_isnt", "--store", "{tmp}/s"), "no question 'what_isnt'; near: 'what_is'"),
        (("ask", "what_is", "a", "b", "c", "--store", "{tmp}/s"), "one argument too many"),
        (("sparql", ENDLESS, "--timeout", "0.1"), "the query did not end within 0.1 s; limit the result (LIMIT)"),
        (("sparql", ENDLESS, "--timeout", "0.1", "--store", "{tmp}/s"), "the query did not end within 0.1 s"),
        (("sparql", "ASK { SERVICE <http://127.0.0.1:9/> {} }"), "nothing is fetched unasked; allow it with"),
        (("sparql", "DELETE WHERE { ?a ?b ?c }", "--store", "{tmp}/s"), "it is an update (DELETE), and queries only"),
    ],
)
def test_errors_exit_2_with_a_remedy(
    args: tuple[str, ...], message: str, run: Run, vocabulary: tuple[object, ...], tmp_path: Path
) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    vocabulary = vocabulary if args[0] == "tell" else ()
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))  # without listening
        names = {"{tmp}": str(tmp_path), "{closed}": str(closed.getsockname()[1])}
        for name, value in names.items():
            args, message = tuple(arg.replace(name, value) for arg in args), message.replace(name, value)
        result = run(*args, *vocabulary)
        assert result.exit_code == 2
        assert message in result.stderr
        assert "Traceback" not in result.stderr
        assert message in json_output(run(*args, *vocabulary, "--json"))["error"]["message"]
