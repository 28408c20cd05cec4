"""The verb `replay`."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from mindstage import KnowledgeBase, MujocoEngine, Simulation
from mindstage.bridge import RosbridgeClient
from mindstage.episodes import Recorder
from mindstage.episodes.episode import Episode
from mindstage.episodes.neem import write_neem
from mindstage.maps import write_map
from mindstage.scene import BodyId
from tests.bridge.raw_client import TIMEOUT_S, eventually
from tests.cli.runner import Run, json_output
from tests.episodes.bag_files import Transform, matrix, write_bag
from tests.kitchenette import kitchenette


@pytest.fixture(scope="module")
def episode(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two seconds of the small kitchen, in which the drawer is pulled open."""
    path = tmp_path_factory.mktemp("episodes") / "run.mcap"
    with Simulation(KnowledgeBase(), MujocoEngine()) as simulation:
        simulation.spawn(kitchenette())
        simulation.pull("Drawer", point=(-0.25, 0.0, 0.0), target=(1.2, 0.0, 0.65))  # type: ignore[arg-type]
        with Recorder(simulation, path):
            simulation.step(2.0)
    return path


@contextmanager
def replaying(*args: object) -> Iterator[dict[str, Any]]:
    """Runs `mindstage replay`; yields its JSON output."""
    command = [sys.executable, "-m", "mindstage", "replay", "--json", *map(str, args)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        lines: list[str] = []
        assert process.stdout is not None
        while not lines or lines[-1] != "}\n":
            lines.append(process.stdout.readline())
            assert lines[-1], process.communicate(timeout=TIMEOUT_S)[1]
        yield json.loads("".join(lines))
    finally:
        process.kill()
        process.communicate(timeout=TIMEOUT_S)


def drawer_x(path: Path) -> float:
    knowledge = KnowledgeBase()
    knowledge.load(path)
    return knowledge.world().body("Drawer").pose.position[0]  # type: ignore[arg-type]


def test_the_map_of_a_moment_is_written(run: Run, episode: Path, tmp_path: Path) -> None:
    for time_s in (0, 2):
        result = run("replay", episode, "--at", time_s, "-o", tmp_path / f"{time_s}.owl")
        assert result.exit_code == 0, result.stderr
        assert f"run at {time_s} s: 8 bodies" in result.stdout
    assert drawer_x(tmp_path / "0.owl") == pytest.approx(1.95, abs=0.01)
    assert drawer_x(tmp_path / "2.owl") < 1.6
    summary = json_output(run("replay", episode, "--at", 2, "-o", tmp_path / "3.ttl", "--json"))
    assert (summary["at_s"], summary["bodies"], summary["out"]) == (2.0, 8, str(tmp_path / "3.ttl"))


def test_wrong_times_files_and_options_are_errors_with_their_reason(run: Run, episode: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.mcap"
    other.write_text("not an episode")
    for arguments, message in (
        ([episode, "--at", 9, "-o", tmp_path / "x.owl"], "it lasts from 0 to 2 s"),
        ([tmp_path / "missing.mcap", "-o", tmp_path / "x.owl"], "missing.mcap"),
        ([other, "-o", tmp_path / "x.owl"], "other.mcap"),
        ([episode, "--no-viewer"], "nothing would be shown"),
        ([episode, episode, "-o", tmp_path / "x.owl"], "give one episode"),
        ([episode, episode, episode], "give one or two"),
        ([episode, "-o", tmp_path / "x.xyz"], "xyz"),
    ):
        result = run("replay", *arguments)
        assert result.exit_code == 2, arguments
        assert message in " ".join(result.stderr.split()), result.stderr
    assert not list(tmp_path.glob("x.*"))


def test_it_is_published_to_ros_at_the_speed_of_the_replay(episode: Path) -> None:
    with replaying(episode, "--no-viewer", "--ros", "--ros-port", 0, "--loop", "--speed", 0.5) as output:
        clocks: list[Any] = []
        transforms: list[Any] = []
        joints: list[Any] = []
        with RosbridgeClient(output["url"]) as client:
            client.wait_connected(TIMEOUT_S)
            client.subscribe("/clock", clocks.append)
            client.subscribe("/tf", transforms.append)
            client.subscribe("/unreal/joint_states", joints.append)
            eventually(lambda: len(clocks) >= 10 and len(transforms) >= 10 and joints)
        times = [each["clock"]["sec"] + each["clock"]["nanosec"] / 1e9 for each in clocks]
        assert all(0.0 <= time_s <= 2.0 for time_s in times)
        assert len(set(times)) > 5
        frames = {each["child_frame_id"] for message in transforms for each in message["transforms"]}
        assert "DrawerSlide" in frames
        assert "DrawerSlide" in joints[-1]["name"]


def test_without_a_page_it_exits_at_the_end(run: Run, episode: Path) -> None:
    result = run("replay", episode, "--no-viewer", "--ros", "--ros-port", 0, "--speed", 20)
    assert result.exit_code == 0, result.stderr
    assert "ROS clients connect to ws://127.0.0.1:" in result.stdout


def test_the_page_is_served_and_begins_at_a_time(episode: Path) -> None:
    from urllib.request import urlopen

    with replaying(episode, episode, "--port", 0, "--paused", "--at", 1.5) as output:
        assert (output["at_s"], output["end_s"]) == (1.5, 2.0)
        with urlopen(str(output["viewer"]), timeout=TIMEOUT_S) as page:
            assert b"timeline" in page.read()


def test_a_bag_of_ros_is_replayed_with_its_map(run: Run, tmp_path: Path) -> None:
    world = kitchenette()
    owl = tmp_path / "map.owl"
    owl.write_text(write_map(world), encoding="utf-8")
    mug = [Transform(second, "map", "Mug", matrix([1.0 + second, 2.0, 3.0])) for second in (0.0, 1.0, 2.0)]
    bag = write_bag(tmp_path, "ros1", mug)
    out = tmp_path / "at1.owl"
    result = run("replay", bag, "-o", out)
    assert result.exit_code == 2
    assert "give the map with --map MAP" in " ".join(result.stderr.split())
    result = run("replay", bag, "--map", owl, "--at", 1, "-o", out)
    assert result.exit_code == 0, result.stderr
    knowledge = KnowledgeBase()
    knowledge.load(out)
    moved = knowledge.world()
    assert moved.body(BodyId("Mug")).pose.position == pytest.approx((2.0, 2.0, 3.0))
    assert moved.body(BodyId("Floor")).pose == world.body(BodyId("Floor")).pose


def test_a_neem_is_replayed(run: Run, episode: Path, tmp_path: Path) -> None:
    with Episode(episode) as recording:
        write_neem(recording, tmp_path / "neem")
    result = run("replay", tmp_path / "neem", "--at", 2, "-o", tmp_path / "at2.owl")
    assert result.exit_code == 0, result.stderr
    assert drawer_x(tmp_path / "at2.owl") < 1.6
