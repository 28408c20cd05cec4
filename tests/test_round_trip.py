"""The round trip of `mindstage check`: a world is spawned, logged, written and read without loss."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings

from mindstage.engines.mujoco import MujocoEngine
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import bundled_kitchen, save_map
from mindstage.scene import World, diff
from mindstage.scene.edits import Spawn
from tests.worlds import worlds


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One folder for all examples, whose files are overwritten."""
    return tmp_path_factory.mktemp("maps")


def round_trip(world: World, folder: Path, *ontologies: Path) -> World:
    engine = MujocoEngine()
    report = engine.apply(Spawn(world)).report
    assert report.ok, report
    path = folder / "logged.owl"
    save_map(engine.snapshot(), path)
    knowledge = KnowledgeBase(bundled_ontology=False)
    knowledge.load([path], ontologies=ontologies)
    return knowledge.world(world.iri)


@given(world=worlds(max_bodies=4))
@settings(max_examples=250, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])
def test_the_round_trip_of_random_worlds_is_lossless(folder: Path, world: World) -> None:
    found = diff(world, round_trip(world, folder))
    assert found.identical(0.0), found
    assert found.lost_facts == 0


@pytest.mark.parametrize("name", ["bundled", "iai-kitchen-original", "iai-kitchen-spawned"])
def test_the_round_trip_of_a_kitchen_is_lossless(folder: Path, name: str, request: pytest.FixtureRequest) -> None:
    path = bundled_kitchen()
    if name != "bundled":
        path = request.getfixturevalue("shared_data") / "maps" / f"{name}.owl"
    knowledge = KnowledgeBase(bundled_ontology=False)
    knowledge.load([path])
    world = knowledge.world()
    found = diff(world, round_trip(world, folder))
    assert found.identical(0.0), found
    assert found.lost_facts == 0
    assert not found.lost
