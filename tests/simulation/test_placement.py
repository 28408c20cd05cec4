"""Bodies are placed on and in furniture at free, stable poses, without effects on other bodies."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import trimesh
from msgspec.structs import replace

from mindstage.assets import MeshLibrary
from mindstage.engines.mujoco import MujocoEngine
from mindstage.errors import BodyNotFoundError, InvalidArgumentError, NameNotFoundError, NoFreePlacementError
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import bundled_kitchen
from mindstage.scene import Attachment, Body, BodyId, BodyPhysics, Iri, Mobility, Pose, Vector, World
from mindstage.simulation import Simulation
from mindstage.simulation.placement_list import load_items, parse_item, place_items
from tests.kitchenette import kitchenette


@pytest.fixture(scope="module")
def kitchen() -> Iterator[Simulation]:
    knowledge = KnowledgeBase()
    knowledge.load(bundled_kitchen())
    with Simulation(knowledge, MujocoEngine(), timeout_s=60.0) as sim:
        sim.spawn()
        yield sim


def item(id: str, size: Vector, mass: float = 0.3) -> Body:
    iri = Iri(f"http://example.org/things#{id}")
    physics = BodyPhysics(mobility=Mobility.DYNAMIC, gravity=True, mass_kg=mass)
    return Body(
        id=BodyId(id), iri=iri, cls=Iri("http://example.org/things#Thing"), pose=Pose(), size=size, physics=physics
    )


def pose_of(sim: Simulation, id: str) -> np.ndarray:
    ids, poses = sim.engine.run(lambda engine: engine.poses())
    return poses[ids.index(BodyId(id))]


def test_a_plate_placed_on_the_counter_stays_there(kitchen: Simulation) -> None:
    count, before = len(kitchen.state.ids), kitchen.state.poses.copy()
    result = kitchen.place("DinnerPlate", on="counter_west")
    assert result.support_id == "counter_west"
    _, now = kitchen.engine.run(lambda engine: engine.poses())
    assert now[:count] == pytest.approx(before, abs=1e-12), "a trial moved another body"
    start = pose_of(kitchen, result.id).copy()
    kitchen.step(2.0)
    assert pose_of(kitchen, result.id)[:3] == pytest.approx(start[:3], abs=0.005)
    plate = kitchen.snapshot().body(result.id)
    assert plate.cls.endswith("DinnerPlate")
    assert plate.physics.is_dynamic
    assert kitchen.geometry[result.id].shape_name == "plate"


def test_a_second_item_is_placed_beside_the_first(kitchen: Simulation) -> None:
    first, second = (kitchen.place("CoffeeMug", on="table") for _ in range(2))
    assert first.id != second.id
    assert np.linalg.norm(pose_of(kitchen, first.id)[:2] - pose_of(kitchen, second.id)[:2]) > 0.06


def test_placing_into_a_cabinet_includes_its_drawers(kitchen: Simulation) -> None:
    result = kitchen.place(item("spoon", (0.18, 0.03, 0.02), 0.05), into="drawer_unit_middle")
    assert result.support_id.startswith("drawer_")
    drawer = pose_of(kitchen, result.support_id)
    assert np.linalg.norm(pose_of(kitchen, "spoon")[:2] - drawer[:2]) < 0.4


@pytest.mark.parametrize("how", ["child", "parent", "attached"])
def test_a_drawer_is_part_of_its_cupboard_however_it_is_connected(how: str) -> None:
    world = kitchenette()
    slide, hinge = world.joints
    if how == "parent":
        world = replace(world, joints=(replace(slide, parent=slide.child, child=slide.parent), hinge))
    elif how == "attached":
        attachment = Attachment(parent=BodyId("Cupboard"), child=BodyId("Drawer"))
        world = replace(world, joints=(hinge,), attachments=(*world.attachments, attachment))
    with Simulation(KnowledgeBase(), MujocoEngine(), timeout_s=60.0) as sim:
        sim.spawn(world)
        result = sim.place(item("spoon", (0.18, 0.03, 0.02), 0.05), into="Cupboard", near=(1.95, 0.0, 0.56))
        assert result.support_id == "Drawer"
        assert 0.55 < pose_of(sim, "spoon")[2] < 0.75


def test_a_failed_placement_has_a_reason(kitchen: Simulation) -> None:
    before = kitchen.state.ids
    with pytest.raises(NoFreePlacementError, match="cannot be placed into table: it has no known support surface"):
        kitchen.place(item("cup", (0.08, 0.08, 0.1)), into="table")
    with pytest.raises(NoFreePlacementError, match="it is larger than the support surface"):
        kitchen.place(item("wardrobe", (3.0, 3.0, 2.0)), on="table")
    assert kitchen.state.ids == before, "nothing is left of failed placements"


def test_invalid_arguments_are_rejected(kitchen: Simulation) -> None:
    with pytest.raises(BodyNotFoundError, match="near: 'table'"):
        kitchen.place("CoffeeMug", on="tabel")
    with pytest.raises(InvalidArgumentError, match="give either `on` or `into`"):
        kitchen.place("CoffeeMug", on="table", into="table")
    with pytest.raises(InvalidArgumentError, match="the size of its instances is unknown"):
        kitchen.place("HumanScaleObject", on="table")
    assert kitchen.make_body("HumanScaleObject", size=(0.1, 0.1, 0.1)).size == (0.1, 0.1, 0.1)


def test_a_list_of_items_is_placed_with_labels_counts_and_reasons(kitchen: Simulation, tmp_path: Path) -> None:
    path = tmp_path / "items.ttl"
    path.write_text(
        """@prefix : <http://example.org/list#> . @prefix ms: <http://mindstage.org/ontology#> .
        @prefix knowrob: <http://knowrob.org/kb/knowrob.owl#> .
        @prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
        :bowls a knowrob:Bowl-Eating ; rdfs:label "a bowl" ; ms:count 2 ; ms:putOn "counter_west" ; :color "blue" .
        :lost a knowrob:DinnerPlate ; ms:putOn "no_such_table" .
        """,
        encoding="utf-8",
    )
    items = load_items(path, kitchen.knowledge)
    assert {item.label for item in items} == {"a bowl", None}
    done: list[int] = []
    report = place_items(kitchen, items, progress=done.append)
    assert done == [1, 2, 3]
    assert [(each.id, each.support_id) for each in report.placed] == [
        ("bowls_1", "counter_west"),
        ("bowls_2", "counter_west"),
    ]
    (unplaced,) = report.unplaced
    assert unplaced.id == "lost"
    assert "no_such_table" in unplaced.reason
    bowl = kitchen.snapshot().body("bowls_2")
    assert (bowl.label, bowl.iri) == ("a bowl", "http://example.org/list#bowls_2")
    assert [fact.value.text for fact in bowl.facts if fact.property.endswith("#color")] == ["blue"]


def test_on_the_mesh_of_a_bench_a_cup_is_placed_on_the_seat(tmp_path: Path) -> None:
    pytest.importorskip("coacd")
    boards = [((-0.5, -0.25, 0.0), (0.5, 0.25, 0.45)), ((-0.5, 0.2, 0.45), (0.5, 0.25, 0.9))]
    mesh = trimesh.util.concatenate([trimesh.creation.box(bounds=np.array(board)) for board in boards])
    (tmp_path / "assets").mkdir()
    mesh.export(tmp_path / "assets" / "bench.obj")
    iri = Iri("http://example.org/things#Bench")
    bench = Body(id=BodyId("bench"), iri=iri, cls=iri, pose=Pose((0, 0, 0.45)), size=(1.0, 0.5, 0.9), mesh="bench.obj")
    meshes = MeshLibrary([tmp_path / "assets"], cache=tmp_path)
    with Simulation(KnowledgeBase(), MujocoEngine(), timeout_s=60.0, meshes=meshes) as sim:
        sim.spawn(World(iri=Iri("http://example.org/hall"), name="hall", bodies=(bench,)))
        assert sim.geometry[BodyId("bench")].shape_name == "mesh"
        sim.place(item("cup", (0.08, 0.08, 0.1)), on="bench")
        assert pose_of(sim, "cup")[2] == pytest.approx(0.5, abs=0.015)


def test_the_example_of_the_guide_prints_the_documented_output(capsys: pytest.CaptureFixture[str]) -> None:
    guide = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "furnishing.md"
    code = guide.read_text(encoding="utf-8").split("```python\n")[1].split("```")[0]
    exec(compile(code, guide.name, "exec"), {})
    promised = [line.rpartition("# ")[2] for line in code.splitlines() if "print(" in line]
    assert capsys.readouterr().out.splitlines() == promised


def test_an_item_in_words_is_a_class_and_where_it_goes(kitchen: Simulation) -> None:
    plain, held = (parse_item(text, kitchen.knowledge) for text in ("CoffeeMug", "CoffeeMug:table"))
    assert plain.cls == held.cls
    assert (plain.support, held.support) == (None, "table")
    with pytest.raises(NameNotFoundError):
        parse_item("Mugg", kitchen.knowledge)
