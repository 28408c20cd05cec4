"""Requests and topics of the timeline of a replay, with real websockets and without a browser."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mindstage import KnowledgeBase, NullEngine, Simulation
from mindstage.episodes import EpisodeFrame, FrameRecording
from mindstage.episodes.episode import Episode
from mindstage.episodes.replay import EpisodeReplay
from mindstage.errors import BodyNotFoundError
from mindstage.rendering.appearance import compute_appearance
from mindstage.scene import BodyId, Pose, World
from mindstage.viewer import Viewer
from mindstage.viewer.episodes import TimelineHandler, path_of
from mindstage.viewer.ghosts import GhostNodes
from mindstage.viewer.server import RpcChannel
from tests.episodes.episodes import execute_in_detection, failing_detection
from tests.episodes.kitchenette_recording import EVENTS, MUG, kitchenette_recording
from tests.kitchenette import kitchenette
from tests.viewer.fake_server import FakeServer
from tests.viewer.page_client import PageClient, RequestFailedError, connect_page_client
from tests.viewer.waiting import wait_until


@pytest.fixture
def replay() -> Iterator[EpisodeReplay]:
    with EpisodeReplay(kitchenette_recording(), KnowledgeBase()) as replay:
        yield replay


@pytest.fixture
def client(replay: EpisodeReplay) -> Iterator[PageClient]:
    with Viewer(replay, port=0) as viewer, connect_page_client(viewer.url) as client:
        wait_until(lambda: recordings(client)[0]["events"] is not None, "the events are found")
        yield client


def recordings(client: PageClient) -> list[Any]:
    timeline = client.latest_value("timeline")
    return timeline["recordings"] if timeline else [{"events": None}]


def state(client: PageClient) -> dict[str, Any]:
    return client.latest_value("timeline_state") or {}


def test_a_page_gets_every_event_of_every_recording_with_its_times() -> None:
    second = FrameRecording(
        list(kitchenette_recording().frames(1.0, 2.5)), name="second", start_unix_s=1.9e9, events=EVENTS[:1]
    )
    with (
        EpisodeReplay(kitchenette_recording(), KnowledgeBase(), beside=second) as both,
        Viewer(both, port=0) as viewer,
        connect_page_client(viewer.url) as client,
    ):
        wait_until(lambda: recordings(client)[-1]["events"] is not None, "the events are found")
        timeline = client.latest_value("timeline")
    assert (timeline["begin_s"], timeline["end_s"]) == (0.0, 4.0)
    found = [
        (each["name"], each["begin_s"], each["end_s"], each["start_unix_s"], each["error"])
        for each in timeline["recordings"]
    ]
    assert found == [
        ("kitchenette.mcap", 0.0, 4.0, 1.8e9, ""),
        ("second", pytest.approx(1.0), pytest.approx(2.5), 1.9e9, ""),
    ]
    events = [
        [(each["id"], each["kind"], each["begin_s"], each["end_s"], each["thing"]) for each in recording["events"]]
        for recording in timeline["recordings"]
    ]
    expected = [(each.id, each.kind.value, each.begin_s, each.end_s, each.thing) for each in EVENTS]
    assert events == [expected, expected[:1]]
    (opening, grasping, falling) = timeline["recordings"][0]["events"]
    assert (opening["joint"], opening["amount"]) == ("DrawerSlide", 0.4)
    assert (grasping["other"], grasping["agent"]) == ("Drawer", "Drawer")
    assert falling["evidence"] == ["Mug fell by 1.45 m."]


@pytest.mark.parametrize(("time_s", "shown"), [(2.5, 2.5), (-1.0, 0.0), (99.0, 4.0), (0.0, 0.0)])
def test_the_shown_time_is_within_the_recording(
    client: PageClient, replay: EpisodeReplay, time_s: float, shown: float
) -> None:
    replay.seek(1.0)
    assert client.ask("timeline.seek", time_s=time_s) == shown
    assert replay.state.time_s == shown
    wait_until(lambda: state(client).get("time_s") == shown, "all pages are told")
    assert (state(client)["playing"], state(client)["resumed_at_s"], state(client)["notes"]) == (False, None, [])


def test_steps_go_to_the_begins_of_events_in_both_directions(client: PageClient, replay: EpisodeReplay) -> None:
    forward = [(client.ask("timeline.step_event"), replay.state.time_s) for _ in range(4)]
    assert forward == [("Opening_1", 0.5), ("Grasping_1", 2.0), ("Falling_1", 3.0), (None, 3.0)]
    back = [(client.ask("timeline.step_event", back=True), replay.state.time_s) for _ in range(3)]
    assert back == [("Grasping_1", 2.0), ("Opening_1", 0.5), (None, 0.5)]
    assert client.ask("timeline.step_event", kinds=["Falling", "Opening"]) == "Falling_1"
    assert client.ask("timeline.step_event", kinds=["Opening"], back=True) == "Opening_1"
    assert client.ask("timeline.step_event", kinds=[]) is None


def test_the_path_of_a_body_is_a_line_through_all_places_until_it_is_removed(
    client: PageClient, replay: EpisodeReplay
) -> None:
    count = client.ask("timeline.trail", id="Mug")
    (line,) = replay.state.markers
    path = path_of(replay.recording, MUG)
    assert len(line.points) == count == len(path)
    np.testing.assert_allclose(line.points, path[:, :3])
    wait_until(lambda: state(client).get("trail") == "Mug", "all pages are told")
    assert client.ask("timeline.trail", id="Drawer") > 5
    (line,) = replay.state.markers
    assert {round(z, 3) for _, _, z in line.points} == {0.65}, "the path of the drawer replaces that of the mug"
    assert client.ask("timeline.trail") == 0
    assert replay.state.markers == ()
    wait_until(lambda: state(client)["trail"] is None, "and that it is gone")
    with pytest.raises(RequestFailedError, match=r"Floor.*it does not move in this recording"):
        client.ask("timeline.trail", id="Floor")
    with pytest.raises(RequestFailedError, match="'Mugg'"):
        client.ask("timeline.trail", id="Mugg")


def test_a_resumed_moment_is_left_by_returning_to_the_recording(client: PageClient, replay: EpisodeReplay) -> None:
    client.ask("timeline.seek", time_s=0.3)
    notes = client.ask("timeline.resume")
    wait_until(lambda: state(client)["resumed_at_s"] == 0.3, "it is resumed")
    assert state(client)["notes"] == notes
    client.ask("delete", ids=["Mug"])
    assert MUG not in replay.state.ids
    client.ask("timeline.return")
    wait_until(lambda: state(client)["resumed_at_s"] is None and state(client)["time_s"] == 0.3, "it is as before")
    assert MUG in replay.state.ids
    assert state(client)["notes"] == []


def test_events_that_cannot_be_found_are_an_error_of_that_recording_only() -> None:
    class Broken(FrameRecording):
        def events(self) -> Any:
            raise BodyNotFoundError(BodyId("Spoon"), known=[])

    class Faulty(FrameRecording):
        def events(self) -> Any:
            raise KeyError("spoon")

    frames = list(kitchenette_recording().frames(0.0, 1.0))
    for kind, words in ((Broken, "Spoon"), (Faulty, "KeyError: 'spoon'; this is a defect of Mindstage")):
        with (
            EpisodeReplay(kind(frames, name="broken"), KnowledgeBase(), beside=kitchenette_recording()) as both,
            Viewer(both, port=0) as viewer,
            connect_page_client(viewer.url) as client,
        ):
            wait_until(lambda client=client: recordings(client)[-1]["events"] is not None, "the search has ended")
            first, second = recordings(client)
        assert (first["events"], second["error"], len(second["events"])) == ([], "", len(EVENTS))
        assert words in first["error"]


# -- paths -------------------------------------------------------------------------------------------------------------


def moving(*xs: float | None) -> FrameRecording:
    """A recording in which the mug is at these places; None: it does not exist."""
    world = kitchenette()
    rest = tuple(body for body in world.bodies if body.id != MUG)

    def frame(number: int, x: float | None) -> EpisodeFrame:
        bodies = rest if x is None else (*rest, world.body("Mug"))
        poses = [(*body.pose.position, *body.pose.quaternion) for body in bodies]
        if x is not None:
            poses[-1] = (x, 0.0, 0.0, *Pose().quaternion)
        structure = World(iri=world.iri, bodies=bodies)
        ids = tuple(body.id for body in bodies)
        return EpisodeFrame(time_s=float(number), structure=structure, ids=ids, poses=np.array(poses))

    return FrameRecording([frame(number, x) for number, x in enumerate(xs)], name="path")


@pytest.mark.parametrize(
    ("xs", "expected"),
    [
        ((0.0, 1.0, 1.0, 2.0), [0.0, 1.0, 2.0]),
        ((0.0, 0.001, 0.0019, 0.0021, 0.004, 1.0), [0.0, 0.0021, 1.0]),
        ((None, 1.0, None, 3.0, None), [1.0, 3.0]),
        ((5.0,), [5.0]),
        ((0.0, 1.0, 0.0), [0.0, 1.0, 0.0]),
    ],
)
def test_a_path_has_every_place_once_in_a_row(xs: tuple[float | None, ...], expected: list[float]) -> None:
    assert path_of(moving(*xs), MUG)[:, 0].tolist() == expected


def test_a_long_path_is_thinned_out_evenly_with_both_ends() -> None:
    path = path_of(moving(*(0.01 * number for number in range(2500))), MUG)[:, 0]
    assert len(path) == 2000
    assert (path[0], path[-1]) == (0.0, pytest.approx(24.99))
    assert set(np.round(np.diff(path), 6)) == {0.01, 0.02}


def test_the_path_of_an_unknown_body_names_those_of_the_recording() -> None:
    with pytest.raises(BodyNotFoundError, match=r"Mugg.*path.*near: 'Mug'"):
        path_of(moving(None, 1.0), BodyId("Mugg"))


# -- recording ---------------------------------------------------------------------------------------------------------


def test_recording_from_a_page_is_shown_to_all_and_gives_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    execute_in_detection(monkeypatch, failing_detection(0.3, 9.0))
    with Simulation(KnowledgeBase(), NullEngine(), primitive_shapes=True) as sim:
        sim.spawn(World(iri=kitchenette().iri, name="Ann's  kitchen / 2", bodies=kitchenette().bodies))
        with (
            Viewer(sim, port=0) as viewer,
            connect_page_client(viewer.url) as client,
            connect_page_client(viewer.url) as other,
        ):
            with pytest.raises(RequestFailedError, match=r"recording.*there is none"):
                client.ask("recording.stop")
            name = client.ask("recording.start")
            wait_until(lambda: (other.latest_value("recording") or {}).get("path") == name, "others see it")
            sim.step(1.6)
            wait_until(lambda: other.latest_value("recording")["time_s"] == 2, "and for how long")
            assert not other.latest_value("recording")["failed"]
            sim.step(0.4)  # a frame is searched for events when the next one has come
            wait_until(lambda: "a planted bug" in (other.latest_value("recording")["fault"] or ""), "a fault is shown")
            assert str(tmp_path) not in other.latest_value("recording")["fault"]
            sim.edits.delete([MUG])
            stopped = other.ask("recording.stop")
            wait_until(lambda: client.latest_value("recording")["path"] is None, "it has ended")
    assert name.startswith("Ann-s-kitchen-2-2")
    assert stopped["path"] == name
    assert stopped["time_s"] == pytest.approx(2.0, abs=0.05)
    assert stopped["size_bytes"] == (tmp_path / name).stat().st_size > 1000
    with Episode(tmp_path / name) as episode:
        assert (MUG in episode.frame_at(episode.begin_s).ids, MUG in episode.frame_at(episode.end_s).ids) == (
            True,
            False,
        )


# -- a recording beside another ----------------------------------------------------------------------------------------


def test_a_second_recording_is_drawn_apart_from_the_first_at_the_shown_time() -> None:
    server, offsets = FakeServer(), []
    first, second = moving(0.0, 1.0, 2.0), moving(0.0, 3.0, 6.0)
    with EpisodeReplay(first, KnowledgeBase(), beside=second) as both:
        handler = TimelineHandler(
            both,
            RpcChannel(),
            server,  # type: ignore[arg-type]
            GhostNodes(server),  # type: ignore[arg-type]
            on_beside=offsets.append,
        )
        appearances = compute_appearance(kitchenette(), both.knowledge.shape_rule, both.knowledge.ancestors)

        def mug_at(time_s: float) -> list[float]:
            both.seek(time_s)
            handler.update(both.state, appearances)
            return np.asarray(server.scene.nodes["/beside/bodies/Mug"].position).tolist()

        assert [mug_at(time_s)[0] for time_s in (0.0, 1.0, 2.0, 1.0)] == [0.0, 3.0, 6.0, 3.0]
    (offset,) = offsets
    frame = vars(server.scene.nodes["/beside"])
    assert (frame["position"], frame["show_axes"]) == (pytest.approx(offset), False)
    # the floor is 6 m wide, and a tenth of it and half a meter are between the two
    assert sorted(offset.tolist()) == pytest.approx([0.0, 0.0, 7.1])
    names = [vars(node) for name, node in server.scene.nodes.items() if name.startswith("/episode names/")]
    assert [each["content"] for each in names] == [("path",), ("path",)]
    apart = np.subtract(names[1]["position"], names[0]["position"])
    assert np.abs(apart).max() == pytest.approx(np.abs(offset).max(), abs=1.5)
