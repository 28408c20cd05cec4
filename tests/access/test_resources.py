"""What a text from outside may name: the same files at every port, and no answer shows whether another file exists."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import trimesh
from msgspec.structs import replace
from PIL import Image

import mindstage as ms
from mindstage import KnowledgeBase, MujocoEngine, Simulation
from mindstage.access.resources import GrantedFolder, from_outside, require_granted, without_paths
from mindstage.bridge import LocalNode
from mindstage.bridge.conversions import world_to_json
from mindstage.errors import MindstageError, ResourceRefusedError
from mindstage.maps import write_map
from mindstage.ros import RosInterface
from mindstage.scene import BodyId, GeometrySource, World
from mindstage.viewer import Viewer
from tests.bridge.raw_client import TIMEOUT_S
from tests.cases import each_case
from tests.kitchenette import kitchenette
from tests.viewer.page_client import RequestFailedError, connect_page_client

REFUSED = [
    "file:///ANY/part.stl",
    "FILE:///ANY/part.stl",
    "file://localhost/ANY/part.stl",
    "file://host/part.stl",
    "file:part.stl",
    "/ANY/part.stl",
    "%2FANY/part.stl",
    "../outside/part.stl",
    "a/../../outside/part.stl",
    "%2e%2e/outside/part.stl",
    "%252e%252e/outside/part.stl",
    "..\\outside\\part.stl",
    "C:\\part.stl",
    "\\\\host\\share\\part.stl",
    "//host/share/part.stl",
    "~/part.stl",
    "package://../part.stl",
    "package://pkg/../../outside/part.stl",
    "package:///ANY/part.stl",
    "package:part.stl",
    "http://localhost/part.stl",
    "https://localhost/part.stl",
    "ftp://localhost/part.stl",
    "data:model/stl;base64,AAAA",
    "/Game/../part.stl",
    "a\x00b.stl",
    "a\nb.stl",
]
GRANTED = ["part.stl", "meshes/part.stl", "package://pkg/meshes/part.stl", "/Game/Models/SM_Cup", "ä b.stl", ""]


@each_case("name", REFUSED)
def test_a_text_from_outside_does_not_name_it(name: str) -> None:
    with from_outside(), pytest.raises(ResourceRefusedError, match="is not granted"):
        require_granted([name])
    require_granted([name])  # the command line and Python may


@each_case("name", GRANTED)
def test_a_text_from_outside_may_name_it(name: str) -> None:
    with from_outside():
        require_granted([name, None])


def test_what_the_world_uses_already_is_granted() -> None:
    with from_outside():
        require_granted(["file:///a.stl"], known={"file:///a.stl"})


@dataclass
class Place:
    """A map with folders beside it: one that is granted, a package, and one outside with a mesh."""

    root: Path

    def __post_init__(self) -> None:
        for folder in ("map", "worlds", "packages/pkg", "outside"):
            (self.root / folder).mkdir(parents=True)
        for folder in ("map", "packages/pkg", "outside"):
            trimesh.creation.icosphere(1, 0.1).export(self.root / folder / "part.stl")
        for folder in ("map", "packages/pkg"):
            (self.root / folder / "link").symlink_to(self.root / "outside")
        (self.root / "worlds" / "link.urdf").symlink_to(self.root / "outside" / "robot.urdf")
        (self.root / "outside" / "robot.urdf").write_text(urdf("part.stl"), encoding="utf-8")
        (self.root / "packages/pkg/package.xml").write_text("<package/>", encoding="utf-8")
        (self.root / "map" / "map.owl").write_text(write_map(kitchenette()), encoding="utf-8")


def urdf(mesh: str) -> str:
    shape = f'<visual><geometry><mesh filename="{mesh}"/></geometry></visual>'
    return f'<robot name="x"><link name="a">{shape}</link></robot>'


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Place:
    return Place(tmp_path_factory.mktemp("place"))


@pytest.fixture(scope="module")
def simulation(place: Place) -> Iterator[Simulation]:
    with ExitStack() as stack:
        knowledge = stack.enter_context(KnowledgeBase())
        knowledge.load(place.root / "map" / "map.owl", ontologies=[place.root / "packages"])
        meshes = ms.saving.mesh_assets([], knowledge)
        simulation = stack.enter_context(Simulation(knowledge, MujocoEngine(), meshes=meshes))
        simulation.spawn()
        yield simulation


@pytest.fixture(scope="module")
def call(simulation: Simulation, place: Place) -> Iterator[Callable[..., Any]]:
    with LocalNode() as node, RosInterface(simulation, node, folder=place.root / "worlds"):

        def call(service: str, **args: Any) -> str:
            """The answer of a service or an action, as text, whether it is an error or not."""
            try:
                if service.endswith("spawn_map"):
                    goal = node.send_goal(f"/unreal/{service}", "mindstage_msgs/SpawnMap", args)
                    return str(goal.wait(TIMEOUT_S))
                return json.dumps(node.call_service(f"/unreal/{service}", args, timeout_s=TIMEOUT_S))
            except MindstageError as error:
                return str(error)

        yield call


def named(mesh: str, id: str) -> World:
    """A world with one body that names a mesh."""
    world = kitchenette()
    body = next(each for each in world.bodies if each.id == "Mug")
    return World(iri=world.iri, bodies=(replace(body, id=BodyId(id), iri=body.iri + id, mesh=mesh),))


def spawn_entity(call: Callable[..., Any], mesh: str, id: str) -> str:
    return str(call("spawn_entity", name=id, entity_resource={"uri": "", "resource_string": urdf(mesh)}))


def spawn_entities(call: Callable[..., Any], mesh: str, id: str) -> str:
    request = {"name": id, "entity_resource": {"uri": "", "resource_string": urdf(mesh)}}
    return str(call("spawn_entities", spawn_requests=[request]))


def spawn_robot(call: Callable[..., Any], mesh: str, id: str) -> str:
    return str(call("spawn_robot", id=id, name=urdf(mesh)))


def spawn_map_text(call: Callable[..., Any], mesh: str, id: str) -> str:
    text = write_map(named(mesh, id))
    return str(call("spawn_entity", name=id, entity_resource={"uri": "", "resource_string": text}))


def spawn_model(call: Callable[..., Any], mesh: str, id: str) -> str:
    path, _, name = mesh.rpartition("/")
    return str(call("spawn_model", id=id, name=name, path=path))


def spawn_world(call: Callable[..., Any], mesh: str, id: str) -> str:
    return str(call("mindstage/spawn_world", world=world_to_json(named(mesh, id))))


def spawn_map(call: Callable[..., Any], mesh: str, id: str) -> str:
    return str(call("mindstage/spawn_map", world=world_to_json(named(mesh, id))))


def load_world(call: Callable[..., Any], mesh: str, id: str) -> str:
    return str(call("load_world", world_resource={"uri": "", "resource_string": urdf(mesh)}))


SERVICES = [spawn_entity, spawn_entities, spawn_robot, spawn_map_text, spawn_model, spawn_world, spawn_map]


def outside_names(place: Place) -> dict[str, str]:
    """Names of a mesh outside, and the same names of a file that does not exist."""
    outside = place.root / "outside"
    return {
        f"file://{outside}/part.stl": f"file://{outside}/none.stl",
        f"{outside}/part.stl": f"{outside}/none.stl",
        "../outside/part.stl": "../outside/none.stl",
        "link/part.stl": "link/none.stl",
        "package://pkg/link/part.stl": "package://pkg/link/none.stl",
        "package://pkg/../../outside/part.stl": "package://pkg/../../outside/none.stl",
    }


@each_case("spawn", SERVICES, ids=lambda spawn: spawn.__name__)
def test_ros_clients_read_no_mesh_that_is_not_granted(
    spawn: Callable[..., str], call: Callable[..., Any], simulation: Simulation, place: Place
) -> None:
    for number, (existing, missing_name) in enumerate(outside_names(place).items()):
        ids = (f"e{spawn.__name__}{number}", f"m{spawn.__name__}{number}")
        answers = []
        for name, id in zip((existing, missing_name), ids, strict=True):
            answers.append(spawn(call, name, id))
            assert all(each.source is not GeometrySource.MESH for each in simulation.geometry.values()), existing
            call("mindstage/delete", ids=[each for each in simulation.state.ids if each.startswith(id)])
        first, second = (
            text.replace(id, "ID").replace("none.stl", "part.stl").replace("none", "part")
            for text, id in zip(answers, ids, strict=True)
        )
        assert first == second, existing
        assert str(place.root) not in first.replace(existing, ""), first


def test_ros_clients_name_files_of_packages(call: Callable[..., Any], simulation: Simulation) -> None:
    answer = json.loads(spawn_entity(call, "package://pkg/part.stl", "granted"))
    assert answer["result"]["result"] == 1, answer
    source = next(each.source for id, each in simulation.geometry.items() if id.startswith("granted"))
    assert source is GeometrySource.MESH
    call("delete_entity", entity="granted")


def test_files_that_a_mesh_refers_to_are_in_its_folder(
    call: Callable[..., Any], simulation: Simulation, place: Place
) -> None:
    package = place.root / "packages/pkg"
    secret = place.root / "outside" / "secret.png"
    for path in (package / "red.png", secret):
        Image.new("RGB", (4, 4), "red").save(path)
    for number, texture in enumerate(("red.png", "../../outside/secret.png", str(secret), "link/secret.png")):
        (package / f"t{number}.mtl").write_text(f"newmtl m\nmap_Kd {texture}\n", encoding="utf-8")
        lines = (f"mtllib t{number}.mtl", "v 0 0 0", "v 1 0 0", "v 0 1 0", "v 0 0 1", "vt 0 0", "usemtl m")
        faces = ("f 1/1 3/1 2/1", "f 1/1 2/1 4/1", "f 1/1 4/1 3/1", "f 2/1 3/1 4/1")
        (package / f"t{number}.obj").write_text("\n".join((*lines, *faces)) + "\n", encoding="utf-8")
        assert json.loads(spawn_entity(call, f"package://pkg/t{number}.obj", f"t{number}"))["result"]["result"] == 1
        geometry = next(each for id, each in simulation.geometry.items() if id.startswith(f"t{number}"))
        assert (geometry.visuals[0].image is not None) == (number == 0), texture
        call("delete_entity", entity=f"t{number}")


def test_links_out_of_the_granted_folder_are_not_followed(call: Callable[..., Any]) -> None:
    for uri in ("link.urdf", "file://link.urdf", "../outside/robot.urdf", "none.urdf", "/etc/passwd", "a\x00b"):
        answer = call("spawn_entity", name="x", entity_resource={"uri": uri, "resource_string": ""})
        assert "no map or file" in answer, (uri, answer)


def test_maps_and_bodies_from_the_page_name_no_files(simulation: Simulation, place: Place) -> None:
    before = simulation.state.ids
    with Viewer(simulation, port=0) as viewer, connect_page_client(viewer.url) as page:
        group = json.loads(page.ask("copy", ids=["Mug"]))
        for existing in outside_names(place):
            if not existing.startswith(("link", "package://pkg/link")):
                with pytest.raises(RequestFailedError, match=r"ResourceRefusedError.*is not granted"):
                    page.ask("load", name="x.owl", text=write_map(named(existing, "x")))
                group["bodies"][0]["mesh"] = existing
                with pytest.raises(RequestFailedError, match=r"ResourceRefusedError.*is not granted"):
                    page.ask("paste", text=json.dumps(group))
    assert simulation.state.ids == before


def test_what_was_refused_is_not_read_later(call: Callable[..., Any], simulation: Simulation, place: Place) -> None:
    call("mindstage/spawn_world", world=world_to_json(named(f"{place.root}/outside/part.stl", "late")))
    assert not any("outside" in (body.mesh or "") for body in simulation.snapshot().bodies)


def test_files_of_a_granted_folder_have_relative_names(place: Place) -> None:
    folder = GrantedFolder(place.root / "packages")
    assert folder.find("pkg/part.stl") == (place.root / "packages/pkg/part.stl").resolve()
    assert list(folder.files({".stl"})) == ["pkg/part.stl"]
    for name in ("pkg/link/part.stl", "../outside/part.stl", "pkg/none.stl", str(place.root / "outside/part.stl")):
        assert folder.find(name) is None, name
    assert GrantedFolder(None).find("pkg/part.stl") is None


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("the file '/tmp/secret/map.owl' has no map", "the file 'map.owl' has no map"),
        ("see /home/somebody/x.urdf:7", "see x.urdf:7"),
        ("/unreal/spawn_entity refused http://example.com/a/b", "/unreal/spawn_entity refused http://example.com/a/b"),
    ],
)
def test_paths_of_the_server_are_not_shown(text: str, shown: str) -> None:
    assert without_paths(text) == shown
