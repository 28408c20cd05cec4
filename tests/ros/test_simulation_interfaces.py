"""simulation_interfaces: entities, spawning, worlds and control, with their result codes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from mindstage.bridge import LocalNode
from mindstage.knowledge import KnowledgeBase, save_map
from mindstage.ros import RosInterface
from mindstage.simulation import Simulation
from tests.bridge.raw_client import TIMEOUT_S
from tests.kitchenette import kitchenette
from tests.ros.ros_messages import TURNED, Call, pose_message, position_of

UNSUPPORTED, OK, NOT_FOUND, INCORRECT_STATE, FAILED = range(5)
STOPPED, PLAYING, PAUSED, QUITTING, NO_WORLD = range(5)
ROBOT = """<robot name="cart">
  <link name="base"><visual><geometry><box size="1 1 0.5"/></geometry></visual></link>
  <link name="arm"><visual><geometry><box size="0.2 0.2 1"/></geometry></visual></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="arm"/>
    <origin xyz="0 0 0.75"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>"""


def point(x: float, y: float, z: float) -> dict[str, float]:
    return {"x": x, "y": y, "z": z}


def code(reply: Any) -> int:
    return int(reply["result"]["result"])


def names(reply: Any) -> set[str]:
    assert code(reply) == OK
    return set(reply["entities"])


# -- entities ----------------------------------------------------------------------------------------------------------


def test_all_entities_are_listed_with_their_states(call: Call, simulation: Simulation) -> None:
    assert names(call("get_entities")) == set(simulation.state.ids)
    reply = call("get_entities_states")
    assert reply["entities"] == list(simulation.state.ids)
    there = dict(zip(reply["entities"], reply["states"], strict=True))
    assert position_of(there["Mug"]["pose"]) == (2.0, 0.0, 0.85)
    assert there["Mug"]["header"]["frame_id"] == "world"


@pytest.mark.parametrize(
    ("filters", "expected"),
    [
        ({"filter": "^Fridge"}, {"Fridge", "FridgeDoor", "FridgeHandle"}),
        ({"filter": "Handle$"}, {"DrawerHandle", "FridgeHandle"}),
        ({"categories": [{"category": 4}]}, {"Drawer", "FridgeDoor", "Mug"}),
        ({"categories": [{"category": 5}, {"category": 1}], "filter": "r"},
         {"Floor", "Cupboard", "Fridge", "DrawerHandle", "FridgeHandle"}),
        ({"tags": {"tags": ["Cup", "Door"]}}, {"Mug", "FridgeDoor"}),
        ({"tags": {"tags": ["Cup", "SemLog/Id=Mug"], "filter_mode": 1}}, {"Mug"}),
        ({"tags": {"tags": ["Cup", "SemLog/Id=x"], "filter_mode": 1}}, set()),
        ({"bounds": {"type": 1, "points": [point(3.0, 0.2, 2.0), point(1.9, -0.2, 0.82)]}}, {"Mug"}),
        ({"bounds": {"type": 3, "points": [point(2.0, 0.0, 1.0), point(0.11, 0.0, 0.0)]}}, {"Mug"}),
    ],
)  # fmt: skip
def test_entities_are_filtered_by_name_category_tags_and_bounds(call: Call, filters: Any, expected: set[str]) -> None:
    assert names(call("get_entities", filters=filters)) == expected
    assert names(call("get_entities_states", filters=filters)) == expected


def test_invalid_filters_are_rejected(call: Call) -> None:
    reply = call("get_entities", filters={"filter": "(a"})
    assert code(reply) == FAILED
    assert "is not an extended regular expression" in reply["result"]["error_message"]
    assert code(call("get_entities", filters={"bounds": {"type": 1, "points": [{"x": 1.0}]}})) == FAILED
    assert code(call("get_entities", filters={"bounds": {"type": 2, "points": []}})) == UNSUPPORTED


def test_the_pose_of_an_entity_is_set_in_any_frame(call: Call) -> None:
    state = {"pose": pose_message(4.0, 1.0, 2.0, TURNED)}
    assert code(call("set_entity_state", entity="Mug", state=state, set_pose=True)) == OK
    reply = call("get_entity_state", entity="Mug")
    assert code(reply) == OK
    assert reply["state"]["pose"] == pose_message(4.0, 1.0, 2.0, TURNED)
    above = {"header": {"frame_id": "Cupboard"}, "pose": pose_message(0.0, 0.0, 1.0)}
    assert code(call("set_entity_state", entity="Mug", state=above, set_pose=True)) == OK
    assert position_of(call("get_entity_state", entity="Mug")["state"]["pose"]) == (2.0, 0.0, 1.4)


def test_unsupported_settings_have_result_codes(call: Call) -> None:
    far = {"pose": pose_message(9.0, 9.0, 9.0)}
    nowhere = {"header": {"frame_id": "nobody"}, "pose": pose_message(0, 0, 0)}
    assert code(call("set_entity_state", entity="Drawer", state=far, set_pose=True)) == 101
    assert code(call("set_entity_state", entity="Mug", state=nowhere, set_pose=True)) == 101
    assert code(call("set_entity_state", entity="nobody", state=far, set_pose=True)) == NOT_FOUND
    assert code(call("set_entity_state", entity="Mug", state=far, set_twist=True)) == UNSUPPORTED
    for service in ("get_entity_state", "get_entity_info", "get_entity_bounds", "delete_entity"):
        reply = call(service, entity="Mugg")
        assert code(reply) == NOT_FOUND
        assert "near: 'Mug'" in reply["result"]["error_message"]


def test_info_and_bounds_of_an_entity_are_returned(call: Call) -> None:
    info = call("get_entity_info", entity="Mug")["info"]
    assert info["category"]["category"] == 4
    assert info["description"] == "Cup"
    assert info["tags"] == ["Cup", "SemLog/Class=Cup", "SemLog/Id=Mug"]
    bounds = call("get_entity_bounds", entity="Mug")["bounds"]
    assert bounds["type"] == 1
    assert [round(point["z"], 9) for point in bounds["points"]] == [0.05, -0.05]
    assert code(call("set_entity_info", entity="Mug", info=info)) == UNSUPPORTED


def test_an_entity_is_deleted(call: Call) -> None:
    assert code(call("delete_entity", entity="Mug")) == OK
    assert "Mug" not in names(call("get_entities"))


# -- spawning ----------------------------------------------------------------------------------------------------------


def test_a_body_of_a_map_is_spawned_with_its_attachments(call: Call, simulation: Simulation) -> None:
    reply = call("get_spawnables")
    assert code(reply) == OK
    uris = {each["entity_resource"]["uri"] for each in reply["spawnables"]}
    door = next(uri for uri in uris if uri.endswith("#fridge_door"))
    initial = {"pose": pose_message(0.0, 9.0, 2.0)}
    before = set(simulation.state.ids)
    made = call("spawn_entity", name="spare", entity_resource={"uri": door}, initial_pose=initial)
    assert (code(made), made["entity_name"]) == (OK, "spare")
    assert set(simulation.state.ids) - before == {"spare", "spare/fridge_door_handle"}, "only the door and its handle"
    assert position_of(call("get_entity_state", entity="spare")["state"]["pose"]) == (0.0, 9.0, 2.0)
    assert ("spare", "spare/fridge_door_handle") in {
        (hold.parent, hold.child) for hold in simulation.snapshot().attachments
    }


def test_an_entity_is_spawned_from_a_text(call: Call, simulation: Simulation) -> None:
    initial = {"header": {"frame_id": "Floor"}, "pose": pose_message(0.0, -3.0, 1.0)}
    made = call("spawn_entity", name="cart", entity_resource={"resource_string": ROBOT}, initial_pose=initial)
    assert code(made) == OK, made
    assert position_of(call("get_entity_state", entity="cart")["state"]["pose"]) == (2.0, -2.5, 0.95)
    assert {"cart", "cart/arm"} <= set(simulation.state.ids)
    assert [joint.child for joint in simulation.snapshot().joints if joint.parent == "cart"] == ["cart/arm"]


@pytest.mark.parametrize(
    ("request_", "expected"),
    [
        ({"name": "Mug", "entity_resource": {"resource_string": ROBOT}}, 101),
        ({"name": "", "entity_resource": {"resource_string": ROBOT}}, 102),
        ({"name": "a"}, 104),
        ({"name": "a", "entity_resource": {"uri": "nothing"}}, 104),
        ({"name": "a", "entity_resource": {"uri": "../../etc/passwd"}}, 104),
        ({"name": "a", "entity_resource": {"resource_string": "<robot"}}, 106),
        ({"name": "a", "entity_resource": {"resource_string": "no map at all"}}, 106),
        ({"name": "a", "entity_resource": {"resource_string": ROBOT.replace("<robot", "<robot xmlns:xacro='x'")}}, 103),
        ({"name": "a", "entity_resource": {"resource_string": ROBOT},
          "initial_pose": {"header": {"frame_id": "nobody"}}}, 109),
        ({"name": "a", "entity_resource": {"resource_string": ROBOT},
          "initial_pose": {"pose": pose_message(0, 0, 0, {"x": 0.0, "y": 0.0, "z": 0.0, "w": 0.0})}}, 109),
    ],
)  # fmt: skip
def test_spawn_failures_have_result_codes(call: Call, simulation: Simulation, request_: Any, expected: int) -> None:
    before = simulation.state.ids
    reply = call("spawn_entity", **request_)
    assert code(reply) == expected, reply
    assert reply["result"]["error_message"]
    assert simulation.state.ids == before


def test_each_of_several_spawned_entities_has_a_result(call: Call) -> None:
    robot = {"resource_string": ROBOT}
    wanted = [
        {"name": "one", "entity_resource": robot, "initial_pose": {"pose": pose_message(0, 9, 1)}},
        {"name": "one", "entity_resource": robot, "initial_pose": {"pose": pose_message(0, 12, 1)}},
        {
            "name": "one",
            "allow_renaming": True,
            "entity_resource": robot,
            "initial_pose": {"pose": pose_message(0, 15, 1)},
        },
    ]
    reply = call("spawn_entities", spawn_requests=wanted)
    assert code(reply) == 150
    assert [each["result"]["result"] for each in reply["results"]] == [OK, 101, OK]
    assert reply["results"][2]["entity_name"] == "one_1"
    assert code(call("spawn_entities", spawn_requests=[])) == OK


def test_a_robot_is_spawned_by_spawn_robot(call: Call, simulation: Simulation) -> None:
    assert call("spawn_robot", name=ROBOT, id="cart") == {"id": "cart", "name": "cart", "success": True}
    assert "cart/arm" in simulation.state.ids
    assert call("spawn_robot", name="pr2", id="pr2") == {"id": "pr2", "name": "", "success": False}


# -- worlds ------------------------------------------------------------------------------------------------------------


@pytest.fixture
def worlds(simulation: Simulation, tmp_path: Path) -> Iterator[Call]:
    """Calls a service of a simulation with an open folder."""
    (tmp_path / "worlds").mkdir()
    (tmp_path / "worlds" / "cart.urdf").write_text(ROBOT, encoding="utf-8")
    (tmp_path / "worlds" / "broken.owl").write_text("<rdf:RDF", encoding="utf-8")
    (tmp_path / "worlds" / "notes.txt").write_text("hello", encoding="utf-8")
    (tmp_path / "secret.urdf").write_text(ROBOT, encoding="utf-8")
    (tmp_path / "worlds" / "link.urdf").symlink_to(tmp_path / "secret.urdf")
    with LocalNode() as local_node, RosInterface(simulation, local_node, folder=tmp_path / "worlds"):
        yield lambda name, /, **args: local_node.call_service(f"/unreal/{name}", args, timeout_s=TIMEOUT_S)


def test_loading_a_world_replaces_the_current_one(
    worlds: Call, simulation: Simulation, knowledge: KnowledgeBase
) -> None:
    assert worlds("get_current_world")["world"]["name"] == "map"
    there = {each["name"]: each["world_resource"]["uri"] for each in worlds("get_available_worlds")["worlds"]}
    assert {"kitchen", "cart.urdf", "broken.owl"} <= set(there)
    reply = worlds("load_world", world_resource={"uri": there["kitchen"]})
    assert code(reply) == OK
    assert reply["world"]["name"] == "kitchen"
    assert len(simulation.state.ids) == len(knowledge.world().bodies)
    assert code(worlds("load_world", world_resource={"uri": "cart.urdf"})) == OK
    assert set(simulation.state.ids) == {"base", "arm"}
    assert code(worlds("unload_world")) == OK
    assert simulation.state.ids == ()
    assert code(worlds("unload_world")) == 101
    assert code(worlds("get_current_world")) == FAILED
    assert worlds("get_simulation_state")["state"]["state"] == NO_WORLD
    assert code(worlds("set_simulation_state", state={"state": PLAYING})) == INCORRECT_STATE


@pytest.mark.parametrize(
    ("resource", "expected"),
    [
        ({"uri": "broken.owl"}, 103),
        ({"uri": "notes.txt"}, 101),
        ({"uri": "../secret.urdf"}, 102),
        ({"uri": "link.urdf"}, 102),
        ({"uri": "file:///etc/passwd"}, 102),
        ({"uri": "nothing.owl"}, 102),
        ({}, 102),
        ({"resource_string": "<rdf:RDF"}, 103),
    ],
)
def test_a_failed_load_keeps_the_current_world(
    worlds: Call, simulation: Simulation, resource: Any, expected: int
) -> None:
    before = simulation.state.ids
    reply = worlds("load_world", world_resource=resource)
    assert code(reply) == expected, reply
    assert reply["result"]["error_message"]
    assert simulation.state.ids == before


def test_a_text_cannot_import_local_files(worlds: Call, simulation: Simulation, tmp_path: Path) -> None:
    map = tmp_path / "worlds" / "map.ttl"
    save_map(kitchenette(), map)
    text = f"<http://x.org/m> <http://www.w3.org/2002/07/owl#imports> <{map.as_uri()}> ."
    (tmp_path / "worlds" / "importing.ttl").write_text(text, encoding="utf-8")
    assert code(worlds("load_world", world_resource={"uri": "importing.ttl"})) == OK
    before = simulation.state.ids
    assert code(worlds("load_world", world_resource={"resource_string": text})) == 103
    assert simulation.state.ids == before


def test_available_worlds_are_filtered_by_tags(worlds: Call) -> None:
    found = worlds("get_available_worlds", filter={"tags": ["urdf"]})["worlds"]
    assert [each["name"] for each in found] == ["cart.urdf"]
    assert code(worlds("get_available_worlds", additional_sources=["/elsewhere"])) == FAILED
    assert code(worlds("get_available_worlds", additional_sources=["/elsewhere"], continue_on_error=True)) == OK


# -- time --------------------------------------------------------------------------------------------------------------


def test_the_simulation_plays_pauses_and_stops(call: Call, simulation: Simulation) -> None:
    def state() -> int:
        return int(call("get_simulation_state")["state"]["state"])

    assert state() == PAUSED
    assert code(call("set_simulation_state", state={"state": PLAYING})) == OK
    assert state() == PLAYING
    assert simulation.state.playing
    assert code(call("set_simulation_state", state={"state": PLAYING})) == 101
    assert code(call("step_simulation", steps=1)) == INCORRECT_STATE
    assert code(call("set_simulation_state", state={"state": PAUSED})) == OK
    assert state() == PAUSED
    call("set_model_pose", id="Mug", pose=pose_message(4, 4, 4))
    assert code(call("set_simulation_state", state={"state": STOPPED})) == OK
    assert state() == STOPPED
    assert position_of(call("get_model_pose", id="Mug")["pose"]) == (2.0, 0.0, 0.85)
    assert code(call("set_simulation_state", state={"state": NO_WORLD})) == 103
    assert code(call("set_simulation_state", state={"state": QUITTING})) == UNSUPPORTED


def test_a_step_is_a_time_step_of_the_engine(call: Call, simulation: Simulation) -> None:
    before = simulation.state.time_s
    assert code(call("step_simulation", steps=100)) == OK
    assert simulation.state.time_s - before == pytest.approx(0.2)
    assert code(call("step_simulation")) == OK
    assert simulation.state.time_s - before == pytest.approx(0.202)


def test_reset_returns_to_the_state_after_the_last_spawn(call: Call, simulation: Simulation) -> None:
    call("step_simulation", steps=100)
    call("delete_model", id="Mug")
    assert code(call("reset_simulation")) == OK
    assert "Mug" in simulation.state.ids
    assert code(call("reset_simulation", scope=1)) == UNSUPPORTED
    call("spawn_model", name="Cup", id="later", pose=pose_message(0, 9, 1))
    assert code(call("reset_simulation", scope=4)) == OK
    assert "later" not in simulation.state.ids
    assert "Mug" in simulation.state.ids


def test_only_supported_features_are_listed(call: Call) -> None:
    features = set(call("get_simulator_features")["features"]["features"])
    assert {0, 1, 5, 10, 11, 20, 25, 32, 33, 40, 43, 45, 50} <= features
    assert not features & {2, 3, 7, 13, 21}


def test_clients_can_quit_only_if_allowed(simulation: Simulation) -> None:
    ended: list[bool] = []
    with LocalNode() as local_node, RosInterface(simulation, local_node, on_quit=lambda: ended.append(True)):
        assert code(local_node.call_service("/unreal/set_simulation_state", {"state": {"state": QUITTING}})) == OK
    assert ended == [True]
