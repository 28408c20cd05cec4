"""New things come to stand on furniture and in it, where there is room and they stay; nothing else notices."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import trimesh

from mindstage.assets import MeshLibrary
from mindstage.engines import MujocoEngine
from mindstage.errors import BodyNotFoundError, InvalidArgumentError, NoFreePlacementError
from mindstage.knowledge import KnowledgeBase, bundled_kitchen
from mindstage.scene import Body, BodyId, BodyPhysics, Iri, Mobility, Pose, Vector, World
from mindstage.simulation import Simulation


@pytest.fixture(scope="module")
def kitchen() -> Iterator[Simulation]:
    knowledge = KnowledgeBase()
    knowledge.load(bundled_kitchen())
    with Simulation(knowledge, MujocoEngine(), timeout_s=60.0) as stage:
        stage.spawn()
        yield stage


def thing(id: str, size: Vector, mass: float = 0.3) -> Body:
    iri = Iri(f"http://example.org/things#{id}")
    physics = BodyPhysics(mobility=Mobility.DYNAMIC, gravity=True, mass_kg=mass)
    return Body(
        id=BodyId(id), iri=iri, cls=Iri("http://example.org/things#Thing"), pose=Pose(), size=size, physics=physics
    )


def where(stage: Simulation, id: str) -> np.ndarray:
    ids, poses = stage.run_on_engine(lambda engine: engine.poses())
    return poses[ids.index(BodyId(id))]


def test_a_plate_put_on_the_counter_rests_there(kitchen: Simulation) -> None:
    count, before = len(kitchen.state.ids), kitchen.state.poses.copy()
    put = kitchen.place("DinnerPlate", on="counter_west")
    assert put.support_id == "counter_west"
    _, now = kitchen.run_on_engine(lambda engine: engine.poses())
    assert now[:count] == pytest.approx(before, abs=1e-12), "something was moved by a trial"
    start = where(kitchen, put.id).copy()
    kitchen.step(2.0)
    assert where(kitchen, put.id)[:3] == pytest.approx(start[:3], abs=0.005)
    plate = kitchen.snapshot().body(put.id)
    assert plate.cls.endswith("DinnerPlate")
    assert plate.physics.is_dynamic
    assert kitchen.geometry[put.id].shape_name == "plate"


def test_a_second_one_stands_beside_the_first(kitchen: Simulation) -> None:
    first, second = (kitchen.place("CoffeeMug", on="table") for _ in range(2))
    assert first.id != second.id
    assert np.linalg.norm(where(kitchen, first.id)[:2] - where(kitchen, second.id)[:2]) > 0.06


def test_what_goes_into_a_cabinet_may_come_into_its_drawer(kitchen: Simulation) -> None:
    put = kitchen.place(thing("spoon", (0.18, 0.03, 0.02), 0.05), into="drawer_unit_middle")
    assert put.support_id.startswith("drawer_")
    drawer = where(kitchen, put.support_id)
    assert np.linalg.norm(where(kitchen, "spoon")[:2] - drawer[:2]) < 0.4


def test_reasons_say_why_there_is_no_spot(kitchen: Simulation) -> None:
    there = kitchen.state.ids
    with pytest.raises(NoFreePlacementError, match="cannot be put into table: nobody knows of room in it"):
        kitchen.place(thing("cup", (0.08, 0.08, 0.1)), into="table")
    with pytest.raises(NoFreePlacementError, match="it is larger than the place"):
        kitchen.place(thing("wardrobe", (3.0, 3.0, 2.0)), on="table")
    assert kitchen.state.ids == there, "what finds no place is not there"


def test_what_makes_no_sense_is_refused(kitchen: Simulation) -> None:
    with pytest.raises(BodyNotFoundError, match="near: 'table'"):
        kitchen.place("CoffeeMug", on="tabel")
    with pytest.raises(InvalidArgumentError, match="give one of on and into"):
        kitchen.place("CoffeeMug", on="table", into="table")
    with pytest.raises(InvalidArgumentError, match="nobody told how large such a thing is"):
        kitchen.place("HumanScaleObject", on="table")
    assert kitchen.make_body("HumanScaleObject", size=(0.1, 0.1, 0.1)).size == (0.1, 0.1, 0.1)


def test_on_a_bench_of_a_mesh_a_cup_stands_on_the_seat_and_not_at_the_height_of_its_back(tmp_path: Path) -> None:
    pytest.importorskip("coacd")
    boards = [((-0.5, -0.25, 0.0), (0.5, 0.25, 0.45)), ((-0.5, 0.2, 0.45), (0.5, 0.25, 0.9))]
    mesh = trimesh.util.concatenate([trimesh.creation.box(bounds=np.array(board)) for board in boards])
    (tmp_path / "assets").mkdir()
    mesh.export(tmp_path / "assets" / "bench.obj")
    iri = Iri("http://example.org/things#Bench")
    bench = Body(id=BodyId("bench"), iri=iri, cls=iri, pose=Pose((0, 0, 0.45)), size=(1.0, 0.5, 0.9), mesh="bench.obj")
    meshes = MeshLibrary([tmp_path / "assets"], cache=tmp_path)
    with Simulation(KnowledgeBase(), MujocoEngine(), timeout_s=60.0, meshes=meshes) as stage:
        stage.spawn(World(iri=Iri("http://example.org/hall"), name="hall", bodies=(bench,)))
        assert stage.geometry[BodyId("bench")].shape_name == "mesh"
        stage.place(thing("cup", (0.08, 0.08, 0.1)), on="bench")
        assert where(stage, "cup")[2] == pytest.approx(0.5, abs=0.015)


def test_the_python_of_the_guide_runs_and_prints_what_it_says(capsys: pytest.CaptureFixture[str]) -> None:
    guide = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "furnishing.md"
    code = guide.read_text(encoding="utf-8").split("```python\n")[1].split("```")[0]
    exec(compile(code, guide.name, "exec"), {})
    promised = [line.rpartition("# ")[2] for line in code.splitlines() if "print(" in line]
    assert capsys.readouterr().out.splitlines() == promised
