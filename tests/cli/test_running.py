"""`--running`: queries of the shell that a running simulation answers."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
from typer.testing import CliRunner

from mindstage.bridge import LocalNode, RosbridgeServer
from mindstage.cli.app import app
from mindstage.engines import NullEngine
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import bundled_kitchen
from mindstage.prolog import PrologConsole, is_installed
from mindstage.ros import RosInterface
from mindstage.ros.queries import QueryServer
from mindstage.run_records import RunRecord, running_simulations
from mindstage.scene import BodyId
from mindstage.scene.edits import SetPoses
from mindstage.simulation import Simulation
from tests.cli.runner import Run, json_output

KITCHEN = ("--map", "bundled:kitchen")
UNPLACED = """<owl:NamedIndividual rdf:about="http://mindstage.org/maps/kitchen.owl#lost_cup">
  <rdf:type rdf:resource="http://knowrob.org/kb/knowrob.owl#Cup"/>
  <knowrob:describedInMap rdf:resource="http://mindstage.org/maps/kitchen.owl#kitchen"/>
</owl:NamedIndividual>"""
"""An individual without a pose, which is a finding."""
needs_prolog = pytest.mark.skipif(not is_installed() and not os.environ.get("CI"), reason="Prolog is not installed")


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A cache of these tests alone, so that they find no other simulations."""
    folder = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MINDSTAGE_CACHE", str(folder))
        patch.delenv("MINDSTAGE_TOKEN", raising=False)
        yield folder


@pytest.fixture(scope="module")
def kitchen(cache: Path) -> Iterator[Simulation]:
    """A running kitchen."""
    knowledge = KnowledgeBase()
    knowledge.load(bundled_kitchen())
    with Simulation(knowledge, NullEngine()) as simulation:
        simulation.spawn()
        assert QueryServer.start(simulation) is not None
        yield simulation


@pytest.fixture(scope="module")
def address(kitchen: Simulation) -> Iterator[str]:
    """The kitchen at a rosbridge with a token, in the namespace `lab`."""
    with (
        LocalNode() as node,
        RosInterface(kitchen, node, namespace="lab"),
        RosbridgeServer(node, port=0, token="secret") as server,
    ):
        yield f"ros://127.0.0.1:{server.port}"


@pytest.fixture
def empty_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("MINDSTAGE_CACHE", str(tmp_path))
    return tmp_path


# -- answers -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "args",
    [
        ["ask", "handle_of", "fridge_door"],
        ["ask", "storage_place", "CowsMilk", "--why"],
        ["ask", "storage_place", "Cup"],
    ],
    ids=" ".join,
)
def test_the_output_is_that_of_the_loaded_map(run: Run, kitchen: Simulation, args: list[str]) -> None:
    here, there = run(*args, *KITCHEN), run(*args, "--running")
    assert (there.exit_code, there.stdout) == (here.exit_code, here.stdout)


@pytest.mark.parametrize(
    "args",
    [
        ["ask", "part_of", "fridge_door", "--why"],
        ["ask", "storage_place", "Cup"],
        ["ask", "where is the milk?"],
        ["sparql", "SELECT ?x { ?x rdfs:subClassOf knowrob:Door } ORDER BY ?x"],
        ["sparql", "ASK { knowrob:Door rdfs:subClassOf knowrob:Cup }"],
    ],
    ids=" ".join,
)
def test_the_json_is_that_of_the_loaded_map(run: Run, kitchen: Simulation, args: list[str]) -> None:
    expected, received = json_output(run(*args, *KITCHEN, "--json")), json_output(run(*args, "--running", "--json"))
    assert received.pop("running").startswith(f"{os.getpid()} (kitchen")
    if "assumptions" in expected:  # those of the map are known from the spawning on
        assert received.pop("assumptions")
        expected.pop("assumptions")
    for row in [*expected.get("answers", ()), *received.get("answers", ())]:
        row.pop("source", None)
    assert received == expected


def test_a_question_about_poses_has_the_assumptions_of_the_map(run: Run, kitchen: Simulation) -> None:
    args = ("ask", "where_is", "milk_carton_1", "--json")
    expected, received = json_output(run(*args, *KITCHEN)), json_output(run(*args, "--running"))
    assert expected["assumptions"]
    assert received["assumptions"] == expected["assumptions"]


@needs_prolog
def test_the_json_of_prolog_is_that_of_the_loaded_map(run: Run, kitchen: Simulation) -> None:
    goal = ("--goal", "handle_of(_, fridge_door, X)", "--json")
    here = subprocess.run(
        [sys.executable, "-m", "mindstage", "prolog", "bundled:kitchen", *goal], capture_output=True, check=True
    )
    received = json_output(run("prolog", "--running", *goal))
    assert received.pop("running")
    assert received == msgspec.json.decode(here.stdout)


