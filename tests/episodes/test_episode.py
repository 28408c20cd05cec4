"""Episodes equal what was live: worlds, joints, contacts, edits and geometry, at every frame and at random times."""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage.engines import make_engine
from mindstage.episodes.episode import Episode
from mindstage.episodes.recorder import Recorder
from mindstage.errors import EpisodeFileError, EpisodeTimeError
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.questions import WorldState
from mindstage.maps.io.write import save_map, write_map
from mindstage.scene import BodyId, Material, Pose, World
from mindstage.scene.edits import Attach, Delete, Detach, SetMaterials, SetPoses
from mindstage.simulation import Simulation
from tests.kitchenette import kitchenette


def body(name: str) -> BodyId:
    return BodyId(name)


def assert_same_world(recorded: World, live: World, *, tolerance: float = 1e-9) -> None:
    """Everything but the poses is equal, and the poses are within a tolerance."""
    assert {each.id for each in recorded.bodies} == {each.id for each in live.bodies}
    now = {each.id: each for each in live.bodies}
    for each in recorded.bodies:
        mine, theirs = (np.array((*one.pose.position, *one.pose.quaternion)) for one in (each, now[each.id]))
        assert np.abs(mine - theirs).max() <= tolerance, each.id
        assert replace(each, pose=Pose()) == replace(now[each.id], pose=Pose())
    assert set(recorded.joints) == set(live.joints)
    assert set(recorded.attachments) == set(live.attachments)
    assert set(recorded.lights) == set(live.lights)
    assert (recorded.iri, recorded.facts, recorded.resources) == (live.iri, live.facts, live.resources)


class LiveStates:
    """Collects the state after each recorded frame."""

    def __init__(self, simulation: Simulation, recorder: Recorder) -> None:
        self.simulation, self.recorder = simulation, recorder
        self.states: dict[float, WorldState] = {}
        self.contacts: dict[float, object] = {}
        self.restart()

    def restart(self) -> None:
        """Takes the state at the begin, or after a reset, which sets the clock of the simulation back."""
        self.offset_s = self.recorder.time_s - self.simulation.state.time_s
        self.take()

    def take(self) -> None:
        if self.is_frame():
            self.states[self.recorder.time_s] = self.simulation.current_state()
            self.contacts.pop(self.recorder.time_s, None)

    def is_frame(self) -> bool:
        """Whether the present state is a frame; on a busy machine a step is divided, and an earlier part of it is."""
        return abs(self.simulation.state.time_s + self.offset_s - self.recorder.time_s) < 1e-6

    def step(self, count: int = 1) -> None:
        for _ in range(count):
            self.simulation.step(1 / 30)
            self.take()
            if self.is_frame():
                self.contacts[self.recorder.time_s] = self.simulation.engine.run(lambda engine: engine.contacts())


def edited_run(simulation: Simulation, path: Path) -> LiveStates:
    """A run with every kind of edit, and moving joints."""
    with Recorder(simulation, path) as recorder:
        live = LiveStates(simulation, recorder)

        def edit(function: object) -> None:
            simulation.engine.run(function, edits=True)  # type: ignore[arg-type]
            live.take()

        live.step(5)
        drawer, mug = body("Drawer"), body("Mug")
        simulation.pull(drawer, point=(0.0, 0.0, 0.0), target=(1.5, 0.0, 0.65))
        live.step(20)
        simulation.release()
        edit(lambda engine: engine.apply(SetPoses({mug: Pose((1.0, 0.5, 0.6), (0.0, 1.0, 0.0, 0.0))})))
        live.step(10)
        spoon = replace(kitchenette().body("Mug"), id=body("Spoon"), pose=Pose((1.0, -1.0, 1.0)))
        simulation.spawn(World(iri=spoon.iri, bodies=(spoon,)), persistent=False)
        live.take()
        live.step(5)
        edit(lambda engine: engine.apply(Attach(drawer, body("Spoon"))))
        live.step(3)
        edit(lambda engine: engine.apply(SetMaterials(mug, (Material(name="red", color=(1.0, 0.0, 0.0)),))))
        edit(lambda engine: engine.apply(Detach(body("Spoon"))))
        edit(lambda engine: engine.apply(Delete((mug,))))
        live.step(10)
        simulation.reset()
        live.restart()
        live.step(10)
    assert len(live.states) > 50
    return live


