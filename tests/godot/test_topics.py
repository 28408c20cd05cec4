"""Topics that Godot publishes: overlap events and poses."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from mindstage.assets.cache import geometry_cache_dir
from mindstage.bridge import LocalNode, RosbridgeServer
from mindstage.engines.remote import RemoteEngine, connect
from mindstage.engines.remote.godot_process import GodotProcess, find_godot, prepare_project
from mindstage.scene import BodyId, BodyPhysics, Mobility, Pose
from mindstage.scene.edits import SetPhysics, SetPoses, Spawn
from tests.engines.scenes import FLOOR, body, world

LONG_S = 60.0
BALL, FLOOR_ID = BodyId("ball"), BodyId("floor")
WITH_OVERLAP_EVENTS = BodyPhysics(mobility=Mobility.STATIC, overlap_events=True)


class Connected(NamedTuple):
    """A hub and the engine of the Godot that is connected to it."""

    hub: LocalNode
    engine: RemoteEngine


@pytest.fixture(scope="module")
def running(godot: Path) -> Iterator[Connected]:
    found = find_godot(godot)
    with LocalNode() as hub, RosbridgeServer(hub, port=0) as server:
        process = GodotProcess(
            found,
            prepare_project(found),
            url=server.url,
            token="",
            namespace="lab/place",
            mesh_dir=geometry_cache_dir(),
        )
        try:
            wait_for(lambda: any("/lab/place/" in each.name for each in hub.graph_info().services))
            with closing(connect(f"ros://127.0.0.1:{server.port}/lab/place", timeout_s=LONG_S)) as engine:
                yield Connected(hub, engine)
        finally:
            process.terminate()


@pytest.fixture
def connected(running: Connected) -> Iterator[Connected]:
    yield running
    running.engine.clear()


def wait_for(is_so: Any) -> None:
    deadline_s = time.monotonic() + LONG_S
    while not is_so():
        assert time.monotonic() < deadline_s, "timed out"
        time.sleep(0.02)


def test_overlap_events_are_published_as_they_begin_and_end(connected: Connected) -> None:
    messages: list[dict[str, Any]] = []
    subscription = connected.hub.subscribe(
        "/lab/place/overlaps", lambda message: messages.append(json.loads(message["data"]))
    )
    ball = body("ball", (0.3, 0.2, 0.4), (0.2, 0.2, 0.2), "dynamic", 1.0)
    assert connected.engine.apply(Spawn(world(FLOOR, ball))).report.ok
    connected.engine.step(0.5)
    connected.engine.apply(SetPhysics(FLOOR_ID, WITH_OVERLAP_EVENTS))  # from now on
    connected.engine.step(0.1)
    connected.engine.apply(SetPoses({BALL: Pose((0.3, 0.2, 3.0))}))
    connected.engine.step(0.1)
    wait_for(lambda: len(messages) == 2)
    assert [(each["body"], each["other"], each["began"]) for each in messages] == [
        ("floor", "ball", True),
        ("floor", "ball", False),
    ]
    assert messages[0]["time_s"] < messages[1]["time_s"]
    connected.engine.apply(SetPhysics(FLOOR_ID, BodyPhysics(mobility=Mobility.STATIC)))
    connected.engine.step(1.5)  # the ball falls on it again
    subscription.close()
    assert len(messages) == 2


def test_poses_are_published_while_time_runs(connected: Connected) -> None:
    messages: list[Any] = []
    subscription = connected.hub.subscribe("/lab/place/tf", messages.append)
    assert connected.engine.apply(
        Spawn(world(FLOOR, body("ball", (1, 2, 0.5), (0.2, 0.2, 0.2), "dynamic", 1.0)))
    ).report.ok
    connected.hub.call_service("/lab/place/mindstage/set_speed", {"speed": 1.0}, timeout_s=LONG_S)
    try:
        wait_for(lambda: messages and heights(messages)[-1] == pytest.approx(0.1, abs=0.002))
    finally:
        connected.hub.call_service("/lab/place/mindstage/set_speed", {"speed": 0.0}, timeout_s=LONG_S)
        subscription.close()
    message = messages[-1]["transforms"][1]
    assert (message["header"]["frame_id"], message["child_frame_id"]) == ("map", "ball")
    assert message["transform"]["translation"]["x"] == pytest.approx(1.0, abs=1e-3)
    assert message["transform"]["translation"]["y"] == pytest.approx(2.0, abs=1e-3)
    stamps = [each["transforms"][1]["header"]["stamp"] for each in messages]
    assert [(each["secs"], each["nsecs"]) for each in stamps] == sorted(
        (each["secs"], each["nsecs"]) for each in stamps
    )


def heights(messages: list[Any]) -> list[float]:
    return [
        each["transform"]["translation"]["z"]
        for message in messages
        for each in message["transforms"]
        if each["child_frame_id"] == "ball"
    ]
