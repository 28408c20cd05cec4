"""A stage gives bodies the forms that are known of their classes, keeps them true, and tells where they come from."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import pytest

from mindstage.engines import NullEngine, SpawnNoteKind, SpawnReport
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import NO_GEOMETRY, Body, BodyGeometry, BodyId, GeometryMap, GeometrySource, World, diff
from mindstage.simulation import Simulation
from tests.kitchenette import kitchenette


class Listening(NullEngine):
    """Remembers with which forms it was asked to spawn."""

    def __init__(self) -> None:
        super().__init__()
        self.heard: list[GeometryMap] = []

    def spawn(self, world: World, *, geometry: GeometryMap = NO_GEOMETRY) -> SpawnReport:
        self.heard.append(geometry)
        return super().spawn(world, geometry=geometry)


class Found(NamedTuple):
    """What a source of meshes gives."""

    geometry: dict[BodyId, BodyGeometry]
    notes: tuple[str, ...]


class Meshes:
    """One mesh, for the mug."""

    mesh = BodyGeometry(key="00" * 16, visuals=(), collision_shapes=(), source=GeometrySource.MESH, shape_name="mesh")

    def geometry_for(self, bodies: Sequence[Body]) -> Found:
        return Found({body.id: self.mesh for body in bodies if body.id == "Mug"}, ("mug.obj is scaled",))


@pytest.fixture(scope="module")
def knowledge() -> KnowledgeBase:
    return KnowledgeBase()


@pytest.fixture
def engine() -> Listening:
    return Listening()


@pytest.fixture
def stage(knowledge: KnowledgeBase, engine: Listening) -> Iterator[Simulation]:
    with Simulation(knowledge, engine) as stage:
        yield stage


def of_shapes(report: SpawnReport) -> list[str]:
    return [note.text for note in report.notes if note.kind is SpawnNoteKind.SHAPE]


def test_all_that_is_spawned_has_a_form_and_the_engine_gets_it(stage: Simulation, engine: Listening) -> None:
    stage.spawn(kitchenette())
    assert stage.geometry.keys() == {body.id for body in kitchenette().bodies}
    assert stage.geometry[BodyId("Drawer")].shape_name == "drawer"
    assert engine.heard == [stage.geometry]


def test_the_report_counts_where_forms_come_from(stage: Simulation) -> None:
    assert of_shapes(stage.spawn(kitchenette()))[0] == "forms: 8 from what is known of their classes"


def test_forms_are_no_part_of_the_world_that_comes_back(stage: Simulation) -> None:
    stage.spawn(kitchenette())
    assert diff(kitchenette(), stage.snapshot()).identical(0.0)


def test_the_mapping_is_the_same_until_bodies_come_or_go(stage: Simulation) -> None:
    stage.spawn(kitchenette())
    before = stage.geometry
    stage.step(0.1)
    assert stage.geometry is before


def test_deleted_bodies_have_no_form_and_come_back_with_theirs(stage: Simulation) -> None:
    stage.spawn(kitchenette())
    mug = stage.geometry[BodyId("Mug")]
    stage.run_on_engine(lambda engine: engine.delete([BodyId("Mug")]), edits=True)
    assert BodyId("Mug") not in stage.geometry
    stage.reset()
    assert stage.geometry[BodyId("Mug")] is mug


def test_a_cleared_stage_has_no_forms(stage: Simulation) -> None:
    stage.spawn(kitchenette())
    stage.clear()
    assert dict(stage.geometry) == {}


def test_what_could_not_be_spawned_changes_the_form_of_nothing(stage: Simulation) -> None:
    stage.spawn(kitchenette())
    before = stage.geometry[BodyId("Mug")]
    report = stage.spawn(kitchenette(), geometry={BodyId("Mug"): Meshes.mesh})
    assert not report.ok
    assert stage.geometry[BodyId("Mug")] is before


def test_forms_that_are_given_come_before_what_is_known(stage: Simulation, engine: Listening) -> None:
    report = stage.spawn(kitchenette(), geometry={BodyId("Mug"): Meshes.mesh})
    assert dict(stage.geometry) == {"Mug": Meshes.mesh}
    assert of_shapes(report) == ["forms: 1 from meshes"]


def test_a_stage_without_shapes_leaves_bodies_as_the_map_has_them(knowledge: KnowledgeBase, engine: Listening) -> None:
    with Simulation(knowledge, engine, shapes=False) as stage:
        assert of_shapes(stage.spawn(kitchenette())) == []
        assert dict(stage.geometry) == {}
    assert engine.heard == [NO_GEOMETRY]


@pytest.mark.parametrize(("shapes", "others"), [(True, 7), (False, 0)])
def test_meshes_are_used_with_shapes_and_without(knowledge: KnowledgeBase, shapes: bool, others: int) -> None:
    with Simulation(knowledge, NullEngine(), shapes=shapes, meshes=Meshes()) as stage:
        report = stage.spawn(kitchenette())
        assert stage.geometry[BodyId("Mug")] is Meshes.mesh
        assert len(stage.geometry) == 1 + others
        assert "mug.obj is scaled" in of_shapes(report)
