"""The functions of `import mindstage as ms`."""

from __future__ import annotations

import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

import mindstage as ms
from mindstage.bridge import LocalNode, RosbridgeServer
from mindstage.engines import NullEngine
from mindstage.errors import (
    EngineUnavailableError,
    InvalidArgumentError,
    MapNotFoundError,
    MapWriteError,
    SimulationError,
    SourceParseError,
)
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import UnitConventions, save_map
from mindstage.ros import RosInterface
from mindstage.scene import Iri, World
from tests.kitchenette import kitchenette


@pytest.fixture(scope="module")
def map_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("maps") / "kitchenette.owl"
    save_map(kitchenette(), path)
    return path


def test_the_example_of_the_readme_works(tmp_path: Path) -> None:
    with ms.open("bundled:kitchen") as sim:
        sim.step(0.1)
        for answer in sim.ask("storage_place", item="CowsMilk"):
            assert sim.highlight(answer.individual, color="green").highlighted == ("fridge",)
        assert sim.joint("fridge_door").open()
        page = ms.view(sim, port=0)
        assert page.url.startswith("http://127.0.0.1:")
        sim.save(tmp_path / "now.owl")
    changed = ms.diff("bundled:kitchen", tmp_path / "now.owl")
    assert "fridge_door pose.quaternion" in str(changed)
    assert {change.id for change in changed.changed} >= {"fridge_door", "fridge_door_handle"}
    assert not changed.lost


@pytest.mark.parametrize("engine", ["mujoco", "null", NullEngine()], ids=["mujoco", "null", "given"])
def test_open_spawns_the_map_in_any_engine(engine: object, map_path: Path) -> None:
    with ms.open(map_path, engine=engine) as sim:  # type: ignore[arg-type]
        assert sim.reports[0].ok
        assert set(sim.state.ids) == {body.id for body in kitchenette().bodies}
    with pytest.raises(SimulationError):
        sim.snapshot()


def test_all_maps_are_spawned_or_the_one_that_is_named(map_path: Path, tmp_path: Path) -> None:
    other = World(iri=Iri("http://example.org/maps/Other.owl#Other"), name="Other")
    save_map(other, tmp_path / "other.owl")
    with ms.open([map_path, tmp_path / "other.owl"], engine="null") as sim:
        assert len(sim.worlds) == 2
    with ms.open([map_path, str(tmp_path / "other.owl")], map_name="Other", engine="null") as sim:
        assert [world.iri for world in sim.worlds] == [other.iri]
        assert sim.state.ids == ()


def test_without_a_map_the_simulation_is_empty() -> None:
    with ms.open(engine="null") as sim:
        assert (sim.worlds, sim.state.ids) == ((), ())


def test_a_failed_open_closes_the_engine(map_path: Path, tmp_path: Path) -> None:
    engine = NullEngine()
    with pytest.raises(SourceParseError):
        ms.open(tmp_path / "nothing.owl", engine=engine)
    assert engine._closed
    with pytest.raises(MapNotFoundError):
        ms.open(map_path, map_name="Nowhere", engine="null")
    with pytest.raises(EngineUnavailableError, match="no engine of that name"):
        ms.open(map_path, engine="bullet")
    with pytest.raises(SourceParseError, match="no such folder"):
        ms.open(map_path, engine="null", assets=tmp_path / "no-meshes")


def test_closing_the_simulation_releases_the_store(map_path: Path, tmp_path: Path) -> None:
    with ms.open(map_path, engine="null", store=tmp_path / "store") as sim:
        assert sim.knowledge.tell("CookieJar", "typePrimaryFunction-containerFor", "Candy")
    with KnowledgeBase(store=tmp_path / "store") as kb:
        assert kb.ask("storage_place", item="Candy")[0].place.endswith("#CookieJar")


def test_load_returns_the_world_of_the_map(map_path: Path) -> None:
    assert ms.diff(ms.load(map_path), kitchenette()).identical()
    assert ms.load("bundled:kitchen").body("fridge").id == "fridge"


def test_conventions_are_given_once_or_for_each_map(map_path: Path) -> None:
    assert ms.load(map_path, conventions=UnitConventions()) == ms.load(map_path, conventions=[UnitConventions()])
    with pytest.raises(InvalidArgumentError, match="there are 2 for 1 maps"):
        ms.load(map_path, conventions=[UnitConventions(), UnitConventions()])


@pytest.mark.parametrize(
    ("name", "start"),
    [("x.owl", b"<?xml"), ("x.ttl", b"@prefix"), ("x.mjcf", b"<mujoco"), ("x.xml", b"<mujoco"), ("x.glb", b"glTF")],
)
def test_a_world_is_saved_in_the_format_of_the_suffix(name: str, start: bytes, tmp_path: Path) -> None:
    ms.save(kitchenette(), tmp_path / name)
    assert (tmp_path / name).read_bytes().startswith(start)


