"""Files in the manner of the thesis's own load, spawn the thesis's map, and answer."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

QUERIES = Path(__file__).with_name("thesis_queries.pl")

_SCRIPT = """
import json, sys
from mindstage.engines import NullEngine
from mindstage.knowledge import KnowledgeBase

from mindstage.prolog import PrologConsole
from mindstage.simulation import Simulation

data, queries = sys.argv[1:]
knowledge = KnowledgeBase(bundled_ontology=False)
knowledge.load([data + "/maps/iai-kitchen-original.owl"], ontologies=data + "/ontology")
out = {}
with Simulation(knowledge, NullEngine()) as simulation, PrologConsole(simulation) as console:
    def local(goal):
        return [row["X"].rpartition("#")[2] for row in console.solutions(goal)]
    def highlights(goal):
        assert console.holds("unhighlight")
        return (console.holds(goal), sorted(simulation.state.highlights))
    out["errors"] = console.consult(queries)
    (row,) = console.solutions("spawn_semantic_map(_M, _O, _C, _R), maplist(length, [_O, _C, _R], Numbers)")
    out["numbers"] = row["Numbers"]
    world = simulation.snapshot()
    out["spawned"] = [len(world.bodies), len(world.joints), len(world.attachments)]
    given = knowledge.world()
    out["differing"] = [
        body.id for body in world.bodies
        if max(abs(a - b) for a, b in zip(body.pose.position, given.body(body.id).pose.position)) > 1e-9
    ]
    joints = {joint.id: joint for joint in given.joints}
    out["joints"] = [
        joint.id for joint in world.joints
        if (joint.linear.limit, joint.angular.swing1, joint.angular.swing1_limit, joint.parent)
        != tuple([(each := joints[joint.id]).linear.limit, each.angular.swing1, each.angular.swing1_limit, each.parent])
    ]
    (row,) = console.solutions("map_instance(_M), analyse_semantic_map(_M, C, I, O, J, R)")
    out["analysis"] = row
    out["handles"] = highlights("map_instance(M), highlight_everything_that_is(M, knowrob:'Handle')")
    out["devices"] = local("map_instance(_), highlight_device_for_action(_, knowrob:'BakingFood', X)")
    out["device_highlights"] = highlights("map_instance(M), highlight_device_for_action(M, knowrob:'BakingFood')")
    out["handle"] = highlights("rdfs_individual_of(X, knowrob:'IAIFridgeDoor'), highlight_handle_of(_, X, _)")
    out["storage"] = local("likely_storage_place_in_environment(_, knowrob:'CowsMilk', _X), rdf(_X, rdf:type, X)")
print(json.dumps(out))
"""


@pytest.fixture(scope="module")
def results(prolog: Path, shared_data: Path) -> dict[str, Any]:
    """What the files answer in a process of their own, whose predicates they redefine."""
    command = [sys.executable, "-c", _SCRIPT, str(shared_data), str(QUERIES)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr[-3000:]
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    found["stderr"] = done.stderr
    return found


def test_the_files_load_without_errors(results: dict[str, Any]) -> None:
    assert results["errors"] == 0


def test_everything_of_the_map_is_spawned_by_the_files(results: dict[str, Any]) -> None:
    assert results["numbers"] == [114, 22, 55]
    assert results["spawned"] == [114, 22, 33]
    assert results["differing"] == []
    assert results["joints"] == []
    # Joints have poses, too, and are no models: the reason is a warning.
    assert results["stderr"].count("is a joint; spawn_constraint/1 spawns joints") == 22


def test_the_analysis_is_that_of_the_thesis(results: dict[str, Any]) -> None:
    assert results["analysis"] == {"C": 64, "I": 136, "O": 114, "J": 22, "R": 55}


def test_the_highlighting_queries_answer(results: dict[str, Any]) -> None:
    assert results["handles"][0]
    assert len(results["handles"][1]) == 18
    assert results["devices"] == ["HeatSource"]
    assert results["device_highlights"][0]
    assert len(results["device_highlights"][1]) == 2
    assert results["handle"][0]
    assert len(results["handle"][1]) == 1
    assert "IAIFridgeCasing" in results["storage"]
