"""Recorders: what they write, who did what, and what remains of a process that was killed."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from mindstage.engines import make_engine
from mindstage.engines.base import Engine
from mindstage.episodes import event_process, mcap_file
from mindstage.episodes import recorder as recorder_module
from mindstage.episodes.detection import detect_events
from mindstage.episodes.episode import Episode
from mindstage.episodes.mcap_file import repair
from mindstage.episodes.recorder import Recorder, RecordingFolder
from mindstage.episodes.recording import EpisodeEventKind, EventState
from mindstage.errors import EpisodeError, EpisodeFileError, InvalidArgumentError
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import Body, BodyId, BodyPhysics, Iri, Mobility, Pose, World
from mindstage.scene.edits import Attach, Delete, SetLabel, SetPoses
from mindstage.simulation import Simulation
from mindstage.simulation.observation import as_client
from tests.conftest import missing
from tests.episodes.episodes import execute_in_detection, failing_detection
from tests.kitchenette import kitchenette
from tests.viewer.waiting import wait_until


@pytest.fixture
def simulation() -> Iterator[Simulation]:
    with Simulation(KnowledgeBase(), make_engine("mujoco")) as simulation:
        simulation.spawn(kitchenette())
        yield simulation


def drop_the_mug(simulation: Simulation, path: Path) -> dict[float, np.ndarray]:
    """Records a falling mug; returns its live pose by time."""
    live = {}
    with Recorder(simulation, path) as recorder:
        simulation.engine.run(lambda engine: engine.apply(SetPoses({BodyId("Mug"): Pose((0.0, 0.0, 1.0))})), edits=True)
        for _ in range(30):
            simulation.step(1 / 30)
            live[recorder.time_s] = simulation.state.poses[simulation.state.ids.index(BodyId("Mug"))].copy()
    return live


def test_rosbags_reads_the_same_poses_and_times(simulation: Simulation, tmp_path: Path) -> None:
    live = drop_the_mug(simulation, tmp_path / "run.mcap")
    found = {}
    with AnyReader([tmp_path / "run.mcap"]) as reader:
        assert {"/tf", "/tf_static", "/joint_states", "/clock", "/markers"} <= {
            each.topic for each in reader.connections
        }
        assert {each.digest for each in reader.connections}  # every definition was parsed
        for connection, time_ns, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            if connection.topic == "/tf":
                for each in message.transforms:
                    assert each.header.stamp.sec * 10**9 + each.header.stamp.nanosec == time_ns
                    if each.child_frame_id == "Mug":
                        moved, turned = each.transform.translation, each.transform.rotation
                        found[time_ns / 1e9] = [moved.x, moved.y, moved.z, turned.w, turned.x, turned.y, turned.z]
            elif connection.topic == "/clock":
                assert message.clock.sec * 10**9 + message.clock.nanosec == time_ns
    assert len(found) > 10
    for time_s, pose in live.items():  # a pose holds until the next message
        assert found[max(each for each in found if each <= time_s)] == pose.tolist()


def test_every_message_is_read_by_two_other_programs(simulation: Simulation, tmp_path: Path) -> None:
    with Recorder(simulation, tmp_path / "run.mcap") as recorder:
        simulation.pull(BodyId("Drawer"), point=(0.0, 0.0, 0.0), target=(1.5, 0.0, 0.65))
        simulation.step(0.5)
        simulation.ask("where_is")
        assert recorder.recording
    counts: dict[str, int] = {}
    with (tmp_path / "run.mcap").open("rb") as stream:
        for each in make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            counts[each.channel.topic] = counts.get(each.channel.topic, 0) + 1
            if each.channel.topic == "/joint_states":
                positions = dict(zip(each.decoded_message.name, each.decoded_message.position, strict=True))
            elif each.channel.topic == "/markers":
                drawn = {marker.header.frame_id: marker for marker in each.decoded_message.markers}
            elif each.channel.topic == "/mindstage/contacts":
                contacts = each.decoded_message.contacts
    with AnyReader([tmp_path / "run.mcap"]) as reader:
        others = {each.topic: each.msgcount for each in reader.connections if each.msgcount}
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)
    assert counts == others
    state = simulation.current_state()
    assert state.joint_positions is not None
    assert positions["DrawerSlide"] == state.joint_positions[BodyId("DrawerSlide")][0] < -0.2
    fridge = drawn["Fridge"]
    assert (fridge.scale.x, fridge.scale.y, fridge.scale.z) == (0.6, 0.6, 1.8)
    assert fridge.frame_locked
    live = simulation.engine.run(lambda engine: engine.contacts())
    assert [(each.a, each.b, each.force_n) for each in contacts] == [
        (each.a, each.b or "", each.force_n) for each in live
    ]


def test_rerun_opens_an_episode(simulation: Simulation, tmp_path: Path) -> None:
    rerun = Path(sys.executable).with_name("rerun")
    if not rerun.is_file():
        missing("rerun is not installed (rerun-sdk)")
    drop_the_mug(simulation, tmp_path / "run.mcap")
    with AnyReader([tmp_path / "run.mcap"]) as reader:
        moves = [each for each in reader.connections if each.topic == "/tf"]
        transforms = sum(
            len(reader.deserialize(data, connection.msgtype).transforms)  # type: ignore[attr-defined]
            for connection, _, data in reader.messages(moves)
        )
    convert = [rerun, "mcap", "convert", tmp_path / "run.mcap", "-o", tmp_path / "run.rrd"]
    subprocess.run(convert, check=True, capture_output=True, timeout=120)
    shown = subprocess.run([rerun, "rrd", "print", tmp_path / "run.rrd"], check=True, capture_output=True, timeout=120)
    rows: dict[str, int] = {}
    for count, name, columns in re.findall(
        r"with (\d+) rows .* - (\S+) - data columns: \[(.*)\]", shown.stdout.decode()
    ):
        if "Transform3D:" in columns or "Scalars:" in columns:
            rows[name] = rows.get(name, 0) + int(count)
    assert rows["/tf"] == transforms > 10
    assert rows["/joint_states/position"] > 0


def test_a_file_defines_every_type_that_its_messages_have(simulation: Simulation, tmp_path: Path) -> None:
    drop_the_mug(simulation, tmp_path / "run.mcap")
    with (tmp_path / "run.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    plain = re.compile(r"(bool|byte|char|w?string|u?int(8|16|32|64)|float(32|64))\b")
    for schema in summary.schemas.values():
        first, *others = schema.data.decode().split("\n" + "=" * 80 + "\nMSG: ")
        defined = {name: text for name, _, text in (each.partition("\n") for each in others)}
        package = schema.name.split("/")[0]
        for name, text in {f"{package}/": first, **defined}.items():
            types = {line.split()[0].split("[")[0] for line in text.splitlines() if line.strip() and "=" not in line}
            for type in {each for each in types if not plain.match(each)}:
                whole = type if "/" in type else f"{name.split('/')[0]}/{type}"
                assert whole in defined, (schema.name, whole)


def test_joints_are_recorded_at_their_positions_and_named_by_their_only_axis(
    simulation: Simulation, tmp_path: Path
) -> None:
    with Recorder(simulation, tmp_path / "run.mcap"):
        simulation.pull(BodyId("Drawer"), point=(0.0, 0.0, 0.0), target=(1.5, 0.0, 0.65))
        simulation.step(0.5)
        live = simulation.engine.run(lambda engine: dict(engine.joint_positions()))
    with Episode.open(tmp_path / "run.mcap") as episode:
        found = episode.frame_at(episode.end_s).joint_positions
    assert found is not None
    assert found.keys() == live.keys()
    for id, position in live.items():
        assert found[id] == pytest.approx(position, abs=1e-6)
    with (tmp_path / "run.mcap").open("rb") as stream:
        messages = make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages(["/joint_states"])
        positions = [dict(zip(each.name, each.position, strict=True)) for *_, each in messages]
    assert positions[-1]["DrawerSlide"] == pytest.approx(live["DrawerSlide"][0], abs=1e-6)
    assert abs(positions[-1]["DrawerSlide"]) > 0.1
    assert "FridgeHinge" in positions[0]


def test_only_what_moved_is_written(simulation: Simulation, tmp_path: Path) -> None:
    simulation.step(2.0)
    with Recorder(simulation, tmp_path / "run.mcap"):
        simulation.step(3.0)
    with AnyReader([tmp_path / "run.mcap"]) as reader:
        counts = {each.topic: each.msgcount for each in reader.connections}
    assert counts["/clock"] > 80
    assert counts["/tf"] < 5


def test_edits_and_questions_are_recorded_with_their_client(simulation: Simulation, tmp_path: Path) -> None:
    mug = BodyId("Mug")
    with Recorder(simulation, tmp_path / "run.mcap") as recorder:
        simulation.step(0.5)
        at = recorder.time_s
        with as_client("viewer"):
            simulation.engine.run(lambda engine: engine.apply(SetPoses({mug: Pose((0.0, 0.0, 0.05))})), edits=True)
            simulation.highlight("Mug", "green", label="look")
        simulation.step(0.5)
        answers = simulation.ask("where_is", "Mug")
        with simulation.fork() as copy:
            copy.engine.run(lambda engine: engine.apply(Delete((mug,))), edits=True)
        with pytest.raises(Exception, match="Teapot"):
            simulation.engine.run(lambda engine: engine.apply(Delete((BodyId("Teapot"),))), edits=True)
    with Episode(tmp_path / "run.mcap") as episode:
        edits = episode.edits()
    assert [(each.kind, each.client) for each in edits] == [
        ("set poses", "viewer"),
        ("highlight", "viewer"),
        ("question", "Python"),
        ("imagination", "Python"),
    ]
    moved, _, question, _ = edits
    assert (moved.time_s, moved.ids) == (at, (mug,))
    assert moved.edits(()) == (SetPoses({mug: Pose((0.0, 0.0, 0.05))}),)
    assert question.details["question"] == "where_is"
    assert len(question.details["answers"]) == question.details["count"] == len(answers) > 0
    assert question.time_s == episode_end(tmp_path / "run.mcap")


def episode_end(path: Path) -> float:
    with Episode(path) as episode:
        return episode.end_s


def test_frames_have_the_requested_rate_however_the_simulation_is_stepped(
    simulation: Simulation, tmp_path: Path
) -> None:
    for rate_hz, step_s in ((10.0, 1.0), (50.0, 1.0), (10.0, 0.01), (30.0, 0.002)):
        path = tmp_path / f"{rate_hz}-{step_s}.mcap"
        with Recorder(simulation, path, rate_hz=rate_hz):
            for _ in range(round(1.0 / step_s)):
                simulation.step(step_s)
        with Episode(path) as episode:
            times = [frame.time_s for frame in episode.frames()]
        assert len(times) == pytest.approx(rate_hz + 1, abs=2)
        assert np.diff(times[:-1]).max() <= 1.2 / rate_hz


def test_events_detected_while_recording_are_those_detected_from_the_file(
    simulation: Simulation, tmp_path: Path
) -> None:
    simulation.step(0.5)
    with Recorder(simulation, tmp_path / "run.mcap") as recorder:
        simulation.engine.run(lambda engine: engine.apply(SetPoses({BodyId("Mug"): Pose((0.0, 0.0, 1.0))})), edits=True)
        simulation.pull(BodyId("Drawer"), point=(0.0, 0.0, 0.0), target=(1.5, 0.0, 0.65))
        simulation.step(1.5)
        simulation.release()
        simulation.step(4.0)  # a rest, of which not all frames are searched
        simulation.engine.run(lambda engine: engine.apply(SetPoses({BodyId("Mug"): Pose((0.0, 0.5, 1.0))})), edits=True)
        simulation.step(2.0)
        assert recorder.recording
    with Episode(tmp_path / "run.mcap") as episode:
        events = episode.events()
        assert sum(event.kind.value == "Falling" for event in events) == 2
        assert {"Falling", "Opening"} <= {event.kind.value for event in events}
        assert events == detect_events(episode)
        opening = next(event for event in events if event.kind.value == "Opening")
        assert opening.thing == "Drawer"
        assert 0.0 <= opening.begin_s < 0.3


HAND = Body(
    id=BodyId("Hand"),
    iri=Iri("http://example.org/hand"),
    cls=Iri("http://example.org/Hand"),
    pose=Pose((2.0, 0.0, 1.2)),
    size=(0.1, 0.1, 0.1),
    physics=BodyPhysics(mobility=Mobility.KINEMATIC),
)
MUG = BodyId("Mug")


def edit(simulation: Simulation, function: Callable[[Engine], object]) -> None:
    simulation.engine.run(function, edits=True)


def lift(simulation: Simulation, height: float) -> None:
    """Moves the hand up in ten steps of a third of a second altogether."""
    x, y, z = simulation.snapshot().body("Hand").pose.position
    for number in range(1, 11):
        place = Pose((x, y, z + height * number / 10))
        edit(simulation, lambda engine, place=place: engine.apply(SetPoses({HAND.id: place})))  # type: ignore[misc]
        simulation.step(1 / 30)


def test_without_contacts_of_the_engine_events_follow_from_the_shapes_of_bodies(tmp_path: Path) -> None:
    with Simulation(KnowledgeBase(), make_engine("null")) as simulation:
        simulation.spawn(kitchenette())
        x, y, z = simulation.snapshot().body(MUG).pose.position
        with Recorder(simulation, tmp_path / "run.mcap") as recorder:
            for number in range(60):
                lifted = SetPoses({MUG: Pose((x, y, z + 0.02 * max(abs(number - 30) - 15, 0)))})
                simulation.engine.run(lambda engine, edit=lifted: engine.apply(edit), edits=True)
                simulation.step(1 / 30)
        assert recorder.error is None
    with Episode(tmp_path / "run.mcap") as episode:
        assert any(each.kind is EpisodeEventKind.SUPPORT and each.thing == MUG for each in episode.events())
        assert episode._final_events() == detect_events(episode)


def test_the_time_of_a_recording_goes_on_whatever_clock_an_edit_restores(
    simulation: Simulation, tmp_path: Path
) -> None:
    with Recorder(simulation, tmp_path / "run.mcap") as recorder:
        simulation.step(1.0)
        simulation.edits.reset()
        assert simulation.state.time_s == 0.0
        simulation.step(0.2)
        assert recorder.time_s == pytest.approx(1.2, abs=0.04)
        simulation.edits.undo()
        assert simulation.state.time_s == pytest.approx(1.0)
        simulation.step(0.2)
        assert recorder.time_s == pytest.approx(1.4, abs=0.04)
    with Episode.open(tmp_path / "run.mcap") as episode:
        assert episode.end_s == pytest.approx(1.4, abs=0.04)


def put_into_an_empty_world(simulation: Simulation) -> None:
    simulation.clear()
    simulation.step(0.1)
    simulation.spawn(kitchenette())


def lift_and_delete_the_hand(simulation: Simulation) -> None:
    edit(simulation, lambda engine: engine.apply(Attach(HAND.id, MUG)))
    lift(simulation, 0.3)
    edit(simulation, lambda engine: engine.apply(Delete((HAND.id,))))


def delete_the_hand_at_once(simulation: Simulation) -> None:
    edit(simulation, lambda engine: engine.apply(Attach(HAND.id, MUG)))
    simulation.step(0.2)
    edit(simulation, lambda engine: engine.apply(Delete((HAND.id,))))


def delete_the_support(simulation: Simulation) -> None:
    def change(engine: Engine) -> None:
        engine.apply(Delete((BodyId("Cupboard"), BodyId("Drawer"), BodyId("DrawerHandle"))))
        engine.apply(Attach(HAND.id, MUG))

    edit(simulation, change)


@pytest.mark.parametrize(
    "edits",
    [put_into_an_empty_world, lift_and_delete_the_hand, delete_the_hand_at_once, delete_the_support],
    ids=lambda each: each.__name__,
)
def test_no_edit_ends_a_recording(simulation: Simulation, tmp_path: Path, edits: Callable[[Simulation], None]) -> None:
    simulation.spawn(World(iri=HAND.iri, bodies=(HAND,)))
    with Recorder(simulation, tmp_path / "run.mcap"):
        simulation.step(0.3)
        edits(simulation)
        simulation.step(0.5)
        ids = set(simulation.state.ids)
    with Episode.open(tmp_path / "run.mcap") as episode:
        assert set(episode.frame_at(episode.end_s).ids) == ids
        grasps = [event for event in episode.events() if event.kind is EpisodeEventKind.GRASP]
        assert [event.thing for event in grasps] == ([] if edits is put_into_an_empty_world else [MUG])
        picked_up = [event for event in episode.events() if event.kind is EpisodeEventKind.PICK_UP]
        assert [event.agent for event in picked_up] == (["Hand"] if edits is lift_and_delete_the_hand else [])
        for event in grasps:
            assert event.begin_s == pytest.approx(0.3, abs=0.05)
            assert (event.end_s is None) == (HAND.id in ids)


def test_events_of_a_recording_without_them_are_detected_when_it_is_read(
    simulation: Simulation, tmp_path: Path
) -> None:
    simulation.step(0.5)
    with Recorder(simulation, tmp_path / "without.mcap", events=False), Recorder(simulation, tmp_path / "with.mcap"):
        simulation.engine.run(lambda engine: engine.apply(SetPoses({BodyId("Mug"): Pose((0.0, 0.0, 1.0))})), edits=True)
        simulation.step(1.0)
    with Episode(tmp_path / "without.mcap") as without, Episode(tmp_path / "with.mcap") as recorded:
        assert not without.header.has_events
        assert [each.kind for each in without.events()] == [each.kind for each in recorded.events()] != []


def test_an_edit_between_two_frames_is_a_frame(simulation: Simulation, tmp_path: Path) -> None:
    with Recorder(simulation, tmp_path / "run.mcap", rate_hz=5.0) as recorder:
        simulation.step(0.25)
        before = recorder.frames
        edit(simulation, lambda engine: engine.apply(SetLabel(id=MUG, text="first")))
        simulation.step(0.05)
        edit(simulation, lambda engine: engine.apply(SetLabel(id=MUG, text="second")))
        assert recorder.frames == before + 2
        simulation.step(0.3)
    labels = {0.22: None, 0.26: "first", 0.29: "first", 0.31: "second", 0.6: "second"}
    with Episode.open(tmp_path / "run.mcap") as episode:
        found = {time_s: episode.frame_at(time_s).world().body("Mug").label for time_s in labels}
    assert found == labels


def test_a_playing_simulation_is_recorded(simulation: Simulation, tmp_path: Path) -> None:
    with Recorder(simulation, tmp_path / "run.mcap"):
        simulation.play(speed=4.0)
        deadline = time.monotonic() + 60.0
        while simulation.state.time_s < 1.0 and time.monotonic() < deadline:
            time.sleep(0.02)
        simulation.pause()
    with Episode(tmp_path / "run.mcap") as episode:
        assert episode.end_s == pytest.approx(simulation.state.time_s, abs=1e-9)
        times = [frame.time_s for frame in episode.frames()]
        assert np.diff(times[:-1]).max() < 2 / 30  # however long a tick was


def test_a_simulation_without_a_thread_is_recorded(tmp_path: Path) -> None:
    with Simulation(KnowledgeBase(), make_engine("mujoco"), threaded=False) as simulation:
        simulation.spawn(kitchenette())
        with Recorder(simulation, tmp_path / "run.mcap"):
            simulation.step(0.5)
    assert episode_end(tmp_path / "run.mcap") == pytest.approx(0.5, abs=0.003)


def test_closing_the_simulation_finishes_the_file(tmp_path: Path) -> None:
    with Simulation(KnowledgeBase(), make_engine("mujoco")) as simulation:
        simulation.spawn(kitchenette())
        recorder = Recorder(simulation, tmp_path / "run.mcap")
        simulation.step(0.5)
    assert not recorder.recording
    recorder.stop()
    with Episode(tmp_path / "run.mcap") as episode:
        assert episode.losses == ()


def test_two_recorders_at_once_write_the_same_states(simulation: Simulation, tmp_path: Path) -> None:
    with Recorder(simulation, tmp_path / "a.mcap"), Recorder(simulation, tmp_path / "b.mcap", rate_hz=10.0):
        drop_the_mug(simulation, tmp_path / "c.mcap")
    with Episode(tmp_path / "a.mcap") as a, Episode(tmp_path / "b.mcap") as b:
        last_a, last_b = a.frame_at(a.end_s), b.frame_at(b.end_s)
    assert np.array_equal(last_a.poses, last_b.poses)


def test_a_file_that_exists_is_not_overwritten(simulation: Simulation, tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_bytes(b"precious")
    with pytest.raises(EpisodeFileError, match="it exists"):
        Recorder(simulation, tmp_path / "run.mcap")
    assert (tmp_path / "run.mcap").read_bytes() == b"precious"


def test_other_suffixes_folders_and_rates_are_refused(simulation: Simulation, tmp_path: Path) -> None:
    with pytest.raises(EpisodeFileError, match=r"ends with \.mcap"):
        Recorder(simulation, tmp_path / "run.bag")
    with pytest.raises(EpisodeFileError, match="No such file"):
        Recorder(simulation, tmp_path / "missing" / "run.mcap")
    for rate in (0.0, -1.0, float("nan"), 1e6):
        with pytest.raises(InvalidArgumentError, match="Hz"):
            Recorder(simulation, tmp_path / "run.mcap", rate_hz=rate)
    assert not list(tmp_path.iterdir())


def test_a_full_disk_stops_the_recording_and_not_the_simulation(
    simulation: Simulation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_: int) -> None:
        raise OSError(28, "No space left on device")

    recorder = Recorder(simulation, tmp_path / "run.mcap")
    monkeypatch.setattr(os, "fdatasync", fail)
    for _ in range(600):
        simulation.step(0.2)
        time.sleep(0.1)
        if not recorder.recording:
            break
    assert not recorder.recording
    simulation.step(0.1)
    with pytest.raises(EpisodeFileError, match="No space left"):
        recorder.stop()


def test_a_fault_in_the_detection_of_events_is_shown_at_once_and_nothing_else_is_lost(
    simulation: Simulation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    execute_in_detection(monkeypatch, failing_detection(0.9, 1.1))
    with Recorder(simulation, tmp_path / "run.mcap") as recorder:
        simulation.step(0.5)
        assert recorder.error is None
        simulation.step(1.0)
        recorder.flush()
        assert "a planted bug" in str(recorder.error)
        with Episode(tmp_path / "run.mcap") as episode:  # as if the process were killed now
            assert len(episode.faults()) == 1
        simulation.engine.run(lambda engine: engine.apply(SetPoses({BodyId("Mug"): Pose((0.0, 0.5, 1.0))})), edits=True)
        simulation.step(2.0)
        assert recorder.recording
    assert "a planted bug" in str(recorder.error)
    with Episode(tmp_path / "run.mcap") as episode:
        times = [frame.time_s for frame in episode.frames()]
        assert (times[0], times[-1]) == (0.0, pytest.approx(3.5))
        assert np.diff(times).max() < 0.05
        (fault,) = episode.faults()
        assert "a planted bug" in fault
        assert "0.9" in fault
        assert any(event.kind is EpisodeEventKind.FALL and event.begin_s > 1.4 for event in episode.events())


def _bump(simulation: Simulation, *, seconds: float = 1.0) -> None:
    """Lets a mug fall."""
    simulation.engine.run(lambda engine: engine.apply(SetPoses({BodyId("Mug"): Pose((0.0, 0.5, 1.0))})), edits=True)
    simulation.step(seconds)


@pytest.mark.parametrize(
    "code",
    [
        "import os; os._exit(3)",
        "import sys; sys.argv[1] = 'none'\n",
        "print('noise')\nfrom mindstage.episodes import event_process as e\ndef fail(*_): raise MemoryError\n"
        "e._Detection.take = fail\n",
        "from mindstage.episodes import detection as d\ndef fail(*_): raise MemoryError\n"
        "d.EventDetector.update = fail\n",
        "import os, sys; os.write(int(sys.argv[2]), b'noise that is no message' * 9)\n",
    ],
)
def test_without_its_process_events_are_detected_when_the_file_is_read(
    simulation: Simulation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: str
) -> None:
    execute_in_detection(monkeypatch, code)
    with Recorder(simulation, tmp_path / "run.mcap") as recorder:
        _bump(simulation)
        recorder.flush()
        _bump(simulation)
    assert "detected when the file is read" in str(recorder.error) or "the detection ended" in str(recorder.error)
    with Episode(tmp_path / "run.mcap") as episode:
        assert episode.end_s == pytest.approx(2.0)
        assert len(episode.faults()) == 1
        assert episode.events() == detect_events(episode)
        assert [each.kind for each in episode.events()].count(EpisodeEventKind.FALL) == 2


def test_a_detection_that_cannot_follow_is_given_up_and_said_so(
    simulation: Simulation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    execute_in_detection(monkeypatch, "import time; time.sleep(60)\n")
    monkeypatch.setattr(event_process, "_PIPE_BYTES", 4096)
    monkeypatch.setattr(event_process, "_MAX_UNSENT_BYTES", 20_000)
    monkeypatch.setattr(recorder_module, "_LATE_S", 0.0)
    with Recorder(simulation, tmp_path / "run.mcap") as recorder:
        for _ in range(10):
            _bump(simulation, seconds=0.4)
    assert "behind" in str(recorder.error)
    with Episode(tmp_path / "run.mcap") as episode:
        assert episode.end_s == pytest.approx(4.0)
        assert sum(event.kind is EpisodeEventKind.FALL for event in episode.events()) == 10


def test_a_detection_that_hangs_does_not_hang_the_recording(
    simulation: Simulation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    execute_in_detection(monkeypatch, "import time; time.sleep(60)\n")
    monkeypatch.setattr(recorder_module, "_STOP_TIMEOUT_S", 1.0)
    monkeypatch.setattr(recorder_module, "_SILENT_S", 0.5)
    with Recorder(simulation, tmp_path / "run.mcap") as recorder:
        simulation.step(0.5)
        recorder.flush()
    assert "no progress" in str(recorder.error)
    with Episode(tmp_path / "run.mcap") as episode:
        assert episode.end_s == pytest.approx(0.5)


def test_stopping_waits_as_long_as_there_is_progress(
    simulation: Simulation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_map = recorder_module.write_map

    def compute_long(world: World) -> str:
        end_s = time.thread_time() + 3.0
        while time.thread_time() < end_s:
            pass
        return write_map(world)

    recorder = Recorder(simulation, tmp_path / "run.mcap")
    simulation.step(0.5)
    recorder.flush()
    stuck = Recorder(simulation, tmp_path / "stuck.mcap")
    stuck.flush()
    monkeypatch.setattr(recorder_module, "_STOP_TIMEOUT_S", 2.0)
    monkeypatch.setattr(recorder_module, "_WAIT_S", 0.05)
    monkeypatch.setattr(recorder_module, "write_map", compute_long)
    parts: list[float] = []
    recorder.stop(progress=parts.append)
    assert len(parts) > 10
    assert all(0.0 <= part <= 1.0 for part in parts)
    with Episode(tmp_path / "run.mcap") as episode:
        assert episode.map_at_end

    def wait_long(world: World) -> str:
        released.wait(60.0)
        return write_map(world)

    released = threading.Event()
    monkeypatch.setattr(recorder_module, "write_map", wait_long)
    with pytest.raises(EpisodeFileError, match="nothing was written"):
        stuck.stop()
    released.set()
    stuck.stop()


def test_events_are_found_while_the_simulation_plays(simulation: Simulation, tmp_path: Path) -> None:
    with Recorder(simulation, tmp_path / "run.mcap") as recorder:
        recorder.flush()
        simulation.play()
        fallen = SetPoses({BodyId("Mug"): Pose((0.0, 0.5, 1.0))})
        simulation.engine.run(lambda engine: engine.apply(fallen), edits=True)
        wait_until(
            lambda: any(each.kind is EpisodeEventKind.FALL for each in recorder.live_events), "the fall is found"
        )
        assert all(each.state is not EventState.WITHDRAWN for each in recorder.live_events)
        assert recorder.recording


STARTS = {
    "from standard input": ([sys.executable, "-"], "record()"),
    "from the command line": ([sys.executable, "-c"], "record()"),
    "spawned": (
        [sys.executable, "FILE"],
        "if __name__ == '__main__':\n"
        "    p = multiprocessing.get_context('spawn').Process(target=record); p.start(); p.join(60); exit(p.exitcode)",
    ),
    "forked": (
        [sys.executable, "FILE"],
        "record('first.mcap')\n"  # its process is idle then, and belongs to the parent
        "p = multiprocessing.get_context('fork').Process(target=record); p.start(); p.join(60); exit(p.exitcode)",
    ),
}
STARTED = """
import multiprocessing, sys
import mindstage as ms
from mindstage.episodes import Recorder
from mindstage.episodes.event_process import EventProcess
def record(path="run.mcap"):
    with ms.open(engine="null") as simulation, Recorder(simulation, path) as recorder:
        simulation.step(0.5)
    if recorder.error is not None:
        raise recorder.error