def test_findings_about_the_maps_are_in_the_json(run: Run, empty_cache: Path, tmp_path: Path) -> None:
    text = bundled_kitchen().read_text(encoding="utf-8").replace("</rdf:RDF>", f"{UNPLACED}</rdf:RDF>")
    file = tmp_path / "kitchen.owl"
    file.write_text(text, encoding="utf-8")
    knowledge = KnowledgeBase()
    knowledge.load(file)
    with Simulation(knowledge, NullEngine()) as simulation:
        simulation.spawn()
        assert QueryServer.start(simulation) is not None
        for args in (["ask", "where_is", "milk_carton_1"], ["sparql", "ASK {}"]):
            there = json_output(run(*args, "--running", "--json"))
            assert [each["individual"].partition("#")[2] for each in there["findings"]] == ["lost_cup"], args
        here = json_output(run("ask", "where_is", "milk_carton_1", "--map", str(file), "--json"))
        assert here["findings"] == there["findings"]


def test_the_answers_are_those_of_the_present_state(run: Run, kitchen: Simulation) -> None:
    milk = BodyId("milk_carton_1")
    before = kitchen.snapshot().body(milk).pose
    assert before is not None
    raised = msgspec.structs.replace(before, position=(before.position[0], before.position[1], 9.0))
    assert "fridge" in run("ask", "where_is", "milk_carton_1", "inside", "--running").stdout
    kitchen.engine.run(lambda engine: engine.apply(SetPoses({milk: raised})), label="move", edits=True)
    try:
        moved = run("ask", "where_is", "milk_carton_1", "inside", "--running", "--json")
        assert (moved.exit_code, json_output(moved)["answers"]) == (1, [])
        height = (
            "SELECT ?at FROM <urn:mindstage:present> { kitchen:milk_carton_1 knowrob:pose/knowrob:translation ?at }"
        )
        (row,) = json_output(run("sparql", height, "--running", "--json"))["rows"]
        assert float(row["at"]["value"].split()[2]) == 9.0
    finally:
        kitchen.engine.run(lambda engine: engine.apply(SetPoses({milk: before})), label="move", edits=True)


def test_answers_are_highlighted_in_the_running_simulation(run: Run, kitchen: Simulation) -> None:
    args = ("ask", "storage_place_in_environment", "CowsMilk", "--running", "--highlight")
    assert "1 highlighted in " in run(*args, "green").stdout
    (group,) = kitchen.state.highlight_groups
    assert group.ids == ("fridge",)
    result = json_output(run(*args, "none", "--json"))
    assert (result["color"], result["highlighted"]) == ("none", [])
    assert kitchen.state.highlight_groups == ()


def test_errors_are_those_of_the_running_simulation(run: Run, kitchen: Simulation) -> None:
    unknown = run("ask", "handle_of", "frigde_door", "--running", "--json")
    assert unknown.exit_code == 2
    assert "no individual 'frigde_door' is known; near: 'fridge_door'" in unknown.stderr
    assert "frigde_door" in json_output(unknown)["error"]["message"]
    assert "SERVICE" in run("sparql", "SELECT * { SERVICE <http://x.example/> { ?s ?p ?o } }", "--running").stderr


@needs_prolog
def test_prolog_is_answered_with_the_limits_of_the_page(run: Run, kitchen: Simulation) -> None:
    found = run("prolog", "--running", "--goal", "handle_of(_, fridge_door, X)", "--json")
    (row,) = json_output(found)["solutions"]
    assert row["X"].endswith("#fridge_door_handle")
    assert run("prolog", "--running", "--goal", "1 > 2").exit_code == 1
    refused = run("prolog", "--running", "--goal", "shell(ls)")
    assert refused.exit_code == 2
    assert "shell/1 cannot be asked here" in refused.stderr
    cut = run("prolog", "--running", "--goal", "member(X, [1, 2, 3])", "--json", "--limit", 2)
    assert json_output(cut)["complete"] is False
    assert "the search stopped after 2 solutions" in cut.stderr


@needs_prolog
def test_an_open_console_of_the_same_simulation_is_used(run: Run, kitchen: Simulation) -> None:
    with PrologConsole(kitchen):
        assert run("prolog", "--running", "--goal", "handle_of(_, fridge_door, X)").exit_code == 0
        other = Simulation(KnowledgeBase(), NullEngine())
        with other:
            assert QueryServer.start(other) is not None
            port = next(record.port for record in running_simulations() if not record.maps)
            refused = run("prolog", f"--running={port}", "--goal", "true")
    assert "another console is open in this process" in refused.stderr


# -- addresses ---------------------------------------------------------------------------------------------------------