def test_a_simulation_and_a_world_are_saved_alike(map_path: Path, tmp_path: Path) -> None:
    with ms.open(map_path, engine="null") as sim:
        for dialect in (None, "soma", "same"):
            out = tmp_path / f"{dialect}.ttl"
            ms.save(sim, out, dialect=dialect)
            assert ms.diff(sim, out).identical()
        sim.save(tmp_path / "sim.out", format="owl")
        assert ms.diff(map_path, tmp_path / "sim.out").identical()
        sim.save(tmp_path / "boxes.glb", primitive_shapes=True)
        assert (tmp_path / "boxes.glb").stat().st_size < 100_000


def test_a_failed_save_writes_no_file(tmp_path: Path) -> None:
    with pytest.raises(MapWriteError, match="belongs to no format"):
        ms.save(kitchenette(), tmp_path / "x.docx")
    with pytest.raises(InvalidArgumentError, match="glb has no dialects"):
        ms.save(kitchenette(), tmp_path / "x.glb", dialect="soma")
    with pytest.raises(InvalidArgumentError, match="use one of"):
        ms.save(kitchenette(), tmp_path / "x.owl", dialect="klingon")
    with pytest.raises(InvalidArgumentError, match="use one of"):
        ms.save(kitchenette(), tmp_path / "x.owl", format="docx")
    with pytest.raises(InvalidArgumentError, match="knowledge base"):
        ms.save(kitchenette(), tmp_path / "x.owl", dialect="same")
    assert not list(tmp_path.iterdir())


def test_diff_accepts_paths_worlds_and_simulations(map_path: Path) -> None:
    with ms.open(map_path, engine="null") as sim:
        sources = (map_path, str(map_path), kitchenette(), sim)
        assert all(ms.diff(a, b).identical() for a in sources for b in sources)
        sim.joint("Drawer").open()
        moved = ms.diff(map_path, sim)
        assert not moved.identical()
        assert "Drawer" in str(moved)


def test_a_viewer_is_closed_with_its_simulation(map_path: Path) -> None:
    with ms.open(map_path, engine="null") as sim:
        page = ms.view(sim, port=0)
        assert page.url in page._repr_html_()
        blocked = ms.view(sim, port=0, block=True, duration_s=0.3)
        assert "closed" in repr(blocked)
        assert not sim.state.playing
        assert sim.state.time_s > 0.0, "it plays while it blocks"
    assert "closed" in repr(page)


def test_connect_uses_a_served_simulation(map_path: Path) -> None:
    with ms.open(map_path, engine="mujoco") as served, LocalNode() as node, RosbridgeServer(node, port=0) as server:
        interface = RosInterface(served, node, namespace="remote")
        url = f"{server.url.replace('ws://', 'ros://')}/remote"
        with ms.connect(url, map_path) as sim:
            assert set(sim.state.ids) == set(served.state.ids)
            sim.highlight("Mug", "red")
            assert "Mug" in served.state.highlights
            assert sim.ask("where_is", thing="Mug", relation="on")[0].other.endswith("#Cupboard")
            assert sim.joint("Drawer").open()
            assert served.joint("Drawer").openness > 0.9
            sim.joint("Drawer").close()
        with ms.connect(url) as again:  # the zero of the joint is its spawned position, not the current one
            assert served.joint("Drawer").open()
            again.engine.run(lambda engine: None)
            assert again.joint("Drawer").openness > 0.9
        assert not served.closed
        interface.close()
    with pytest.raises(EngineUnavailableError):
        ms.connect(url, timeout_s=0.5)


def test_the_import_is_lazy_and_dir_lists_all_names() -> None:
    code = (
        "import mindstage as ms, sys; print({'open', 'Simulation', 'diff'} <= set(dir(ms)), 'msgspec' in sys.modules)"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout == "True False\n"
    with pytest.raises(AttributeError, match="no attribute 'opn'"):
        ms.opn  # noqa: B018


def test_the_types_are_checked_by_mypy(tmp_path: Path) -> None:
    pytest.importorskip("mypy")
    source = tmp_path / "typed.py"
    source.write_text(
        textwrap.dedent(
            """
            import mindstage as ms
            from mindstage.simulation import JointMotion, Simulation
            from mindstage.scene import World, WorldDiff

            def check() -> None:
                sim: Simulation = ms.open("x.owl")
                world: World = ms.load("x.owl")
                motion: JointMotion = sim.joint("door").open()
                found: WorldDiff = ms.diff(world, sim)
                wrong: int = ms.load("x.owl")
            """
        )
    )
    result = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "--no-incremental", "--follow-imports=silent", str(source)],
        capture_output=True,
        text=True,
        check=False,
        cwd=Path(__file__).resolve().parent.parent,
    )
    assert "Found 1 error" in result.stdout, result.stdout
    assert 'variable has type "int"' in result.stdout


def test_the_package_lists_its_public_names_and_packages_only() -> None:
    public = [name for name in dir(ms) if not name.startswith("__")]
    assert {"open", "Simulation", "robots", "scene"} <= set(public)
    assert {"import_module", "TYPE_CHECKING", "cli", "_MODULES"}.isdisjoint(public)
    for name in set(public) - {"prolog"}:
        assert getattr(ms, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'robot'"):
        ms.robot  # noqa: B018
