"""roslibjs, the client of web pages, run by Node.js."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

from mindstage.bridge import LocalNode, RosbridgeServer
from mindstage.bridge.conversions_unreal import spawn_request
from mindstage.knowledge import KnowledgeBase
from mindstage.msgs import encode
from mindstage.ros import RosInterface
from mindstage.ros.state import StateReader
from mindstage.simulation import Simulation
from tests.bridge.raw_client import eventually

SCRIPT = Path(__file__).with_name("roslibjs_client.mjs")
LONGEST_S = 120.0


def test_roslibjs_uses_services_topics_and_actions(
    node: Path,
    roslibjs: Path,
    empty_simulation: Simulation,
    local_node: LocalNode,
    server: RosbridgeServer,
    knowledge: KnowledgeBase,
    tmp_path: Path,
) -> None:
    map = tmp_path / "map.json"
    map.write_text(json.dumps(encode(spawn_request(knowledge.world()))), encoding="utf-8")
    with RosInterface(empty_simulation, local_node):
        command = [node, SCRIPT, roslibjs, server.url, map]
        process = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST_S, check=False)
        assert process.returncode == 0, process.stderr
        results = dict(json.loads(line) for line in process.stdout.splitlines())
        eventually(lambda: [marker.id for marker in empty_simulation.state.markers] == ["page/1"])
    assert "/unreal/spawn_model" in results["services"]
    assert "/tf" in results["topics"]["topics"]
    assert results["spawned"]["success"] is True
    assert results["set pose"] == {"success": True}
    assert results["pose"]["pose"] == {
        "position": {"x": 1, "y": 2, "z": 3},
        "orientation": {"x": 0, "y": 0, "z": 0.6, "w": 0.8},
    }
    assert results["rejected"]["success"] is False
    assert "id: expected str, got int" in results["malformed"]["error"]
    assert results["highlighted"] == {"success": True}
    assert json.loads(results["answers"]["answers"])["answers"][0]["id"] == "Refrigerator"
    state, reader = empty_simulation.state, StateReader(empty_simulation)
    moving, _ = reader.frame_tree().transforms(state.ids, state.poses)
    assert len(moving.children) > 50
    for encoding in ("none", "png", "cbor", "fragments"):
        assert {each["child_frame_id"] for each in results[f"tf {encoding}"]["transforms"]} == set(moving.children)
    assert results["succeeded"]["result"]["result"]["result"] == 1
    assert "canceled" in results["canceled"]["failed"]
    assert "it was canceled" in results["canceled"]["failed"]
    assert results["preempted"]["result"]["result"]["error_message"] == "it was canceled"
    assert "fridge" in empty_simulation.state.highlights