"""


@pytest.mark.parametrize("name", STARTS)
def test_events_are_detected_however_a_program_is_started(tmp_path: Path, name: str) -> None:
    command, call = STARTS[name]
    code = f"{STARTED}\n{call}\n"
    (tmp_path / "program.py").write_text(code)
    command = [str(tmp_path / "program.py") if each == "FILE" else each for each in command]
    done = subprocess.run(
        [*command, code] if command[-1] == "-c" else command,
        input=code if command[-1] == "-" else None,
        cwd=tmp_path, capture_output=True, text=True, timeout=100.0, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    with Episode(tmp_path / "run.mcap") as episode:
        assert episode._final_events() is not None


def test_what_cannot_be_attached_is_a_fault_and_the_states_are_recorded(
    simulation: Simulation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any, **__: Any) -> Any:
        raise KeyError("a planted bug")

    monkeypatch.setattr(recorder_module, "write_map", fail)
    with Recorder(simulation, tmp_path / "run.mcap") as recorder:
        simulation.step(1.0)
    assert "a planted bug" in str(recorder.error)
    with Episode(tmp_path / "run.mcap") as episode:
        assert episode.end_s == pytest.approx(1.0)
        assert all("a planted bug" in fault for fault in episode.faults())
        assert len(episode.faults()) == 2
        with pytest.raises(EpisodeFileError, match="the map at the end is not in the file"):
            _ = episode.map_at_end


def test_episodes_of_one_folder_have_large_contents_in_common(
    simulation: Simulation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mcap_file, "_MAX_COPIED_BYTES", 300)
    for name in ("one", "two"):
        with Recorder(simulation, tmp_path / f"{name}.mcap"):
            simulation.step(0.2)
        if name == "one":
            contents = sorted((tmp_path / "contents").iterdir())
    assert contents
    alone = tmp_path / "alone"
    alone.mkdir()
    with Recorder(simulation, alone / "whole.mcap", self_contained=True):
        simulation.step(0.2)
    assert [path.name for path in alone.iterdir()] == ["whole.mcap"]
    assert set(contents) <= set((tmp_path / "contents").iterdir())
    with Episode(tmp_path / "two.mcap") as episode, Episode(alone / "whole.mcap") as whole:
        assert episode.losses == whole.losses == ()
        assert episode.geometry.keys() == whole.geometry.keys()
        assert episode.map_at_begin == whole.map_at_begin
        assert episode.knowledge().to_bytes()
    contents_before = shutil.copytree(tmp_path / "contents", tmp_path / "before")
    for path in (tmp_path / "contents").iterdir():
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 1
        path.write_bytes(data)
    with Episode(tmp_path / "two.mcap") as episode:
        assert len(list(episode.frames())) > 5
        assert all("contents" in loss.cause for loss in episode.losses)
        with pytest.raises(EpisodeFileError, match="damaged"):
            episode.knowledge()
    shutil.rmtree(tmp_path / "contents")
    lost = r"knowledge.*copy the folder 'contents'"
    with Episode(tmp_path / "two.mcap") as episode, pytest.raises(EpisodeFileError, match=lost):
        episode.knowledge()
    assert repair(tmp_path / "one.mcap", tmp_path / "repaired.mcap")
    shutil.copytree(contents_before, tmp_path / "contents")
    with Episode(tmp_path / "repaired.mcap") as episode:
        assert len(list(episode.frames())) > 5
        assert "<rdf:RDF" in episode.map_at_begin


KILLED = """
import sys, time
from mindstage.episodes import Recorder
from mindstage.engines import make_engine
from mindstage.knowledge import KnowledgeBase
from mindstage.simulation import Simulation
from tests.kitchenette import kitchenette

