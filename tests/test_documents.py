"""The code blocks of the documents run, their commands parse, and their links and pictures exist.

The code of docs/how-to/prolog.md is run by tests/prolog, that of docs/how-to/furnishing.md by tests/geometry and
tests/simulation.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from mindstage.cli.app import app
from mindstage.maps import bundled_kitchen, bundled_ontology
from mindstage.scene.edits import Spawn
from tests.cases import each_case
from tests.kitchenette import kitchenette
from tests.knowledge.sparql_server import SparqlServer

ROOT = Path(__file__).resolve().parent.parent
DOCUMENTS = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]


def page(name: str) -> str:
    return (ROOT / "docs" / name).read_text(encoding="utf-8")


README = (ROOT / "README.md").read_text(encoding="utf-8")
CONTRIBUTING = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
ASKING = page("how-to/asking.md")
CURRENT_STATE = page("how-to/current-state.md")
STORES = page("how-to/stores.md")
ENDPOINT = "http://localhost:7878/query"


def blocks(language: str, text: str = README) -> list[str]:
    """The code blocks of a document, also those inside of lists, without their indentation."""
    found = re.findall(rf"^( *)```{language}\n(.*?)^ *```$", text, re.MULTILINE | re.DOTALL)
    return [re.sub(rf"^{indentation}", "", code, flags=re.MULTILINE) for indentation, code in found]


def run_python(code: str, folder: Path) -> list[str]:
    """Runs a program in a folder and returns the lines that it prints."""
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=False, timeout=120
    )
    assert result.returncode == 0, result.stderr
    return result.stdout.splitlines()


# -- Python ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("code", blocks("python"))
def test_the_python_of_the_readme_prints_what_its_comments_state(code: str, tmp_path: Path) -> None:
    # A comment after a print is its output, up to a colon.
    expected = re.findall(r"^\s*print\(.*\)  # (.+?)(?::.*)?$", code, re.MULTILINE)
    assert expected
    assert run_python(code, tmp_path) == expected


@pytest.mark.parametrize(
    ("name", "least"),
    [
        ("how-to/asking.md", 7),
        ("how-to/current-state.md", 7),
        ("how-to/episode-replay.md", 4),
        ("how-to/robot-motion.md", 4),
        ("tutorial/first-hour.md", 3),
        ("tutorial/imagination.md", 10),
        ("tutorial/robot.md", 7),
        ("how-to/robots.md", 10),
        ("how-to/robot-learning.md", 6),
    ],
)
def test_the_python_of_a_page_prints_what_its_comments_state(name: str, least: int, tmp_path: Path) -> None:
    """All blocks of a page are one program."""
    code = "".join(blocks("python", page(name)))
    expected = re.findall(r"^(?:\s*print\(.*\)  )?# (.+)$", code, re.MULTILINE)
    assert len(expected) >= least
    assert run_python(code, tmp_path) == expected


def test_the_map_of_the_page_about_own_maps_is_complete(tmp_path: Path) -> None:
    own_map = page("how-to/own-map.md")
    room, own_class = blocks("turtle", own_map)
    room += own_class + ":mug a :MugOfMine ; knowrob:describedInMap :room ; knowrob:pose [ a knowrob:Pose ;\n"
    room += '    knowrob:translation "1.0 1.0 0.77" ; knowrob:quaternion "1 0 0 0" ] .\n'
    (tmp_path / "room.ttl").write_text(room, encoding="utf-8")
    (code,) = blocks("python", own_map)
    assert run_python(code, tmp_path) == ["['table', 'floor']", "True"]
    result = CliRunner().invoke(app, ["validate", str(tmp_path / "room.ttl"), "--json"])
    assert json.loads(result.stdout)["findings"] == []


@pytest.mark.parametrize(
    "name", ["index.md", "reference/python/index.md", "reference/shapes.md", "how-to/many-samples.md", "how-to/gpu.md"]
)
def test_the_python_of_a_page_without_promised_output_runs(name: str, tmp_path: Path) -> None:
    assert blocks("python", page(name))
    run_python("".join(blocks("python", page(name))), tmp_path)


def test_the_python_about_stores_runs(tmp_path: Path, oxigraph: Path) -> None:
    server = SparqlServer(oxigraph)
    try:
        code = "".join(blocks("python", STORES)).replace(ENDPOINT, server.url)
        run_python(f"from mindstage.knowledge import KnowledgeBase\n{code}", tmp_path)
    finally:
        server.stop()


def test_the_python_about_remote_engines_runs() -> None:
    from mindstage import KnowledgeBase, MujocoEngine, NullEngine, Simulation
    from mindstage.bridge import LocalNode, RosbridgeServer
    from mindstage.ros import RosInterface

    drives, code = blocks("python", page("how-to/engines.md"))
    with contextlib.closing(MujocoEngine()) as engine:
        engine.apply(Spawn(kitchenette()))
        drives = drives.replace("drawer_slide", "DrawerSlide").replace('"drawer"', '"Drawer"').replace("0.3}", "-0.3}")
        exec(compile(drives, "engines.md", "exec"), {"engine": engine})
        assert abs(engine.actuator_states()["pull"].position) == pytest.approx(0.3, abs=0.01)
    with contextlib.ExitStack() as stack:
        sim = stack.enter_context(Simulation(KnowledgeBase(), NullEngine()))
        node = stack.enter_context(LocalNode())
        server = stack.enter_context(RosbridgeServer(node, port=0))
        stack.callback(RosInterface(sim, node).close)
        assert "ros://127.0.0.1:9090/" in code
        namespace: dict[str, Any] = {}
        exec(compile(code.replace("127.0.0.1:9090", server.url.removeprefix("ws://")), "engines.md", "exec"), namespace)
        namespace["engine"].close()


def test_the_python_about_ros_runs() -> None:
    from mindstage import KnowledgeBase, MujocoEngine, Simulation
    from mindstage.bridge import LocalNode, RosbridgeServer
    from mindstage.ros import RosInterface

    code = re.findall(r"^    (with Simulation.*\n {8}\.\.\.\n)", page("how-to/ros.md"), re.MULTILINE)
    assert len(code) == 1
    assert "RosbridgeServer(node)" in code[0]
    names = {each.__name__: each for each in (MujocoEngine, Simulation, LocalNode, RosbridgeServer, RosInterface)}
    with KnowledgeBase() as knowledge:
        text = re.sub(
            r"^    ", "", code[0].replace("RosbridgeServer(node)", "RosbridgeServer(node, port=0)"), flags=re.M
        )
        exec(compile(text, "ros.md", "exec"), {**names, "knowledge": knowledge})


def test_the_python_about_godot_runs(godot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import mindstage as ms

    monkeypatch.chdir(tmp_path)
    (code,) = blocks("python", page("how-to/godot.md"))
    exec(compile(code, "godot.md", "exec"), {"world": ms.load("bundled:kitchen")})
    assert (tmp_path / "kitchen.tscn").is_file()


RECIPES = {
    "def open": "from __future__ import annotations\nfrom mindstage.simulation import JointMotion\n",
    "def supported_by": "from mindstage.knowledge.queries.spatial import *\n"
    "from collections.abc import Iterator\n"
    "from mindstage.knowledge.questions import *\n",
    "def extent": "from mindstage.cli.options import AsJson, ExitCode, MapArgument\n",
    "class TestMyEngine": "import pytest\n"
    "from mindstage.engines import NullEngine as MyEngine\n"
    "from tests.engines.contract import DescriptionContract\n"
    "from tests.engines.geometry_contract import GeometryDescriptionContract\n",
    "class Tray": "from mindstage.geometry.procedural.builder import GeometryBuilder, Length, ShapeTemplate\n",
}
"""The imports that each recipe of the contributor guide leaves out."""


@each_case("definition", RECIPES)
def test_the_python_of_a_recipe_runs(definition: str) -> None:
    (code,) = [code for code in blocks("python", CONTRIBUTING) if definition in code]
    run_python(RECIPES[definition] + code, ROOT)


def test_every_recipe_in_python_is_run() -> None:
    assert len(blocks("python", CONTRIBUTING)) == len(RECIPES)


# -- shell -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("script", [block for block in blocks("sh") if "mindstage " in block])
def test_the_shell_of_the_readme_runs(script: str, tmp_path: Path) -> None:
    commands = [line for line in script.splitlines() if line.startswith("mindstage ")]
    assert commands
    # `mindstage` of the Python that runs this test; the variable ends `mindstage demo`.
    environment = os.environ | {
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "MINDSTAGE_DEMO_SECONDS": "1",
    }
    result = subprocess.run(
        ["bash", "-euc", "\n".join(commands)],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr


def test_the_shell_about_asking_ends_with_the_stated_codes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, oxigraph: Path
) -> None:
    """The commands run one after the other, in one folder; the endpoint is a real server at another address."""
    monkeypatch.chdir(tmp_path)
    server = SparqlServer(oxigraph)
    try:
        server.load_files(bundled_kitchen(), bundled_ontology())
        for line in "".join([*blocks("sh", ASKING), *blocks("sh", CURRENT_STATE), *blocks("sh", STORES)]).splitlines():
            command, _, expected = line.partition("  # ends with ")
            code, _, message = expected.partition(": ")
            arguments = shlex.split(command.replace(ENDPOINT, server.url))
            assert arguments[0] == "mindstage"
            result = CliRunner().invoke(app, arguments[1:], prog_name="mindstage")
            assert result.exit_code == int(code or 0), f"{line}\n{result.output}"
            assert message in result.output
    finally:
        server.stop()


def test_the_json_of_the_reference_is_what_the_command_prints() -> None:
    text = page("reference/json-output.md")
    (command,), (expected,) = blocks("sh", text), blocks("json", text)
    result = CliRunner().invoke(app, shlex.split(command)[1:], prog_name="mindstage")
    assert json.loads(result.stdout) == json.loads(expected)


def commands() -> list[str]:
    """Every line with a complete `mindstage` command in a document."""
    lines = {line for path in DOCUMENTS for line in path.read_text(encoding="utf-8").splitlines()}
    found = {match[1] for line in lines if (match := re.fullmatch(r" *(mindstage [a-z]+\b[^`…]*?)(?:  +# .*)?", line))}
    return sorted(line for line in found if not re.search(r"\[[A-Z-]", line))  # a synopsis has options in brackets


@each_case("line", commands())
def test_every_command_of_the_documents_parses(line: str) -> None:
    group: Any = typer.main.get_command(app)
    verb, *arguments = shlex.split(line)[1:]
    parsed = group.commands[verb]
    if hasattr(parsed, "commands"):
        verb, *arguments = arguments
        parsed = parsed.commands[verb]
    parsed.make_context(verb, arguments)


# -- text --------------------------------------------------------------------------------------------------------------


def test_the_pages_have_at_most_their_lines() -> None:
    assert len(ASKING.splitlines()) <= 150
    assert len(README.splitlines()) <= 120
    assert len(blocks("python")) >= 1


@each_case("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_and_pictures_exist(path: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", path.read_text(encoding="utf-8")):
        if "://" not in target:
            assert (path.parent / target).exists(), f"{path.name} names {target}"


def test_every_verb_of_the_command_line_is_in_the_readme() -> None:
    group: Any = typer.main.get_command(app)
    for name, verb in group.commands.items():
        if not verb.hidden:
            assert re.search(rf"\bmindstage {name}\b", README), name
