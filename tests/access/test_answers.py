"""No answer to a client of a port, and nothing that is published, has a path of this machine."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

import mindstage as ms
from mindstage import Simulation
from mindstage.bridge import LocalNode, RosbridgeServer
from mindstage.ros import RosInterface
from mindstage.viewer import Viewer
from tests.bridge.raw_client import RawClient
from tests.viewer.page_client import RequestFailedError, connect_page_client
from tests.viewer.waiting import wait_until

BROKEN = "@prefix : <#> . this is no map"
URDF = '<robot name="r"><link name="l"><visual><geometry><mesh filename="{}"/></geometry></visual></link></robot>'


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of files that cannot be loaded."""
    path = tmp_path_factory.mktemp("worlds")
    (path / "broken.ttl").write_text(BROKEN)
    (path / "empty.owl").write_text("")
    (path / "binary.owl").write_bytes(bytes(range(256)))
    (path / "missing_mesh.urdf").write_text(URDF.format("meshes/none.stl"))
    (path / "elsewhere.urdf").write_text(URDF.format("file:///etc/hostname.stl"))
    (path / "imports.owl").write_text(
        '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#" xmlns:owl="http://www.w3.org/2002/07/owl#">'
        '<owl:Ontology rdf:about=""><owl:imports rdf:resource="none.owl"/></owl:Ontology></rdf:RDF>'
    )
    (path / "locked.owl").write_text(BROKEN)
    (path / "locked.owl").chmod(0)
    return path


@pytest.fixture(scope="module")
def simulation(folder: Path) -> Iterator[Simulation]:
    with ms.open("bundled:kitchen", engine="null") as simulation:
        yield simulation


def secrets_of(folder: Path) -> list[str]:
    """The beginnings of paths that must not occur."""
    found = {str(Path.cwd()), tempfile.gettempdir() + "/", str(folder), str(Path(ms.__file__).parent)}
    return sorted(found | {os.path.expanduser("~") + "/"} - {"//"})


def requests_of_ros(folder: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    files = sorted(each.name for each in folder.iterdir())
    for name in (*files, "none.owl", "../x.owl", "a\x00b.owl"):
        yield "/unreal/load_world", {"uri": name}
        yield "/unreal/load_world", {"world_resource": {"uri": name}}
        yield "/unreal/spawn_entity", {"name": "x", "uri": name}
        yield "/unreal/spawn_entity", {"name": "x", "entity_resource": {"uri": name}}
        yield "/unreal/mindstage/add_robot", {"source": name}
        yield "/unreal/mindstage/record", {"command": "start", "name": name}
        yield "/unreal/mindstage/spawn_map", {"map": name}
    for text in (
        BROKEN,
        "<robot/>",
        URDF.format("file:///etc/x.stl"),
        URDF.format("none.stl"),
        "<mujoco><x/></mujoco>",
    ):
        yield "/unreal/spawn_entity", {"name": "x", "resource_string": text}
        yield "/unreal/spawn_entity", {"name": "x", "entity_resource": {"resource_string": text}}
        yield "/unreal/load_world", {"resource_string": text}
        yield "/unreal/load_world", {"world_resource": {"resource_string": text}}
    for service in ("/mindstage/ask", "/unreal/mindstage/query", "/mindstage/query"):
        yield service, {"question": "no_such", "args": "{"}
        yield service, {"kind": "sparql", "text": "SELECT ?x FROM <file:///etc/hostname> {?x ?y ?z}"}


def requests_of_page(folder: Path, methods: list[str]) -> Iterator[tuple[str, dict[str, Any]]]:
    for method in methods:
        yield method, {"nonsense": 1}
    yield "load", {"name": "broken.ttl", "text": BROKEN}
    yield "load", {"name": "r.urdf", "text": URDF.format("file:///etc/x.stl")}
    yield "load", {"name": "r.urdf", "text": "<robot"}
    yield "load", {"name": str(folder / "x.owl"), "text": "<x/>"}
    yield "paste", {"text": BROKEN}
    for name in (str(folder / "none.urdf"), "none.urdf", "elsewhere.urdf"):
        yield "robots.add", {"model": name}
    yield "ask.sparql", {"query": "SELECT ?x FROM <file:///etc/hostname> {?x ?y ?z}"}
    yield "ask.prolog", {"line": "consult('/etc/hostname')."}
    yield "ask", {"question": "no_such", "args": {}}
    yield "plan.evaluate", {"plan": "include: /etc/hostname"}
    yield "save", {"format": "none"}


def without_request(answer: str, request: object) -> str:
    """An answer without the names in the request."""
    for text in [request] if isinstance(request, str) else request.values() if isinstance(request, dict) else ():
        answer = without_request(answer, text) if isinstance(text, dict) else answer.replace(str(text), "")
    return answer


def test_no_answer_over_ros_has_a_path(simulation: Simulation, folder: Path, tmp_path: Path) -> None:
    with ExitStack() as stack:
        node = stack.enter_context(LocalNode())
        episodes = tmp_path / "episodes"
        episodes.write_text("a file, so that no episode can be recorded")
        stack.enter_context(RosInterface(simulation, node, folder=folder, episodes=episodes))
        server = stack.enter_context(RosbridgeServer(node, port=0))
        client = RawClient(server.url)
        stack.callback(client.close)
        client.send_operation(op="subscribe", topic="/mindstage/diagnostics")
        failures = 0
        for service, args in requests_of_ros(folder):
            answer = client.call_service(service, args)
            failures += not answer["result"] or "error_message" in str(answer)
            for each in (answer, *client.received):
                text = without_request(json.dumps(each), args)
                assert not [path for path in secrets_of(folder) if path in text], (service, args, text[:1000])
            client.received.clear()
    assert failures > 20


def test_no_answer_on_the_page_has_a_path(simulation: Simulation, folder: Path) -> None:
    failures = []
    with Viewer(simulation, port=0) as viewer, connect_page_client(viewer.url) as page:
        methods = [each.name for each in viewer.channel.entry_points()]
        for method, arguments in requests_of_page(folder, methods):
            try:
                page.ask(method, **arguments)
            except RequestFailedError as error:
                failures.append(without_request(str(error), arguments))
        failures.append(json.dumps(page.events))
    assert len(failures) > 60
    for text in failures:
        assert not [each for each in secrets_of(folder) if each in text], text[:1000]


class FailingController:
    """Fails in each step, with an error that names a file."""

    period_s = 0.01
    is_active = True

    def update(self, *_: Any) -> None:
        raise OSError(28, "No space left on device", f"{tempfile.gettempdir()}/arena/blocks.bin")


def test_a_fault_of_the_simulation_is_shown_without_its_path() -> None:
    with (
        ms.open("bundled:kitchen") as simulation,
        Viewer(simulation, port=0) as viewer,
        connect_page_client(viewer.url) as page,
    ):
        simulation.add_controller("broken", FailingController())
        simulation.play()
        wait_until(lambda: (page.latest_value("clock") or {}).get("fault"), "the fault is shown")
        fault = page.latest["clock"]["fault"]
    assert "blocks.bin" in fault
    assert tempfile.gettempdir() not in fault
