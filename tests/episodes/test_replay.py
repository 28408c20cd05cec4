"""Replays: the shown world is the recorded one, playing, events, refused edits, and continuing from a moment."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mindstage import KnowledgeBase, MujocoEngine, Simulation
from mindstage.engines import Capability
from mindstage.episodes import EpisodeEventKind, EpisodeFrame, FrameRecording, Recorder
from mindstage.episodes.episode import Episode
from mindstage.episodes.history import EpisodeHistory
from mindstage.episodes.replay import EpisodeReplay, knowledge_of
from mindstage.errors import (
    BodyNotFoundError,
    EpisodeError,
    EpisodeFileError,
    EpisodeTimeError,
    UnsupportedByEngineError,
)
from mindstage.scene import Body, BodyId, Iri, Pose, World
from mindstage.scene.edits import Delete
from mindstage.scene.transforms import normalized_pose_array, quat_angle
from tests.episodes.kitchenette_recording import DRAWER, EVENTS, MUG, frame_of, kitchenette_recording
from tests.kitchenette import MAP, kitchenette
from tests.viewer.waiting import wait_until


@pytest.fixture(scope="module")
def recording() -> FrameRecording:
    return kitchenette_recording()


@pytest.fixture
def replay(recording: FrameRecording) -> Iterator[EpisodeReplay]:
    with EpisodeReplay(recording, KnowledgeBase()) as replay:
        yield replay


def pose(simulation: Simulation, id: BodyId) -> np.ndarray:
    return simulation.state.poses[simulation.state.ids.index(id)]


def test_the_world_and_the_state_are_those_of_the_frame(replay: EpisodeReplay, recording: FrameRecording) -> None:
    for time_s in np.random.default_rng(4).uniform(0.0, 4.0, 40).tolist():
        replay.seek(time_s)
        frame = recording.frame_at(time_s)
        assert replay.state.time_s == time_s
        assert np.array_equal(replay.state.poses, frame.poses)
        assert replay.snapshot() == frame.world()
        assert replay.engine.run(lambda engine: engine.joint_positions()) == frame.joint_positions
        assert replay.engine.run(lambda engine: engine.contacts()) == frame.contacts


def test_questions_are_answered_for_the_shown_time(replay: EpisodeReplay) -> None:
    def relations() -> set[tuple[str, str]]:
        return {(row.relation, row.other.rpartition("#")[2]) for row in replay.ask("where_is", thing="Mug")}

    assert ("on", "Cupboard") in relations()
    replay.seek(2.5)
    assert not any(other == "Cupboard" for _, other in relations())
    replay.seek(4.0)
    assert ("on", "Floor") in relations()
    replay.seek(0.0)
    assert ("on", "Cupboard") in relations()


def test_questions_can_be_about_other_times_than_the_shown_one(replay: EpisodeReplay) -> None:
    replay.seek(1.0)
    (row,) = replay.ask("occurs", event="Falling")
    assert row.begin == pytest.approx(3.0)
    then = {row.other.rpartition("#")[2] for row in replay.ask("where_is", thing="Mug", at=4.0) if row.relation == "on"}
    assert then == {"Floor"}
    now = {row.other.rpartition("#")[2] for row in replay.ask("where_is", thing="Mug") if row.relation == "on"}
    assert now == {"Cupboard"}


def test_a_revision_is_a_change_of_structure_and_not_of_poses(replay: EpisodeReplay) -> None:
    replay.seek(0.1)
    first = replay.state
    replay.seek(1.9)
    assert replay.state.revision == first.revision
    assert replay.state.ids is first.ids
    replay.seek(2.1)  # the mug is attached now
    assert replay.state.revision > first.revision
    assert replay.state.ids is first.ids


def test_it_plays_at_the_speed_that_is_asked_for_and_pauses_at_the_end(replay: EpisodeReplay) -> None:
    start = time.monotonic()
    replay.play(speed=4.0)
    wait_until(lambda: not replay.state.playing, "the end", timeout_s=20.0)
    assert time.monotonic() - start > 0.9
    assert replay.state.time_s == 4.0
    assert replay.state.error == ""
    replay.play(speed=0.1)
    wait_until(lambda: 0.0 < replay.state.time_s < 1.0, "it has begun again", timeout_s=20.0)


def test_a_step_beyond_the_end_shows_the_end(replay: EpisodeReplay) -> None:
    replay.seek(3.9)
    replay.step(5.0)
    assert replay.state.time_s == 4.0


@pytest.mark.parametrize("time_s", [-0.01, 4.01, 1e9])
def test_a_time_outside_of_the_recording_is_refused(replay: EpisodeReplay, time_s: float) -> None:
    replay.seek(1.0)
    with pytest.raises(EpisodeTimeError, match="it lasts from 0 to 4 s"):
        replay.seek(time_s)
    assert replay.state.time_s == 1.0


def test_events_are_visited_in_both_directions_and_by_kind(replay: EpisodeReplay) -> None:
    opening, grasping, falling = EVENTS
    assert replay.seek_event(back=True) is None
    assert [replay.seek_event() for _ in range(4)] == [opening, grasping, falling, None]
    assert replay.state.time_s == falling.begin_s
    assert [replay.seek_event(back=True) for _ in range(3)] == [grasping, opening, None]
    assert replay.seek_event(kinds={EpisodeEventKind.FALL}) == falling


def test_the_events_of_a_history_are_those_of_its_recording_with_the_names_of_bodies() -> None:
    recording = kitchenette_recording()
    iris = {each.id: each.iri for world in recording.spawned for each in (*world.bodies, *world.joints)}
    found = EpisodeHistory(recording, name="run").events()
    assert len(found) == len(EVENTS)
    for event, past in zip(EVENTS, found, strict=True):
        assert (past.episode, past.id, past.kind) == ("run", event.id, event.kind.value)
        assert (past.begin_s, past.end_s, past.episode_end_s) == (event.begin_s, event.end_s, 4.0)
        names = (past.thing, past.other, past.agent, past.joint)
        given = (event.thing, event.other, event.agent, event.joint)
        assert names == tuple(None if id is None else iris[id] for id in given)
        assert (past.amount, past.evidence) == (event.amount, event.evidence)


@pytest.mark.parametrize(
    ("edit", "what"),
    [
        (lambda replay: replay.edits.delete([MUG]), "delete"),
        (lambda replay: replay.edits.move(MUG, Pose((0.0, 0.0, 2.0))), "set poses"),
        (lambda replay: replay.edits.attach(DRAWER, MUG), "attach"),
        (lambda replay: replay.pull(MUG, point=(0.0, 0.0, 0.0), target=(0.0, 0.0, 2.0)), ""),
        (lambda replay: replay.clear(), "remove its bodies"),
        (lambda replay: replay.replace_world(kitchenette()), "remove its bodies"),
        (lambda replay: replay.spawn(kitchenette()), "spawn"),
        (lambda replay: replay.place(MUG, on="Fridge"), ""),
    ],
)
def test_edits_are_refused_and_change_nothing(
    replay: EpisodeReplay, edit: Callable[[EpisodeReplay], Any], what: str
) -> None:
    before = replay.snapshot()
    with pytest.raises(UnsupportedByEngineError, match=f"{what}.*continue from the shown moment with Resume"):
        edit(replay)
    assert replay.snapshot() == before
    assert replay.state.error == ""


def test_bodies_can_be_highlighted_and_unknown_ones_cannot(replay: EpisodeReplay) -> None:
    replay.highlight("Mug", "green")
    assert set(replay.state.highlights) == {MUG}
    with pytest.raises(BodyNotFoundError):
        replay.highlight("Mgu", "green")
    replay.clear_highlights()
    assert not replay.state.highlights


def test_it_continues_live_from_the_shown_moment_and_returns(replay: EpisodeReplay, recording: FrameRecording) -> None:
    replay.seek(1.9)
    replay.resume()
    assert replay.engine.name == "mujoco"
    assert replay.state.time_s == pytest.approx(1.9)
    assert not replay.state.playing
    for id, row in zip(replay.state.ids, recording.frame_at(1.9).poses, strict=False):
        now = pose(replay, id)
        recorded = recording.frame_at(1.9).poses[recording.frame_at(1.9).ids.index(id)]
        assert now[:3] == pytest.approx(recorded[:3], abs=1e-3), (id, row)
        assert quat_angle(now[3:], recorded[3:]) < 1e-3
    with pytest.raises(EpisodeError, match=r"continued from kitchenette.mcap at 1.9 s"):
        replay.seek(0.5)
    replay.place(MUG, on="Fridge")
    replay.step(0.5)
    assert replay.state.time_s > 2.3
    assert pose(replay, MUG)[2] == pytest.approx(1.85, abs=0.01)
    replay.edits.delete([MUG])
    replay.reset(to_start=True)
    assert pose(replay, MUG)[2] == pytest.approx(0.85, abs=0.01)
    replay.return_to_recording()
    replay.return_to_recording()
    assert replay.state.time_s == 1.9
    assert np.array_equal(replay.state.poses, recording.frame_at(1.9).poses)
    replay.seek(0.0)


def test_what_falls_continues_to_fall_in_the_live_simulation(replay: EpisodeReplay) -> None:
    replay.seek(3.0)
    assert pose(replay, MUG)[2] == pytest.approx(1.5, abs=0.01)
    replay.resume()
    replay.step(0.3)
    # h = g t^2 / 2 from rest
    assert 1.5 - pose(replay, MUG)[2] == pytest.approx(0.5 * 9.81 * 0.3**2, rel=0.05)


def test_a_copy_of_the_shown_moment_is_simulated_by_mujoco(replay: EpisodeReplay) -> None:
    replay.seek(3.0)
    before = replay.state.poses.copy()
    with replay.fork() as copy:
        copy.step(1.0)
        assert pose(copy, MUG)[2] < 0.2
    assert np.array_equal(replay.state.poses, before)


def test_bodies_that_were_added_and_deleted_exist_at_their_times_only() -> None:
    with Simulation(KnowledgeBase(), MujocoEngine()) as simulation:
        simulation.spawn(kitchenette())
        frames: list[EpisodeFrame] = [frame_of(simulation, 0.0)]
        jug = Body(id=BodyId("Jug"), iri=Iri(MAP + "Jug"), cls=Iri(MAP + "Jug"), pose=Pose((0.0, 0.0, 1.0)))
        simulation.spawn(World(iri=Iri(MAP + "map"), name="map", bodies=(jug,)), persistent=False)
        frames.append(frame_of(simulation, 1.0, frames[-1]))
        simulation.engine.run(lambda engine: engine.apply(Delete((MUG,))), edits=True)
        frames.append(frame_of(simulation, 2.0, frames[-1]))
    with EpisodeReplay(FrameRecording(frames), KnowledgeBase(), at_s=1.0) as replay:
        assert {"Jug", "Mug"} <= set(replay.state.ids)
        replay.highlight("Mug", "green")
        replay.seek(2.0)
        assert "Mug" not in replay.state.ids
        assert not replay.state.highlights
        replay.seek(0.0)
        assert "Jug" not in replay.state.ids
        assert set(replay.state.highlights) == {MUG}


def test_a_recording_without_joints_and_contacts_has_not_these_capabilities(recording: FrameRecording) -> None:
    frames = [
        EpisodeFrame(time_s=each.time_s, structure=each.structure, ids=each.ids, poses=each.poses)
        for each in recording.frames(0.0, 1.0)
    ]
    with EpisodeReplay(FrameRecording(frames), KnowledgeBase()) as replay:
        assert not replay.engine.capabilities & {Capability.JOINTS, Capability.CONTACTS}
        with pytest.raises(UnsupportedByEngineError, match="not recorded"):
            replay.engine.run(lambda engine: engine.contacts())


def test_the_longer_of_two_recordings_determines_the_end(recording: FrameRecording) -> None:
    shorter = FrameRecording(recording.frames(0.0, 1.0), name="shorter")
    with EpisodeReplay(shorter, KnowledgeBase(), beside=recording) as replay:
        assert (replay.begin_s, replay.end_s) == (0.0, 4.0)
        replay.seek(3.0)
        assert np.array_equal(replay.state.poses, recording.frame_at(1.0).poses)


def test_the_map_of_a_moment_is_written_and_read_again(replay: EpisodeReplay, tmp_path: Path) -> None:
    replay.seek(4.0)
    path = tmp_path / "at4.owl"
    replay.save(path)
    knowledge = KnowledgeBase()
    knowledge.load(path)
    world = knowledge.world()
    for body in world.bodies:
        assert normalized_pose_array(body.pose) == pytest.approx(pose(replay, body.id), abs=1e-6)


def test_a_recording_without_a_knowledge_base_is_asked_about_its_worlds(recording: FrameRecording) -> None:
    knowledge = knowledge_of(recording)
    assert {body.id for body in knowledge.world().bodies} == {body.id for body in kitchenette().bodies}


def test_a_recorded_file_is_replayed_with_its_own_knowledge(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    live: dict[float, tuple[np.ndarray, World, set[object]]] = {}
    with Simulation(KnowledgeBase(), MujocoEngine()) as simulation:
        simulation.spawn(kitchenette())
        simulation.step(0.5)
        with Recorder(simulation, path) as recorder:
            for _ in range(6):
                simulation.pull(DRAWER, point=(-0.25, 0.0, 0.0), target=(1.2, 0.0, 0.65))
                simulation.step(0.2)
                simulation.highlight("Mug", "green")  # an edit is recorded at once
                answers = {(row.relation, row.other) for row in simulation.ask("where_is", thing="Drawer")}
                live[recorder.time_s] = simulation.state.poses.copy(), simulation.snapshot(), answers
    with Episode(path) as episode, EpisodeReplay(episode) as replay:
        for time_s, (poses, world, answers) in live.items():
            replay.seek(time_s)
            assert np.abs(replay.state.poses - poses).max() < 1e-9
            assert replay.snapshot().bodies == world.bodies
            assert {(row.relation, row.other) for row in replay.ask("where_is", thing="Drawer")} == answers


def test_the_worlds_are_those_that_had_been_spawned_at_the_shown_time(tmp_path: Path) -> None:
    jug = Body(
        id=BodyId("Jug"), iri=Iri("http://example.org/jugs.owl#Jug"), cls=Iri(MAP + "Jug"), pose=Pose((0.0, 0.0, 1.0))
    )
    jugs = World(iri=Iri("http://example.org/jugs.owl#map"), name="jugs", bodies=(jug,))
    with Simulation(KnowledgeBase(), MujocoEngine()) as simulation:
        simulation.spawn(kitchenette())
        with Recorder(simulation, tmp_path / "run.mcap") as recorder:
            simulation.step(0.5)
            simulation.spawn(jugs)
            spawned_s = recorder.time_s
            simulation.step(0.5)
    with Episode(tmp_path / "run.mcap") as episode, EpisodeReplay(episode) as replay:
        assert [world.name for world in replay.worlds] == ["map"]
        replay.seek(spawned_s + 0.2)
        assert [world.name for world in replay.worlds] == ["map", "jugs"]
        replay.resume()
        assert [world.name for world in replay.worlds] == ["map", "jugs"]
        assert "Jug" in replay.state.ids
        replay.return_to_recording()
        replay.seek(0.1)
        assert [world.name for world in replay.worlds] == ["map"]


class DamagedRecording(FrameRecording):
    """A recording in which one second is lost."""

    def frame_at(self, time_s: float) -> EpisodeFrame:
        if 1.0 < time_s < 2.0:
            raise EpisodeFileError("damaged.mcap", cause=f"the state at {time_s:g} s is lost")
        return super().frame_at(time_s)


def test_playing_pauses_at_a_lost_part_and_goes_on_behind_it(recording: FrameRecording) -> None:
    damaged = DamagedRecording(recording.frames(), spawned=recording.spawned)
    with EpisodeReplay(damaged, KnowledgeBase(), at_s=0.8) as replay:
        replay.play(speed=2.0)
        wait_until(lambda: not replay.state.playing, "it pauses", timeout_s=20.0)
        assert "is lost" in replay.state.error
        assert replay.state.time_s <= 1.0
        with pytest.raises(EpisodeFileError, match=r"1\.5 s is lost"):
            replay.seek(1.5)
        replay.seek(2.5)
        assert np.array_equal(replay.state.poses, recording.frame_at(2.5).poses)
        replay.play(speed=8.0)
        wait_until(lambda: replay.state.time_s == 4.0, "the end", timeout_s=20.0)
        assert replay.state.error == ""
