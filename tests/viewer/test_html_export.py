"""An episode as one page that plays by itself."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import zstandard
from msgspec.structs import replace

from mindstage.episodes import EpisodeEvent, EpisodeEventKind, EpisodeFrame, FrameRecording
from mindstage.errors import EpisodeFileError
from mindstage.scene.transforms import pose_array
from mindstage.viewer.html_export import write_html
from tests.episodes.episodes import DRAWER, kitchenette_episode
from tests.kitchenette import kitchenette

PATIENCE_S = 60.0


def recorded_messages(page: Path) -> dict[str, Any]:
    """What viser's page is given to play: messages with their times, by viser's documented layout."""
    text = page.read_text(encoding="utf-8")
    found = re.search(r'__VISER_EMBED_DATA__="([A-Za-z0-9+/=]+)"', text)
    assert found
    data = base64.b64decode(found[1])
    content = zstandard.ZstdDecompressor().decompressobj().decompress(data[8:])
    size = int.from_bytes(content[:8], "little")
    decoded: dict[str, Any] = msgspec.msgpack.decode(content[8 : 8 + size])
    return decoded


def positions_of(recorded: dict[str, Any], name: str) -> list[tuple[float, tuple[float, ...]]]:
    """The times and positions at which a node is."""
    return [
        (time, tuple(message["position"]))
        for time, message in recorded["messages"]
        if message["type"] == "SetPositionMessage" and message["name"] == name
    ]


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("html") / "run.html"
    report = write_html(kitchenette_episode(), path)
    assert report.frames == 31
    assert report.duration_s == pytest.approx(1.0)
    assert report.size_bytes == path.stat().st_size < 3_000_000
    return path


def test_each_pose_is_in_the_page_at_its_time(page: Path) -> None:
    recorded = recorded_messages(page)
    assert recorded["durationSeconds"] == pytest.approx(1.0)
    moves = dict(positions_of(recorded, "/bodies/Drawer"))
    episode = kitchenette_episode()
    assert len(moves) > 10
    for time, position in moves.items():
        frame = episode.frame_at(min(time + 1e-4, episode.end_s))
        expected = frame.poses[frame.ids.index(DRAWER)][:3]
        np.testing.assert_allclose(position, expected, atol=1e-3)


def test_what_does_not_move_is_written_once(page: Path) -> None:
    assert len(positions_of(recorded_messages(page), "/bodies/Fridge")) == 1


def test_a_lower_rate_has_fewer_frames_and_the_last_one(tmp_path: Path) -> None:
    path = tmp_path / "slow.html"
    assert write_html(kitchenette_episode(), path, rate_hz=4.0, speed=0.5).frames == 5
    recorded = recorded_messages(path)
    assert recorded["durationSeconds"] == pytest.approx(2.0)
    last = kitchenette_episode().frame_at(1.0)
    _, position = positions_of(recorded, "/bodies/Drawer")[-1]
    np.testing.assert_allclose(position, last.poses[last.ids.index(DRAWER)][:3], atol=1e-3)


def test_what_happens_is_named_above_its_body_while_it_lasts(page: Path) -> None:
    labels = [
        (time, message["type"], message.get("props", {}).get("text"))
        for time, message in recorded_messages(page)["messages"]
        if message.get("name") == "/events/Drawer"
    ]
    (begin, _, text), *_, (end, type, _) = labels
    assert begin == pytest.approx(0.25, abs=1 / 30)
    assert text == "Opening"
    assert (type, end) == ("RemoveSceneNodeMessage", pytest.approx(1.0, abs=1 / 30))


def test_relations_such_as_contacts_are_not_named(page: Path) -> None:
    names = {message.get("name", "") for _, message in recorded_messages(page)["messages"]}
    assert not {name for name in names if name.startswith("/events/Mug")}


def test_bodies_that_come_and_go_do_so_in_the_page(tmp_path: Path) -> None:
    world = kitchenette()
    fewer = replace(world, bodies=tuple(body for body in world.bodies if body.id != "Mug"))

    def frames() -> Iterator[EpisodeFrame]:
        for time, each in enumerate((fewer, world, fewer)):
            poses = np.array([(*body.pose.position, *body.pose.quaternion) for body in each.bodies])
            yield EpisodeFrame(
                time_s=float(time), structure=each, ids=tuple(body.id for body in each.bodies), poses=poses
            )

    path = tmp_path / "mug.html"
    write_html(FrameRecording(frames()), path)
    messages = recorded_messages(path)["messages"]
    about_mug = [(time, message["type"]) for time, message in messages if message.get("name") == "/bodies/Mug"]
    assert {time for time, type in about_mug if type == "FrameMessage"} == {1.0}
    assert {time for time, type in about_mug if type == "RemoveSceneNodeMessage"} == {2.0}


def test_a_folder_that_does_not_exist_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(EpisodeFileError, match=r"none/run\.html"):
        write_html(kitchenette_episode(), tmp_path / "none" / "run.html")


def test_the_page_plays_in_a_browser_without_a_server(page: Path, browser: Any) -> None:
    tab = browser.new_page(viewport={"width": 320, "height": 240})
    requests: list[str] = []
    tab.on("request", lambda request: requests.append(request.url))
    try:
        tab.goto(page.as_uri())
        tab.wait_for_selector("canvas", timeout=1000 * PATIENCE_S)
        # The time in the field beside the timeline advances.
        field = "Array.from(document.querySelectorAll('input')).map(each => each.value).join(' ')"
        first = tab.evaluate(field)
        tab.wait_for_function(f"({field}) !== {first!r}", timeout=1000 * PATIENCE_S)
        assert re.search(r"\d\.\d", first)
        assert [url for url in requests if url.startswith(("http:", "https:", "ws"))] == []
    finally:
        tab.close()


def test_an_event_is_named_from_the_frame_at_its_begin_to_the_frame_at_its_end(tmp_path: Path) -> None:
    world = kitchenette()
    ids = tuple(body.id for body in world.bodies)
    poses = pose_array(body.pose for body in world.bodies)
    frames = [EpisodeFrame(time_s=0.5 * number, structure=world, ids=ids, poses=poses) for number in range(5)]
    opening = EpisodeEvent(id="Opening_1", kind=EpisodeEventKind.OPEN, begin_s=0.5, end_s=1.5, thing=DRAWER)
    path = tmp_path / "events.html"
    write_html(FrameRecording(frames, events=(opening,)), path, rate_hz=2.0)
    times = [time for time, message in recorded_messages(path)["messages"] if message.get("name") == "/events/Drawer"]
    assert (times[0], times[-1]) == pytest.approx((0.5, 1.5))
