"""The timeline of a replay, in a real browser: playing, seeking, events, questions, and continuing from a moment."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from mindstage import KnowledgeBase, MujocoEngine, NullEngine, Simulation
from mindstage.episodes import EpisodeEvent, EpisodeEventKind, FrameRecording
from mindstage.episodes.episode import Episode
from mindstage.episodes.replay import EpisodeReplay
from mindstage.errors import BodyNotFoundError, InvalidArgumentError, UnsupportedByEngineError
from mindstage.scene import BodyId, Pose
from mindstage.scene.edits import SetPoses
from mindstage.viewer import Viewer
from mindstage.viewer.scene import BodyNodes
from tests.episodes.kitchenette_recording import DRAWER, EVENTS, MUG, kitchenette_recording
from tests.kitchenette import kitchenette
from tests.viewer.page_client import RequestFailedError, connect_page_client
from tests.viewer.page_tab import PageTab
from tests.viewer.waiting import wait_until


@pytest.fixture
def replay() -> Iterator[EpisodeReplay]:
    with EpisodeReplay(kitchenette_recording(), KnowledgeBase()) as replay:
        yield replay


@pytest.fixture
def viewer(replay: EpisodeReplay) -> Iterator[Viewer]:
    with Viewer(replay, port=0) as viewer:
        yield viewer


@pytest.fixture
def tab(viewer: Viewer, open_page: Callable[..., PageTab]) -> PageTab:
    tab = open_page(viewer, view=False)
    wait_until(lambda: tab.page.locator("#timeline").is_visible(), "the timeline is shown")
    return tab


def drawn_position(viewer: Viewer, id: str) -> np.ndarray:
    """Where the view draws a body [m]."""
    return sent_position(viewer._scene._bodies, id)


def sent_position(nodes: BodyNodes, id: str) -> np.ndarray:
    """The position that was sent to the views [m]."""
    assert nodes._blocks is not None
    return np.array(nodes._blocks._rows[nodes._rows[id], :3])  # type: ignore[index]


def pose(replay: EpisodeReplay, id: str) -> np.ndarray:
    return np.array(replay.state.poses[replay.state.ids.index(id)])  # type: ignore[arg-type]


def test_the_timeline_shows_the_length_and_the_events_by_kind(tab: PageTab) -> None:
    wait_until(lambda: "0:00.00 / 0:04.00" in tab.page.locator("[data-role=timeline-time]").inner_text(), "the length")
    wait_until(lambda: tab.page.locator("[data-event]").count() == len(EVENTS), "the events")
    box = tab.page.locator("[data-role=timeline-lanes]").bounding_box()
    bar = tab.page.locator("[data-event=Grasping_1]").bounding_box()
    assert (bar["x"] - box["x"]) / box["width"] == pytest.approx(0.5, abs=0.01)
    assert bar["width"] / box["width"] == pytest.approx(0.25, abs=0.01)
    tab.page.locator("[data-kind=Grasping]").click()
    assert tab.page.locator("[data-event=Grasping_1]").count() == 0
    assert tab.page.locator("[data-event]").count() == len(EVENTS) - 1
    tab.page.locator("[data-kind=Grasping]").click()
    assert tab.page.locator("[data-event=Grasping_1]").count() == 1


@pytest.mark.parametrize(
    ("kinds", "note"),
    [
        ([EpisodeEventKind.GRASP, EpisodeEventKind.SUPPORT], ""),
        ([EpisodeEventKind.SUPPORT], "No event begins or ends."),
        ([], "No events."),
    ],
)
def test_what_is_done_all_the_time_is_an_event(
    open_page: Callable[..., PageTab], kinds: list[EpisodeEventKind], note: str
) -> None:
    whole = kitchenette_recording()
    events = [EpisodeEvent(id=f"{kind}_1", kind=kind, begin_s=0.0, end_s=None, thing=MUG) for kind in kinds]
    recording = FrameRecording([whole.frame_at(time_s) for time_s in (0.0, 1.0)], events=tuple(events))
    with EpisodeReplay(recording, KnowledgeBase()) as replay, Viewer(replay, port=0) as viewer:
        tab = open_page(viewer, view=False)
        shown = tab.page.locator("[data-role=timeline-note]")
        wait_until(lambda: tab.page.locator("#timeline").is_visible() and shown.inner_text() == note, "the note")
        wait_until(lambda: tab.page.locator("[data-event]").count() == kinds.count(EpisodeEventKind.GRASP), "the bars")


def test_moving_the_slider_moves_the_bodies(tab: PageTab, viewer: Viewer, replay: EpisodeReplay) -> None:
    slider = tab.page.get_by_role("slider", name="Time in the recording")
    slider.fill("2.5")
    wait_until(lambda: replay.state.time_s == 2.5, "the time is shown")
    recorded = replay.recording.frame_at(2.5)
    expected = recorded.poses[recorded.ids.index(MUG)][:3]
    wait_until(lambda: np.allclose(drawn_position(viewer, MUG), expected, atol=1e-6), "the mug is drawn there")
    slider.press("ArrowLeft")
    wait_until(lambda: replay.state.time_s == pytest.approx(2.49), "an arrow key moves it too")
    assert slider.get_attribute("aria-valuetext") == "2.49 seconds of 4.00"


def test_playing_ends_at_the_end_and_begins_again(tab: PageTab, replay: EpisodeReplay) -> None:
    tab.page.get_by_label("Speed of the replay").select_option("8")
    tab.page.locator("body").press("Space")
    wait_until(lambda: replay.state.playing and replay.state.speed == 8.0, "it plays")
    wait_until(lambda: not replay.state.playing, "it ends")
    assert replay.state.time_s == 4.0
    wait_until(lambda: tab.page.get_by_label("Play the recording").count() == 1, "the page shows the end")
    tab.page.get_by_label("Speed of the replay").select_option("0.5")
    tab.click_button("timeline-play")
    wait_until(lambda: replay.state.playing and replay.state.time_s < 3.5, "it begins again")


def test_the_keyboard_steps_to_events_and_shows_their_evidence(tab: PageTab, replay: EpisodeReplay) -> None:
    wait_until(lambda: tab.page.locator("[data-event]").count() == len(EVENTS), "the events")
    shown = tab.page.locator("[data-role=timeline-event]")
    for event in EVENTS:
        tab.page.locator("body").press("]")
        wait_until(lambda event=event: event.evidence[0] in shown.inner_text(), f"{event.id} is shown")  # type: ignore[misc]
        assert replay.state.time_s == event.begin_s
        wait_until(lambda event=event: tab.selected == event.thing, "its body is selected")  # type: ignore[misc]
    tab.page.locator("body").press("]")
    wait_until(lambda: tab.shows_text("There is no later event."), "there is no other")
    tab.page.locator("body").press("[")
    wait_until(lambda: EVENTS[1].evidence[0] in shown.inner_text(), "the one before is shown")
    tab.page.locator("[data-kind=Opening]").click()
    tab.page.locator("body").press("[")
    wait_until(lambda: tab.shows_text("There is no earlier event."), "hidden kinds are left out")


def test_a_click_on_an_event_shows_it_and_flies_to_it(
    viewer: Viewer, replay: EpisodeReplay, open_page: Callable[..., PageTab]
) -> None:
    tab = open_page(viewer)
    before = tab.camera
    tab.page.locator("[data-event=Falling_1]").click()
    wait_until(lambda: replay.state.time_s == 3.0, "its begin is shown")
    wait_until(lambda: "Mug fell by 1.45 m." in tab.page.locator("[data-role=timeline-event]").inner_text(), "evidence")
    wait_until(lambda: tab.camera is not None and tab.camera != before, "the camera moves")
    wait_until(
        lambda: tab.camera is not None and np.allclose(tab.camera.look_at, pose(replay, MUG)[:3], atol=0.1),
        "it looks at the mug",
    )
    replay.seek(0.0)


def test_the_path_of_the_selected_body_is_drawn(tab: PageTab, viewer: Viewer, replay: EpisodeReplay) -> None:
    tab.select_in_tree("Mug")
    tab.click_button("timeline-trail")
    wait_until(lambda: "trail" in viewer._plans._nodes.layers, "the ghosts are drawn")
    wait_until(lambda: replay.state.markers, "the line is drawn")
    (line,) = replay.state.markers
    heights = [point[2] for point in line.points]
    assert max(heights) == pytest.approx(1.5, abs=0.01)
    assert min(heights) < 0.1
    wait_until(lambda: "Path of Mug" in tab.page.locator("[data-action=timeline-trail]").inner_text(), "it is named")
    tab.click_button("timeline-trail")
    wait_until(lambda: "trail" not in viewer._plans._nodes.layers and not replay.state.markers, "it is removed")
    tab.select_in_tree("Floor")
    tab.click_button("timeline-trail")
    wait_until(lambda: tab.shows_text("it does not move in this recording"), "it is refused for what does not move")


def test_questions_are_answered_at_the_shown_time(tab: PageTab, replay: EpisodeReplay) -> None:
    def answer(time_s: float) -> str:
        replay.seek(time_s)
        tab.open_panel("ask")
        tab.page.locator("[data-role=more-questions]").click()
        tab.page.locator("[data-role=sentence]").fill("where is Mug")
        tab.page.locator("[data-role=sentence]").press("Enter")
        wait_until(lambda: tab.page.locator("div.answers tbody tr").count() > 0, "there is an answer")
        return str(tab.page.locator("div.answers").inner_text())

    assert "Cupboard" in answer(0.2)
    assert "Floor" in answer(4.0)


def test_edits_are_refused_until_it_is_resumed(tab: PageTab, replay: EpisodeReplay) -> None:
    replay.seek(0.3)
    tab.select_in_tree("Mug")
    tab.page.locator("body").press("Delete")
    wait_until(lambda: tab.shows_text("continue from the shown moment with Resume"), "the refusal is shown")
    assert MUG in replay.state.ids
    tab.click_button("timeline-resume")
    wait_until(lambda: replay.resumed_at_s == 0.3, "it is resumed")
    wait_until(lambda: tab.shows_text("live, continued at 0:00.30"), "the page says so")
    assert tab.page.get_by_role("slider", name="Time in the recording").is_disabled()
    tab.page.locator("body").press("Delete")
    wait_until(lambda: MUG not in replay.state.ids, "the mug is deleted")
    tab.click_button("undo")
    wait_until(lambda: MUG in replay.state.ids, "and it is back")
    tab.click_button("timeline-play")
    wait_until(lambda: replay.state.time_s > 0.5, "it is simulated")
    tab.click_button("timeline-return")
    wait_until(lambda: replay.resumed_at_s is None and replay.state.time_s == 0.3, "the recording is shown again")
    assert DRAWER in replay.state.ids


def test_every_control_can_be_reached_and_has_a_name(tab: PageTab) -> None:
    controls = tab.page.locator("#timeline :is(button, input, select):visible:not([tabindex='-1'])")
    names = [
        control.get_attribute("aria-label") or control.inner_text().strip() for control in controls.element_handles()
    ]
    assert len(names) >= 8
    assert all(names)
    tab.page.locator("[data-action=previous-event]").focus()
    reached = set()
    for _ in names:
        reached.add(tab.page.evaluate("document.activeElement.ariaLabel || document.activeElement.textContent.trim()"))
        tab.page.keyboard.press("Tab")
    assert reached == set(names)


def test_a_page_without_a_recording_has_no_timeline(open_page: Callable[..., PageTab], simulation: Simulation) -> None:
    with Viewer(simulation, port=0) as viewer:
        tab = open_page(viewer, view=False)
        wait_until(tab.tree_rows, "the page is complete")
        assert not tab.page.locator("#timeline").is_visible()


def test_a_second_recording_is_drawn_beside_the_first_at_the_same_time(open_page: Callable[..., PageTab]) -> None:
    first, second = kitchenette_recording(), kitchenette_recording(pull=0.5)
    with EpisodeReplay(first, KnowledgeBase(), beside=second) as both, Viewer(both, port=0) as viewer:
        tab = open_page(viewer, view=False)
        wait_until(lambda: tab.page.locator("[data-event]").count() == 2 * len(EVENTS), "the events of both")
        beside = viewer._timeline._beside  # type: ignore[union-attr]
        assert beside is not None
        tab.page.get_by_role("slider", name="Time in the recording").fill("1.5")
        wait_until(lambda: both.state.time_s == 1.5, "the time is shown")

        def drawn() -> np.ndarray:
            return sent_position(beside._nodes, DRAWER)

        frame = second.frame_at(1.5)
        expected = frame.poses[frame.ids.index(DRAWER)][:3]
        wait_until(lambda: np.allclose(drawn(), expected, atol=1e-6), "the second world is drawn at that time")
        assert abs(expected[0] - pose(both, DRAWER)[0]) > 0.1
        assert np.abs(beside._offset).max() > 6.0  # the floor is 6 m wide
        tab.page.locator("[data-event=Falling_1][data-recording='1']").click()
        wait_until(lambda: both.state.time_s == 3.0, "its events can be clicked")


def test_the_record_button_writes_an_episode_that_can_be_replayed(
    open_page: Callable[..., PageTab], tmp_path: Path
) -> None:
    with Simulation(KnowledgeBase(), MujocoEngine()) as simulation:
        simulation.spawn(kitchenette())
        with Viewer(simulation, port=0) as viewer:
            viewer._recording._folder = tmp_path
            tab, other = open_page(viewer, view=False), open_page(viewer, view=False)
            button = tab.page.get_by_role("button", name="Record an episode")
            button.focus()
            tab.page.keyboard.press("Enter")
            wait_until(lambda: tab.shows_text("Recording to map-"), "the name is shown")
            stop = other.page.get_by_role("button", name="Stop recording")
            wait_until(lambda: stop.is_visible() and stop.get_attribute("aria-pressed") == "true", "others see it too")
            tab.click_button("step")
            lifted = SetPoses({MUG: Pose((0.0, 0.5, 1.5))})
            simulation.engine.run(lambda engine: engine.apply(lifted), edits=True)
            simulation.play()
            events = other.page.locator("[data-role=live-events]")
            wait_until(lambda: "Falling: Mug" in events.inner_text(), "events are shown while it is recorded")
            simulation.pause()
            tab.select_in_tree("Mug")
            tab.page.locator("body").press("Delete")
            wait_until(lambda: MUG not in simulation.state.ids, "the mug is deleted")
            other.click_button("record")
            wait_until(lambda: other.shows_text("Replay it with: mindstage replay"), "the file is named")
            wait_until(button.is_visible, "another one can be recorded")
            assert events.is_hidden()
        (path,) = tmp_path.glob("map-*.mcap")
        with Episode(path) as episode:
            assert MUG in episode.frame_at(episode.begin_s).ids
            assert MUG not in episode.frame_at(episode.end_s).ids
            deletion = next(edit for edit in episode.edits() if edit.kind == "delete")
            assert (deletion.client, deletion.ids) == ("viewer", (MUG,))


def test_a_recording_is_finished_when_the_viewer_is_closed(tmp_path: Path) -> None:
    with Simulation(KnowledgeBase(), NullEngine()) as simulation:
        simulation.spawn(kitchenette())
        with Viewer(simulation, port=0) as viewer, connect_page_client(viewer.url) as client:
            viewer._recording._folder = tmp_path
            client.ask("recording.start")
            with pytest.raises(RequestFailedError, match="is being recorded; stop that first"):
                client.ask("recording.start")
        (path,) = tmp_path.glob("map-*.mcap")
        with Episode(path) as episode:
            assert not episode.losses


def test_a_plan_is_tried_in_copies_of_the_shown_moment(tab: PageTab, replay: EpisodeReplay) -> None:
    replay.seek(0.2)
    before = replay.state.poses.copy()
    tab.open_panel("plan")
    tab.page.locator("[data-role=plan]").fill(
        "steps:\n  - {do: move, thing: Mug, to: {position: [1.0, 0.0, 1.2]}}\n  - {do: wait, duration_s: 1}\n"
    )
    tab.page.get_by_label("Samples", exact=True).fill("3")
    tab.click_button("plan-evaluate")
    verdict = tab.page.locator("[data-role=verdict]")
    wait_until(lambda: "Mug fell" in verdict.inner_text(), "the verdict is that of physics")
    assert np.array_equal(replay.state.poses, before)


def test_pulling_a_body_of_a_recording_is_refused_once(replay: EpisodeReplay, viewer: Viewer) -> None:
    replay.seek(0.2)
    wait_until(lambda: MUG in viewer._drag_controller.draggable, "the world is drawn")
    with pytest.raises(UnsupportedByEngineError, match="continue from the shown moment with Resume"):
        viewer._drag_controller.start("page", MUG, (2.0, 0.0, 0.85))
    assert viewer._drag_controller.drag_forces == ()
    replay.play()
    wait_until(lambda: replay.state.time_s > 0.5, "it plays on")
    replay.pause()
    assert replay.state.error == ""


def test_the_path_of_a_body_needs_a_recording(simulation: Simulation, viewer: Viewer) -> None:
    with (
        Viewer(simulation, port=0) as live,
        pytest.raises(InvalidArgumentError, match="the simulation is no recording"),
    ):
        live.show_path(MUG)
    with pytest.raises(BodyNotFoundError, match="Mgu"):
        viewer.show_path(BodyId("Mgu"))