def test_an_address_takes_the_place_of_a_map(run: Run, address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    expected = run("ask", "handle_of", "fridge_door", "--running").stdout
    assert run("ask", "handle_of", "fridge_door", "--running", f"{address}?token=secret").stdout == expected
    monkeypatch.setenv("MINDSTAGE_TOKEN", "secret")
    assert run("ask", "handle_of", "fridge_door", "--map", address).stdout == expected
    assert run("ask", "--running", f"{address}/lab", "handle_of", "fridge_door").stdout == expected
    assert run("ask", "--running", "handle_of", "fridge_door").stdout == expected
    assert run("sparql", "ASK { ?x a ?y }", "--map", address).stdout == "yes\n"
    if is_installed():
        assert run("prolog", address, "--goal", "1 < 2").exit_code == 0


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("", "no access to ros://127.0.0.1:{port}/unreal: a token is required; add ?token=… to the address"),
        ("?token=wrong", "no access to ros://127.0.0.1:{port}/unreal"),
        ("/kitchen?token=secret", "has no service /kitchen/mindstage/query; is it Mindstage of this version?"),
    ],
)
def test_what_is_wrong_with_an_address_is_said(run: Run, address: str, path: str, message: str) -> None:
    result = run("ask", "handle_of", "--running", f"{address}{path}")
    assert result.exit_code == 2
    assert message.format(port=address.rpartition(":")[2]) in result.stderr
    assert "secret" not in result.stderr