@pytest.fixture
def simulation() -> Iterator[Simulation]:
    knowledge = KnowledgeBase()
    with Simulation(knowledge, make_engine("mujoco")) as simulation:
        simulation.spawn(kitchenette())
        yield simulation


def test_every_frame_equals_the_world_that_was_live(simulation: Simulation, tmp_path: Path) -> None:
    live = edited_run(simulation, tmp_path / "run.mcap")
    with Episode(tmp_path / "run.mcap") as episode:
        for time_s, state in live.states.items():
            recorded = episode.state_at(time_s)
            assert_same_world(recorded.world, state.world)
            assert recorded.joint_positions == state.joint_positions
            assert recorded.spawned == state.spawned
            assert recorded.source == state.source
            assert recorded.geometry.keys() == state.geometry.keys()
        assert any(live.contacts.values())
        for time_s, contacts in live.contacts.items():
            assert episode.frame_at(time_s).contacts == contacts


def test_the_world_at_random_times_is_that_of_the_last_frame_before(simulation: Simulation, tmp_path: Path) -> None:
    live = edited_run(simulation, tmp_path / "run.mcap")
    generator = random.Random(3)
    compared = 0
    with Episode(tmp_path / "run.mcap") as episode:
        times = sorted({frame.time_s for frame in episode.frames()})
        for _ in range(100):
            at = generator.uniform(0.0, times[-1])
            last, frame = max(time_s for time_s in times if time_s <= at), episode.frame_at(at)
            assert frame.time_s == last
            if last in live.states:
                assert_same_world(frame.world(), live.states[last].world)
                compared += 1
    assert compared > 60


def test_frames_are_in_the_order_of_time_and_are_those_of_frame_at(simulation: Simulation, tmp_path: Path) -> None:
    edited_run(simulation, tmp_path / "run.mcap")
    with Episode(tmp_path / "run.mcap") as episode:
        frames = list(episode.frames())
        assert [frame.time_s for frame in frames] == sorted(frame.time_s for frame in frames)
        assert frames[0].time_s == episode.begin_s == 0.0
        assert frames[-1].time_s == episode.end_s
        part = list(episode.frames(0.5, 1.0))
        assert part
        assert [each.time_s for each in part] == [each.time_s for each in frames if 0.5 <= each.time_s <= 1.0]


def test_time_continues_after_a_reset(simulation: Simulation, tmp_path: Path) -> None:
    with Recorder(simulation, tmp_path / "run.mcap") as recorder:
        simulation.step(0.5)
        before = recorder.time_s
        simulation.reset()
        assert recorder.time_s == before
        simulation.step(0.5)
        assert recorder.time_s == pytest.approx(1.0, abs=0.005)
    with Episode(tmp_path / "run.mcap") as episode:
        assert [edit.kind for edit in episode.edits()] == ["reset"]


def test_a_time_outside_of_the_episode_is_an_error(simulation: Simulation, tmp_path: Path) -> None:
    with Recorder(simulation, tmp_path / "run.mcap"):
        simulation.step(0.2)
    with Episode(tmp_path / "run.mcap") as episode:
        for at in (-0.1, 1.0):
            with pytest.raises(EpisodeTimeError, match=r"it lasts from 0 to 0\.2"):
                episode.frame_at(at)


def test_geometry_is_restored_exactly(simulation: Simulation, tmp_path: Path) -> None:
    live = simulation.geometry
    with Recorder(simulation, tmp_path / "run.mcap"):
        simulation.step(0.1)
    with Episode(tmp_path / "run.mcap") as episode:
        assert episode.geometry.keys() == live.keys()
        for id, geometry in live.items():
            restored = episode.geometry[id]
            assert restored.key == geometry.key
            assert restored.collision_shapes == geometry.collision_shapes
            assert restored.support_surfaces == geometry.support_surfaces
            assert (restored.source, restored.reason) == (geometry.source, geometry.reason)
            for mine, theirs in zip(restored.visuals, geometry.visuals, strict=True):
                assert np.array_equal(mine.points, theirs.points)
                assert np.array_equal(mine.faces, theirs.faces)
                assert mine.material == theirs.material


