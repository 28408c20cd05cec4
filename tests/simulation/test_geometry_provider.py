"""A simulation fits geometry to bodies, keeps it while they exist, and reports its source."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import pytest

from mindstage.engines import NullEngine, SpawnNoteKind, SpawnReport
from mindstage.engines.base import Applied
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import NO_GEOMETRY, Body, BodyGeometry, BodyId, GeometryMap, GeometrySource, diff
from mindstage.scene.edits import Delete, Edit, Spawn
from mindstage.simulation import Simulation
from tests.kitchenette import kitchenette


class RecordingEngine(NullEngine):
    """Records the geometry that it spawns."""

    def __init__(self) -> None:
        super().__init__()
        self.spawned: list[GeometryMap] = []

    def apply(self, edit: Edit) -> Applied:
        if isinstance(edit, Spawn):
            self.spawned.append(dict(edit.geometry))
        return super().apply(edit)


class MeshGeometry(NamedTuple):
    """The result of a source of meshes."""

    geometry: dict[BodyId, BodyGeometry]
    notes: tuple[str, ...]


class Meshes:
    """A source of one mesh, for the mug."""

    mesh = BodyGeometry(key="00" * 16, visuals=(), collision_shapes=(), source=GeometrySource.MESH, shape_name="mesh")

    def geometry_for(self, bodies: Sequence[Body]) -> MeshGeometry:
        return MeshGeometry({body.id: self.mesh for body in bodies if body.id == "Mug"}, ("mug.obj is scaled",))


@pytest.fixture(scope="module")
def knowledge() -> KnowledgeBase:
    return KnowledgeBase()


@pytest.fixture
def engine() -> RecordingEngine:
    return RecordingEngine()


@pytest.fixture
def sim(knowledge: KnowledgeBase, engine: RecordingEngine) -> Iterator[Simulation]:
    with Simulation(knowledge, engine) as sim:
        yield sim


def shape_notes(report: SpawnReport) -> list[str]:
    return [note.text for note in report.notes if note.kind is SpawnNoteKind.SHAPE]


def test_each_spawned_body_has_geometry_that_is_passed_to_the_engine(sim: Simulation, engine: RecordingEngine) -> None:
    sim.spawn(kitchenette())
    assert sim.geometry.keys() == {body.id for body in kitchenette().bodies}
    assert sim.geometry[BodyId("Drawer")].shape_name == "drawer"
    assert engine.spawned == [sim.geometry]


def test_the_report_counts_the_sources_of_the_geometry(sim: Simulation) -> None:
    assert shape_notes(sim.spawn(kitchenette()))[0] == "geometry: 8 from the shape rules of their classes"


def test_the_snapshot_does_not_depend_on_the_geometry(sim: Simulation) -> None:
    sim.spawn(kitchenette())
    assert diff(kitchenette(), sim.snapshot()).identical(0.0)


def test_the_mapping_is_the_same_object_until_bodies_are_added_or_removed(sim: Simulation) -> None:
    sim.spawn(kitchenette())
    before = sim.geometry
    sim.step(0.1)
    assert sim.geometry is before


def test_deleted_bodies_have_no_geometry_and_are_restored_with_theirs(sim: Simulation) -> None:
    sim.spawn(kitchenette())
    mug = sim.geometry[BodyId("Mug")]
    sim.engine.run(lambda engine: engine.apply(Delete((BodyId("Mug"),))), edits=True)
    assert BodyId("Mug") not in sim.geometry
    sim.reset()
    assert sim.geometry[BodyId("Mug")] is mug


def test_a_cleared_simulation_has_no_geometry(sim: Simulation) -> None:
    sim.spawn(kitchenette())
    sim.clear()
    assert dict(sim.geometry) == {}


def test_a_body_that_failed_to_spawn_does_not_change_geometry(sim: Simulation) -> None:
    sim.spawn(kitchenette())
    before = sim.geometry[BodyId("Mug")]
    report = sim.spawn(kitchenette(), geometry={BodyId("Mug"): Meshes.mesh})
    assert not report.ok
    assert sim.geometry[BodyId("Mug")] is before


def test_given_geometry_takes_precedence_over_shape_rules(sim: Simulation, engine: RecordingEngine) -> None:
    report = sim.spawn(kitchenette(), geometry={BodyId("Mug"): Meshes.mesh})
    assert dict(sim.geometry) == {"Mug": Meshes.mesh}
    assert shape_notes(report) == ["geometry: 1 from meshes"]


def test_without_shapes_bodies_have_the_primitives_of_the_map(
    knowledge: KnowledgeBase, engine: RecordingEngine
) -> None:
    with Simulation(knowledge, engine, primitive_shapes=True) as sim:
        assert shape_notes(sim.spawn(kitchenette())) == []
        assert dict(sim.geometry) == {}
    assert engine.spawned == [NO_GEOMETRY]


@pytest.mark.parametrize(("primitive_shapes", "others"), [(False, 7), (True, 0)])
def test_meshes_are_used_with_and_without_shape_rules(
    knowledge: KnowledgeBase, primitive_shapes: bool, others: int
) -> None:
    with Simulation(knowledge, NullEngine(), primitive_shapes=primitive_shapes, meshes=Meshes()) as sim:
        report = sim.spawn(kitchenette())
        assert sim.geometry[BodyId("Mug")] is Meshes.mesh
        assert len(sim.geometry) == 1 + others
        assert "mug.obj is scaled" in shape_notes(report)
