"""Knowledge that outlives a command: folders, endpoints, told files; each command is one of its own."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.typed import Run, WriteMap, json_output

CONTAINER_FOR = "typePrimaryFunction-containerFor"
ENDLESS = "SELECT (COUNT(*) AS ?n) WHERE { ?a ?b ?c . ?d ?e ?f . ?g ?h ?i }"

_WORDS = f"""@prefix k: <http://knowrob.org/kb/knowrob.owl#> . @prefix owl: <http://www.w3.org/2002/07/owl#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
k:{CONTAINER_FOR} a owl:ObjectProperty . k:Perishable a owl:Class . k:Breadbasket a owl:Class .
k:Bread a owl:Class ; rdfs:subClassOf k:Perishable .
k:Refrigerator a owl:Class ; rdfs:subClassOf
    [ a owl:Restriction ; owl:onProperty k:{CONTAINER_FOR} ; owl:someValuesFrom k:Perishable ] .
"""


@pytest.fixture
def words(tmp_path: Path) -> tuple[object, ...]:
    """A robot that knows of breadbaskets, but not what they are for."""
    path = tmp_path / "words.ttl"
    path.write_text(_WORDS, encoding="utf-8")
    return "--no-bundled-ontology", "--ontology", path


def places(run: Run, *args: object) -> list[str]:
    result = run("ask", "storage_place", "Bread", *args, "--json")
    return [answer["place"].rpartition("#")[2] for answer in json_output(result)["answers"]]


@pytest.mark.parametrize(
    ("keeping", "having"),
    [(("-o", "told.ttl"), ("--ontology", "told.ttl")), (("--store", "known"), ("--store", "known"))],
)
def test_bread_goes_into_the_breadbasket_once_somebody_said_so(
    keeping: tuple[str, str], having: tuple[str, str], words: tuple[object, ...], tmp_path: Path
) -> None:
    """In the shell itself, with a process for each command."""

    def shell(*args: object) -> str:
        command = [sys.executable, "-m", "mindstage", *map(str, args)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, cwd=tmp_path, check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout

    def asked(*args: object) -> list[str]:
        answers = json.loads(shell("ask", "storage_place", "Bread", "--json", *words, *args))["answers"]
        return [answer["place"].rpartition("#")[2] for answer in answers]

    assert asked() == ["Refrigerator"]
    told = shell("tell", "Breadbasket", CONTAINER_FOR, "Bread", *words, *keeping)
    assert told == f"told: Breadbasket {CONTAINER_FOR} Bread\n"
    assert asked(*having) == ["Breadbasket", "Refrigerator"]


def test_a_folder_does_without_its_sources(run: Run, tmp_path: Path, write_map: WriteMap) -> None:
    store, map = tmp_path / "store", write_map(mugs={"Mug1": "1 2 3"})
    assert json_output(run("ask", "maps", "--store", store, "--map", map, "--json"))["answers"][0]["individuals"] == 1
    map.unlink()
    (thing,) = json_output(run("ask", "what_is", "Mug1", "--store", store, "--json"))["answers"]
    assert thing["pose"]
    assert run("sparql", "ASK { ?mug a knowrob:Mug }", "--store", store).stdout == "yes\n"


def test_a_map_that_has_changed_is_read_anew_and_that_is_said(run: Run, tmp_path: Path, write_map: WriteMap) -> None:
    store, map = tmp_path / "store", write_map(mugs={"Mug1": "1 2 3"})
    run("ask", "maps", "--store", store, "--map", map)
    write_map(mugs={"Mug1": "1 2 3", "Mug2": "1 2 3"})
    result = run("ask", "maps", "--store", store, "--json")
    assert json_output(result)["answers"][0]["individuals"] == 2
    assert json_output(result)["findings"][0]["did"] == "it was read anew"
    assert not json_output(run("ask", "maps", "--store", store, "--json"))["findings"]


def test_what_is_told_can_be_taken_back(run: Run, words: tuple[object, ...], tmp_path: Path) -> None:
    statement = ("Breadbasket", CONTAINER_FOR, "Bread")
    store = ("--store", tmp_path / "store")
    result = run("tell", *statement, *words, *store, "--json")
    assert result.exit_code == 0
    assert json_output(result) == {
        "done": True,
        "statement": {"subject": "Breadbasket", "property": CONTAINER_FOR, "value": "Bread"},
        "where": str(tmp_path / "store"),
        "findings": [],
    }
    assert run("tell", *statement, *store).stdout.startswith("known already: ")
    assert places(run, *store) == ["Breadbasket", "Refrigerator"]
    assert run("tell", "--retract", *statement, *store).stdout.startswith("taken back: ")
    again = run("tell", "--retract", *statement, *store)
    assert (again.exit_code, again.stdout.split(":")[0]) == (1, f"nobody says in {tmp_path / 'store'}")
    assert places(run, *store) == ["Refrigerator"]


@pytest.mark.parametrize(
    ("typed", "written"),
    [("2.5", "2.5e0"), ("3", "3"), ("-1e3", "-1e3"), ("true", "true"), ('"3"', '"3"'), ("heavy", '"heavy"')],
)
def test_a_value_is_what_it_looks_like(typed: str, written: str, run: Run, tmp_path: Path, write_map: WriteMap) -> None:
    more = tmp_path / "more.ttl"
    more.write_text("<e:weight> a <http://www.w3.org/2002/07/owl#DatatypeProperty> .", encoding="utf-8")
    store = ("--store", tmp_path / "store")
    result = run("tell", "Mug1", "weight", "--map", write_map(), "--ontology", more, *store, "--", typed)
    assert result.exit_code == 0, result.stderr
    assert run("sparql", f"ASK {{ ?mug <e:weight> {written} }}", *store).stdout == "yes\n"


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("tell", "a", "b", "c"), "it would be forgotten at once; give one of --store DIR, --endpoint URL and -o"),
        (("tell", "a", "b", "c", "-o", "x.ttl", "--store", "x"), "it can stay in one place at a time; give one of"),
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
def test_trouble_ends_with_2_and_says_what_to_do(
    args: tuple[str, ...], message: str, run: Run, words: tuple[object, ...], tmp_path: Path
) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))  # and nobody listens
        names = {"{tmp}": str(tmp_path), "{closed}": str(closed.getsockname()[1])}
        for name, value in names.items():
            args, message = tuple(arg.replace(name, value) for arg in args), message.replace(name, value)
        result = run(*args, *(words if args[0] == "tell" else ()))
        assert result.exit_code == 2
        assert message in result.stderr
        assert "Traceback" not in result.stderr
        assert message in json_output(run(*args, *(words if args[0] == "tell" else ()), "--json"))["error"]["message"]