def test_a_closed_episode_says_so(simulation: Simulation, tmp_path: Path) -> None:
    with Recorder(simulation, tmp_path / "run.mcap"):
        simulation.step(0.1)
    episode = Episode(tmp_path / "run.mcap")
    episode.close()
    episode.close()
    with pytest.raises(EpisodeFileError, match="closed"):
        list(episode.frames())


def test_a_simulation_is_continued_from_any_time(simulation: Simulation, tmp_path: Path) -> None:
    live = edited_run(simulation, tmp_path / "run.mcap")
    with Episode(tmp_path / "run.mcap") as episode:
        for time_s in list(live.states)[1::12]:
            with episode.resume(time_s) as resumed:
                state = resumed.current_state()
                assert_same_world(state.world, live.states[time_s].world, tolerance=1e-6)
                for id, position in (live.states[time_s].joint_positions or {}).items():
                    assert (state.joint_positions or {})[id] == pytest.approx(position, abs=1e-6)
                resumed.step(0.5)
                moved = resumed.snapshot()
                assert {each.id for each in moved.bodies} == {each.id for each in state.world.bodies}


def test_a_body_falls_on_where_the_simulation_is_continued(simulation: Simulation, tmp_path: Path) -> None:
    with Recorder(simulation, tmp_path / "run.mcap") as recorder:
        simulation.engine.run(lambda engine: engine.apply(SetPoses({body("Mug"): Pose((0.0, 0.0, 2.0))})), edits=True)
        simulation.step(0.3)
        at = recorder.time_s
        simulation.step(1.0)
    with Episode(tmp_path / "run.mcap") as episode, episode.resume(at) as resumed:
        before = resumed.snapshot().body("Mug").pose.position[2]
        assert before == pytest.approx(2.0 - 9.81 * 0.3**2 / 2, abs=0.02)
        resumed.step(0.2)  # it starts at rest
        fallen = before - resumed.snapshot().body("Mug").pose.position[2]
        assert fallen == pytest.approx(9.81 * 0.2**2 / 2, rel=0.05)


def test_the_knowledge_base_answers_without_the_original_files(tmp_path: Path) -> None:
    folder = tmp_path / "maps"
    folder.mkdir()
    save_map(kitchenette(), folder / "map.owl")
    knowledge = KnowledgeBase()
    knowledge.load(folder / "map.owl")
    with Simulation(knowledge, make_engine("mujoco")) as simulation:
        simulation.spawn()
        with Recorder(simulation, tmp_path / "run.mcap"):
            knowledge.tell("Mug", "rdfs:label", "the blue mug")
            simulation.step(0.1)
        answers = [(row.thing, row.relation, row.other) for row in simulation.ask("where_is", "Mug")]
    (folder / "map.owl").unlink()
    with Episode(tmp_path / "run.mcap") as episode:
        restored = episode.knowledge()
        assert restored.maps() == knowledge.maps()
        assert restored.world() == knowledge.world()
        assert sorted(map(str, restored.store)) == sorted(map(str, knowledge.store))
        assert [(row.thing, row.relation, row.other) for row in restored.ask("where_is", "Mug")] == [
            (row.thing, row.relation, row.other) for row in knowledge.ask("where_is", "Mug")
        ]
        with episode.resume(episode.end_s) as resumed:
            assert [(row.thing, row.relation, row.other) for row in resumed.ask("where_is", "Mug")] == answers


def test_the_maps_at_begin_and_end_are_the_worlds_of_then(simulation: Simulation, tmp_path: Path) -> None:
    with Recorder(simulation, tmp_path / "run.mcap"):
        begin = simulation.snapshot()
        simulation.engine.run(lambda engine: engine.apply(SetPoses({body("Mug"): Pose((0.0, 0.5, 0.05))})), edits=True)
        simulation.step(0.5)
        end = simulation.snapshot()
    with Episode(tmp_path / "run.mcap") as episode:
        assert episode.map_at_begin == write_map(begin)
        assert episode.map_at_end == write_map(end)
        assert begin != end