def test_a_server_that_is_not_mindstage_is_an_error(run: Run, cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mindstage.cli.attach._CONNECT_TIMEOUT_S", 0.3)
    with LocalNode() as node, RosbridgeServer(node, port=0) as server:
        result = run("ask", "handle_of", "--running", f"ros://127.0.0.1:{server.port}")
    assert "the rosbridge there has no service /mindstage/query" in result.stderr
    with socket.create_server(("127.0.0.1", 0)) as silent:
        url = f"ros://127.0.0.1:{silent.getsockname()[1]}"
        result = run("ask", "handle_of", "--running", url)
    assert result.exit_code == 2
    assert f"no connection to {url}/unreal" in result.stderr
    assert "is the port that of its rosbridge?" in result.stderr
    closed = run("ask", "handle_of", "--running", url)
    assert f"no connection to {url}/unreal: Connect call failed" in closed.stderr


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (
            ["ask", "handle_of", "--running", "--map", "x.owl"],
            "--map: it has no effect on a simulation that is running",
        ),
        (["ask", "handle_of", "--running", "--units", "cm"], "--units: it has no effect"),
        (["ask", "handle_of", "--map", "ros://a", "--map", "ros://b"], "ros://a: it takes the place of all maps"),
        (["ask", "handle_of", "--map", "ros://a", "--running"], "ros://a: it takes the place of all maps"),
        (["sparql", "ASK {}", "--running", "--allow-service"], "--allow-service: it has no effect"),
        (["prolog", "--running", "--consult", "rules.pl"], "--consult: it has no effect"),
        (["ask", "handle_of", "--running=bathroom"], "no simulation with the process id or map 'bathroom' is running"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_options_of_the_simulation_itself_are_refused(
    run: Run, kitchen: Simulation, args: list[str], message: str
) -> None:
    result = run(*args)
    assert result.exit_code == 2
    assert message in result.stderr


# -- records -----------------------------------------------------------------------------------------------------------


def record(**changes: Any) -> RunRecord:
    return msgspec.structs.replace(RunRecord.of_this_process(port=1, token="t", maps=["kitchen"]), **changes)


@pytest.mark.skipif(os.name != "posix", reason="the permissions of POSIX")
@pytest.mark.parametrize("exists", [False, True])
def test_only_the_user_can_read_a_token_whatever_the_umask_and_earlier_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, exists: bool
) -> None:
    cache = tmp_path / "caches" / "mindstage"
    monkeypatch.setenv("MINDSTAGE_CACHE", str(cache))
    folder = cache / "running"
    before = os.umask(0)
    try:
        if exists:
            folder.mkdir(parents=True, mode=0o777)
            (folder / f"{os.getpid()}-1.json").write_text("{}", encoding="utf-8")
            (folder / f"{os.getpid()}-1.json").chmod(0o666)
        else:
            (tmp_path / "caches").mkdir()
        file = record(port=1).write()
    finally:
        os.umask(before)
    assert file.stat().st_mode & 0o777 == 0o600
    assert folder.stat().st_mode & 0o777 == 0o700
    assert exists or cache.stat().st_mode & 0o777 == 0o700
    assert [each.token for each in running_simulations()] == ["t"]
    assert list(folder.iterdir()) == [file]


@pytest.mark.skipif(os.name != "posix", reason="symbolic links")
def test_a_token_is_not_written_to_where_a_link_leads(empty_cache: Path, tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (empty_cache / "running").symlink_to(elsewhere)
    with pytest.raises(OSError, match="it is a link"):
        record().write()
    assert list(elsewhere.iterdir()) == []
    assert running_simulations() == ()


@pytest.mark.skipif(os.name != "posix", reason="the permissions of POSIX")
def test_a_served_simulation_keeps_its_token_private(tmp_path: Path) -> None:
    command = f"umask 0; exec {sys.executable} -m mindstage serve --engine null --port 0 --for 0.2 --json"
    watch = (
        "import os, sys, subprocess, pathlib\n"
        "server = subprocess.Popen(['sh', '-c', sys.argv[1]], stdout=subprocess.DEVNULL)\n"
        "modes = set()\n"
        "while server.poll() is None:\n"
        "    for file in pathlib.Path(os.environ['MINDSTAGE_CACHE'], 'running').glob('*'):\n"
        "        try: modes.add(oct(file.stat().st_mode & 0o777))\n"
        "        except FileNotFoundError: pass\n"
        "print(*modes)\n"
    )
    environment = os.environ | {"MINDSTAGE_CACHE": str(tmp_path / "cache")}
    seen = subprocess.run(
        [sys.executable, "-c", watch, command], env=environment, capture_output=True, text=True, timeout=120, check=True
    )
    assert seen.stdout.split() == ["0o600"], seen.stderr


def test_without_a_running_simulation_it_says_how_to_start_one(run: Run, empty_cache: Path) -> None:
    result = run("ask", "handle_of", "--running")
    assert result.exit_code == 2
    assert "no simulation is running on this machine; start one with mindstage demo" in result.stderr


def test_of_several_simulations_one_is_chosen(run: Run, empty_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mindstage.cli.attach._CONNECT_TIMEOUT_S", 0.3)
    record(port=1).write()
    record(port=2, maps=("bathroom",), page="http://127.0.0.1:8080").write()
    result = run("ask", "handle_of", "--running")
    assert "--running: 2 simulations are running; choose one" in result.stderr
    assert f"{os.getpid()} (bathroom, http://127.0.0.1:8080)" in result.stderr
    assert "(bathroom" in run("ask", "handle_of", "--running=bathroom").stderr
    assert "(bathroom" in run("ask", "handle_of", "--running=http://127.0.0.1:8080").stderr


def test_a_record_is_private_and_removed_when_the_simulation_is_closed(empty_cache: Path) -> None:
    with Simulation(KnowledgeBase(), NullEngine()) as simulation:
        server = QueryServer.start(simulation)
        assert server is not None
        assert QueryServer.start(simulation) is server
        (file,) = (empty_cache / "running").iterdir()
        assert file.stat().st_mode & 0o777 == 0o600
        assert running_simulations() == (server.record,)
    assert running_simulations() == ()
    assert not list((empty_cache / "running").iterdir())


def test_stale_records_are_recognized(empty_cache: Path) -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait(60)
    stale = [record(process=ended.pid, port=2).write(), record(started="another start", port=3).write()]
    elsewhere, unreadable = record(machine="elsewhere", port=4).write(), empty_cache / "running" / "5-5.json"
    unreadable.write_text("{", encoding="utf-8")
    alive = record()
    alive.write()
    assert running_simulations() == (alive,)
    assert not any(file.exists() for file in stale)
    assert elsewhere.exists(), "a home directory may be shared by machines"
    assert unreadable.exists(), "it may be of another version"


@needs_prolog
def test_a_prolog_toplevel_with_a_page_is_found_until_it_ends(empty_cache: Path) -> None:
    command = [sys.executable, "-m", "mindstage", "prolog", "bundled:kitchen", "--engine", "null"]
    process = subprocess.Popen(
        [*command, "--viewer", "--port", "0"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"MINDSTAGE_CACHE": str(empty_cache)},
    )
    assert process.stderr is not None
    line = next(iter(process.stderr))  # printed after the record is written
    (found,) = running_simulations()
    assert (found.process, found.maps) == (process.pid, ("kitchen",))
    assert found.page in line

    typed = "handle_of(_, fridge_door, X).\n shell(ls).\n% a comment\nmember(Y,\n  [1, 2]).\n1 > 2."
    done = CliRunner().invoke(app, ["prolog", "--running", "--limit", "1"], input=typed)
    assert done.exit_code == 2, "one query was refused"
    assert "fridge_door_handle" in done.stdout
    assert "│ 1 │" in done.stdout
    assert done.stdout.endswith("false.\n")
    assert "shell/1 cannot be asked here" in done.stderr
    assert "the search stopped after 1 solution;" in done.stderr

    process.communicate("halt.\n", timeout=60)
    assert process.returncode == 0
    assert not list((empty_cache / "running").iterdir())
