"""roslibjs, the client of web pages: it does on a stage all that pages do, run by Node."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

from mindstage.bridge import LocalNode, RosbridgeServer
from mindstage.bridge.conversions_unreal import spawn_request
from mindstage.knowledge import KnowledgeBase
from mindstage.msgs import encode
from mindstage.ros import RosInterface
from mindstage.simulation import Simulation
from tests.bridge.talking import eventually

PAGE = Path(__file__).with_name("page.mjs")
LONGEST_S = 120.0


def test_a_page_spawns_moves_lights_listens_and_gives_up(
    node: Path,
    roslibjs: Path,
    empty_stage: Simulation,
    hub: LocalNode,
    server: RosbridgeServer,
    knowledge: KnowledgeBase,
    tmp_path: Path,
) -> None:
    map = tmp_path / "map.json"
    map.write_text(json.dumps(encode(spawn_request(knowledge.world()))), encoding="utf-8")
    with RosInterface(empty_stage, hub):
        command = [node, PAGE, roslibjs, server.url, map]
        ended = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST_S, check=False)
        assert ended.returncode == 0, ended.stderr
        told = dict(json.loads(line) for line in ended.stdout.splitlines())
        eventually(lambda: [marker.id for marker in empty_stage.state.markers] == ["page/1"])
    assert "/unreal/spawn_model" in told["services"]
    assert "/tf" in told["topics"]["topics"]
    assert told["spawned"]["success"] is True
    assert told["set"] == {"success": True}
    assert told["got"]["pose"] == {
        "position": {"x": 1, "y": 2, "z": 3},
        "orientation": {"x": 0, "y": 0, "z": 0.6, "w": 0.8},
    }
    assert told["refused"]["success"] is False
    assert "id: expected str, got int" in told["malformed"]["error"]
    assert told["lit"] == {"success": True}
    assert json.loads(told["asked"]["answers"])["answers"][0]["id"] == "Refrigerator"
    bodies = {body.id for body in knowledge.world().bodies}
    for way in ("none", "png", "cbor", "pieces"):
        assert {each["child_frame_id"] for each in told[f"tf {way}"]["transforms"]} == bodies
    assert told["reached"]["result"]["result"]["result"] == 1
    assert "canceled" in told["given up"]["failed"]
    assert "it was canceled" in told["given up"]["failed"]
    assert told["preempted"]["result"]["result"]["error_message"] == "it was canceled"
    assert "fridge" in empty_stage.state.highlights