simulation = Simulation(KnowledgeBase(), make_engine("mujoco"))
simulation.spawn(kitchenette())
recorder = Recorder(simulation, sys.argv[1])
simulation.play()
while True:
    time.sleep(0.05)
    print(f"{time.time()} {recorder.time_s}", flush=True)
"""


def test_a_killed_process_loses_little(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    process = subprocess.Popen(
        [sys.executable, "-c", KILLED, str(path)], stdout=subprocess.PIPE, text=True, env=os.environ
    )
    assert process.stdout is not None
    seen: list[tuple[float, float]] = []
    deadline = time.monotonic() + 60.0
    for line in process.stdout:
        wall_s, time_s = map(float, line.split())
        seen.append((wall_s, time_s))
        if time_s > 5.0 or time.monotonic() > deadline:
            break
    os.kill(process.pid, signal.SIGKILL)
    process.wait(10.0)
    killed_s = time.time()
    process.stdout.close()
    saved = max(time_s for wall_s, time_s in seen if wall_s < killed_s - 3.0)
    assert saved > 1.0
    with Episode(path) as episode:
        assert episode.end_s >= saved
        (loss,) = episode.losses
        assert loss.begin_s == episode.end_s
        assert loss.end_s is None
        assert "interrupted" in loss.cause
        assert len(list(episode.frames())) > 20


FORKED = """
import os, sys, time
from mindstage.episodes.event_process import EventProcess

process = EventProcess(has_joints=False, has_contacts=False)
fork = os.fork()  # it holds the pipes open
if fork:
    print(process._interpreter.process.pid, fork, flush=True)
time.sleep(100)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="it reads /proc")
def test_the_process_that_detects_events_ends_with_a_killed_parent_although_a_fork_holds_its_pipes() -> None:
    def runs(pid: int) -> bool:
        try:
            return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
        except FileNotFoundError:
            return False

    parent = subprocess.Popen([sys.executable, "-c", FORKED], stdout=subprocess.PIPE, text=True, env=os.environ)
    assert parent.stdout is not None
    detecting, fork = map(int, parent.stdout.readline().split())
    try:
        assert runs(detecting)
        parent.kill()
        parent.wait(10.0)
        wait_until(lambda: not runs(detecting), "the process that detects events ends", timeout_s=60.0)
        assert runs(fork)
    finally:
        os.kill(fork, signal.SIGKILL)
        parent.stdout.close()


def test_a_folder_gets_one_recording_at_a_time(simulation: Simulation, tmp_path: Path) -> None:
    recordings = RecordingFolder(simulation, tmp_path / "runs")
    with pytest.raises(EpisodeError, match="nothing is being recorded"):
        recordings.stop()
    first = recordings.start("first")
    simulation.step(0.1)
    with pytest.raises(EpisodeError, match="stop that first"):
        recordings.start("second")
    assert recordings.stop() == first == tmp_path / "runs" / "first.mcap"
    for name in ("../outside", "/tmp/outside", ".hidden", "a/b"):
        with pytest.raises(EpisodeFileError, match="not the name of a file"):
            recordings.start(name)
    unnamed = recordings.start()
    recordings.stop()
    assert sorted((tmp_path / "runs").glob("*.mcap")) == sorted([first, unnamed])


def test_numbers_of_numpy_that_a_program_passes_are_recorded(tmp_path: Path) -> None:
    with Simulation(KnowledgeBase(), make_engine("mujoco")) as simulation:
        simulation.spawn(kitchenette())
        x, y, z = np.array([1.5, 0.0, 1.0])
        with Recorder(simulation, tmp_path / "run.mcap"):
            simulation.pull(BodyId("Mug"), point=(0.0, 0.0, 0.0), target=(x, y, z))
            simulation.step(0.1)
    with Episode(tmp_path / "run.mcap") as episode:
        (pull,) = [edit for edit in episode.edits() if edit.kind == "pull"]
        assert list(pull.details["target"]) == [1.5, 0.0, 1.0]
