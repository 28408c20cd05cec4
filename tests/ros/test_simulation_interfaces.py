"""simulation_interfaces: entities, spawning, worlds and control, with their result codes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from mindstage.bridge import LocalNode
from mindstage.errors import SourceParseError
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import save_map
from mindstage.ros import RosInterface
from mindstage.simulation import Simulation
from tests.bridge.raw_client import TIMEOUT_S
from tests.kitchenette import kitchenette
from tests.maps.hostile_urdf import HOSTILE, hostile_urdf
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
        ({"categories": [{"category": 5}, {"category": 0}], "filter": "r"},
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
        ({"name": "", "entity_resource": {"uri": "http://mindstage.org/maps/kitchen.owl#fridge"}}, 102),
        ({"name": "a b", "entity_resource": {"resource_string": ROBOT}}, 102),
        ({"name": "a//b", "entity_resource": {"resource_string": ROBOT}}, 102),
        ({"name": "a"}, 104),
        ({"name": "a", "entity_resource": {"uri": "nothing"}}, NOT_FOUND),
        ({"name": "a", "entity_resource": {"uri": "../../etc/passwd"}}, NOT_FOUND),
        ({"name": "a", "entity_namespace": "9", "entity_resource": {"resource_string": ROBOT}}, 105),
        ({"name": "a", "entity_namespace": "a//b", "entity_resource": {"resource_string": ROBOT}}, 105),
        ({"name": "a", "entity_resource": {"resource_string": ROBOT.replace(
            '<box size="1 1 0.5"/>', '<mesh filename="package://nowhere/base.stl"/>')}}, 107),
        ({"name": "a", "entity_resource": {"resource_string": "<robot"}}, 106),
        ({"name": "a", "entity_resource": {"resource_string": "no map at all"}}, 106),
        ({"name": "a", "entity_resource": {"resource_string": ROBOT.replace("cart", "cart${1}")}}, 103),
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


@pytest.mark.parametrize("kind", HOSTILE)
def test_nothing_runs_in_a_description_of_a_client(
    call: Call, simulation: Simulation, tmp_path: Path, kind: str
) -> None:
    before = simulation.state.ids
    text = hostile_urdf(kind, tmp_path / "marker")
    resource = {"resource_string": text}
    spawned = call("spawn_entity", name="a", entity_resource=resource)
    assert code(spawned) == 103
    assert not call("spawn_robot", name=text, id="a")["success"]
    for reply in (spawned, call("load_world", world_resource=resource)):
        assert code(reply) != OK
        assert "is written in xacro" in reply["result"]["error_message"]
        assert "mindstage-" not in reply["result"]["error_message"], "the path of a folder on the server"
    assert not (tmp_path / "marker").exists()
    assert simulation.state.ids == before


def test_an_entity_without_a_name_has_that_of_its_urdf(call: Call, simulation: Simulation) -> None:
    resource = {"resource_string": ROBOT}
    made = call("spawn_entity", entity_resource=resource, initial_pose={"pose": pose_message(0, 9, 1)})
    assert (code(made), made["entity_name"]) == (OK, "cart")
    assert code(call("spawn_entity", entity_resource=resource)) == 101
    pose = {"pose": pose_message(0, 12, 1)}
    made = call("spawn_entity", entity_resource=resource, allow_renaming=True, initial_pose=pose)
    assert made["entity_name"] == "cart_1"


def test_an_entity_and_its_parts_are_in_its_namespace(call: Call, simulation: Simulation) -> None:
    wanted = {"name": "cart", "entity_namespace": "/lab/left", "entity_resource": {"resource_string": ROBOT}}
    made = call("spawn_entity", **wanted, initial_pose={"pose": pose_message(0, 9, 1)})
    assert (code(made), made["entity_name"]) == (OK, "lab/left/cart")
    assert {"lab/left/cart", "lab/left/cart/arm"} <= set(simulation.state.ids)
    assert {joint.id for joint in simulation.snapshot().joints} >= {"lab/left/cart/shoulder"}
    assert code(call("spawn_entity", **wanted)) == 101
    other = wanted | {"entity_namespace": "lab/right"}
    made = call("spawn_entity", **other, initial_pose={"pose": pose_message(0, 12, 1)})
    assert made["entity_name"] == "lab/right/cart"
    # The pose of a third one is in the frame of the second.
    frame = {"header": {"frame_id": "lab/right/cart"}, "pose": pose_message(0, 3, 0)}
    assert code(call("spawn_entity", **(wanted | {"name": "next"}), initial_pose=frame)) == OK
    assert position_of(call("get_entity_state", entity="lab/left/next")["state"]["pose"]) == (0.0, 15.0, 1.0)


def test_an_entity_is_deleted_with_its_parts_but_not_with_those_of_others(call: Call, simulation: Simulation) -> None:
    for number, name in enumerate(("cart", "cart/arm/next", "carts")):
        resource = {"resource_string": ROBOT}
        pose = {"pose": pose_message(0, 9 + 3 * number, 1)}
        assert code(call("spawn_entity", name=name, entity_resource=resource, initial_pose=pose)) == OK
    assert code(call("delete_entity", entity="cart")) == OK
    assert {id for id in simulation.state.ids if id.startswith("cart")} == {
        "cart/arm/next", "cart/arm/next/arm", "carts", "carts/arm",
    }  # fmt: skip
    assert code(call("delete_entity", entity="carts/arm")) == OK
    assert "carts" in simulation.state.ids
    assert code(call("delete_entity", entity="cart")) == NOT_FOUND


def test_sources_of_spawnables_are_additional_and_unknown_ones_are_named(call: Call) -> None:
    all_of_them = call("get_spawnables")["spawnables"]
    reply = call("get_spawnables", sources=["kitchen", "http://nowhere.org/"])
    assert code(reply) == OK
    assert reply["spawnables"] == all_of_them
    assert reply["result"]["error_message"] == "unknown sources: http://nowhere.org/"


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
    assert call("spawn_robot", name=ROBOT)["name"].startswith("Robot")
    assert call("spawn_robot", name="robots/pr2.urdf.xacro")["id"].startswith("pr2")


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
    assert code(worlds("get_current_world")) == 101
    assert worlds("get_simulation_state")["state"]["state"] == NO_WORLD
    assert code(worlds("set_simulation_state", state={"state": PLAYING})) == 103
    assert code(worlds("step_simulation", steps=1)) == FAILED


@pytest.mark.parametrize(
    ("resource", "expected"),
    [
        ({"uri": "broken.owl"}, 103),
        ({"uri": "notes.txt"}, 101),
        ({"uri": "../secret.urdf"}, NOT_FOUND),
        ({"uri": "link.urdf"}, NOT_FOUND),
        ({"uri": "file:///etc/passwd"}, NOT_FOUND),
        ({"uri": "nothing.owl"}, NOT_FOUND),
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


CENTIMETERS = """
@prefix : <http://example.org/room.owl#> . @prefix k: <http://knowrob.org/kb/knowrob.owl#> .
:room a k:SemanticEnvironmentMap .
:table a k:Table ; k:describedInMap :room ; k:mobility "static" ;
    k:pose [ a k:Pose ; k:translation "100.0 200.0 40.0" ; k:quaternion "0.0 0.0 0.70710678 0.70710678" ] .
"""


def test_the_uri_of_a_world_gives_the_conventions_of_its_numbers(worlds: Call, simulation: Simulation) -> None:
    resource = {"uri": "?units=cm&frame=ros&quaternion=xyzw", "resource_string": CENTIMETERS}
    assert code(worlds("load_world", world_resource=resource)) == OK
    (table,) = simulation.snapshot().bodies
    assert table.pose.position == pytest.approx((1.0, 2.0, 0.4))
    assert table.pose.quaternion == pytest.approx((0.70710678, 0.0, 0.0, 0.70710678))
    reply = worlds("load_world", world_resource={"uri": "?units=ell", "resource_string": CENTIMETERS})
    assert code(reply) == 103
    assert "units, frame, quaternion" in reply["result"]["error_message"]


def test_a_loaded_world_is_stopped_and_the_start_of_a_reset(worlds: Call, simulation: Simulation) -> None:
    assert code(worlds("set_simulation_state", state={"state": PLAYING})) == OK
    assert code(worlds("load_world", world_resource={"uri": "cart.urdf"})) == OK
    assert worlds("get_simulation_state")["state"]["state"] == STOPPED
    resource = {"resource_string": ROBOT}
    assert code(worlds("spawn_entity", name="later", entity_resource=resource)) == OK
    assert code(worlds("reset_simulation")) == OK
    assert set(simulation.state.ids) == {"base", "arm"}
    assert code(worlds("set_simulation_state", state={"state": PLAYING})) == OK
    assert code(worlds("unload_world")) == OK
    assert not simulation.state.playing


def test_missing_assets_of_a_world_are_an_error_unless_they_are_ignored(worlds: Call, simulation: Simulation) -> None:
    text = ROBOT.replace('<box size="1 1 0.5"/>', '<mesh filename="package://nowhere/base.stl"/>')
    before = simulation.snapshot()
    reply = worlds("load_world", world_resource={"resource_string": text})
    assert code(reply) == 104
    assert "package://nowhere/base.stl" in reply["result"]["error_message"]
    assert simulation.snapshot() == before, "the former world is restored"
    assert worlds("get_current_world")["world"]["name"] == "map"
    ignoring = {"world_resource": {"resource_string": text}, "ignore_missing_or_unsupported_assets": True}
    assert code(worlds("load_world", **ignoring)) == OK
    assert "base" in simulation.state.ids


def test_a_map_that_cannot_be_read_fails_the_list_of_worlds_unless_errors_are_accepted(
    worlds: Call, simulation: Simulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(map: str | None = None) -> Any:
        raise SourceParseError("kitchen.owl", cause="broken")

    monkeypatch.setattr(simulation.knowledge, "world", fail)
    assert code(worlds("get_available_worlds")) == 101
    reply = worlds("get_available_worlds", continue_on_error=True)
    assert code(reply) == OK
    assert "broken" in reply["result"]["error_message"]
    assert "cart.urdf" in {each["name"] for each in reply["worlds"]}


def test_nothing_runs_in_a_file_that_a_client_names(worlds: Call, simulation: Simulation, tmp_path: Path) -> None:
    before, marker = simulation.state.ids, tmp_path / "marker"
    text = hostile_urdf("an expression", marker)
    for name in ("hostile.urdf", "hostile.xacro", "hostile.urdf.xacro"):
        (tmp_path / "worlds" / name).write_text(text, encoding="utf-8")
        resource = {"uri": name}
        replies = [
            worlds("spawn_entity", name="a", entity_resource=resource)["result"],
            worlds("load_world", world_resource=resource)["result"],
            worlds("mindstage/add_robot", source=name) if name.endswith("f") else {"refusal": {"text": ""}},
        ]
        for reply in replies:
            text_of_reply = str(reply.get("error_message") or reply["refusal"]["text"])
            assert reply.get("result") != OK
            assert not reply.get("success")
            assert str(tmp_path) not in text_of_reply
            assert "is written in xacro" in text_of_reply or name != "hostile.urdf"
    assert not marker.exists()
    assert simulation.state.ids == before


def test_a_text_cannot_import_local_files(worlds: Call, simulation: Simulation, tmp_path: Path) -> None:
    map = tmp_path / "worlds" / "map.ttl"
    save_map(kitchenette(), map)
    text = f"<http://x.org/m> <http://www.w3.org/2002/07/owl#imports> <{map.as_uri()}> ."
    (tmp_path / "worlds" / "importing.ttl").write_text(text, encoding="utf-8")
    assert code(worlds("load_world", world_resource={"uri": "importing.ttl"})) == OK
    before = simulation.state.ids
    reply = worlds("load_world", world_resource={"resource_string": text})
    assert code(reply) == 103
    assert f"imports {map.as_uri()}" in reply["result"]["error_message"]
    assert simulation.state.ids == before
    reply = worlds("spawn_entity", name="a", entity_resource={"resource_string": text})
    assert code(reply) == 106
    assert f"imports {map.as_uri()}" in reply["result"]["error_message"]
    assert simulation.state.ids == before


def test_a_text_may_import_an_ontology_that_the_server_has_loaded(
    worlds: Call, simulation: Simulation, tmp_path: Path
) -> None:
    ontology = tmp_path / "onto.ttl"
    ontology.write_text("<http://x.org/onto> a <http://www.w3.org/2002/07/owl#Ontology> .", encoding="utf-8")
    map = tmp_path / "map.ttl"
    save_map(kitchenette(), map)
    text = map.read_text(encoding="utf-8") + "\n<> <http://www.w3.org/2002/07/owl#imports> <http://x.org/onto> ."
    assert code(worlds("load_world", world_resource={"resource_string": text})) == 103
    simulation.knowledge.load((), ontologies=ontology)
    assert code(worlds("load_world", world_resource={"resource_string": text})) == OK
    assert "Mug" in simulation.state.ids


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
    assert code(call("step_simulation", steps=1)) == FAILED
    assert code(call("set_simulation_state", state={"state": PAUSED})) == OK
    assert state() == PAUSED
    call("set_model_pose", id="Mug", pose=pose_message(4, 4, 4))
    assert code(call("set_simulation_state", state={"state": STOPPED})) == OK
    assert state() == STOPPED
    assert position_of(call("get_model_pose", id="Mug")["pose"]) == (2.0, 0.0, 0.85)
    assert code(call("set_simulation_state", state={"state": STOPPED})) == 101
    assert code(call("set_simulation_state", state={"state": PAUSED})) == OK
    assert state() == PAUSED
    assert code(call("set_simulation_state", state={"state": NO_WORLD})) == 103
    assert code(call("set_simulation_state", state={"state": QUITTING})) == UNSUPPORTED


def test_a_step_is_a_time_step_of_the_engine(call: Call, simulation: Simulation) -> None:
    before = simulation.state.time_s
    assert code(call("step_simulation", steps=100)) == OK
    assert simulation.state.time_s - before == pytest.approx(0.2)
    assert code(call("step_simulation")) == OK
    assert simulation.state.time_s - before == pytest.approx(0.202)


def spawn_later(call: Call, simulation: Simulation) -> None:
    """Advances the time, moves the mug, and spawns an entity and a model, at which the mug then is."""
    assert code(call("step_simulation", steps=100)) == OK
    call("set_model_pose", id="Mug", pose=pose_message(4, 4, 4))
    resource = {"resource_string": ROBOT}
    pose = {"pose": pose_message(0, 9, 1)}
    assert code(call("spawn_entity", name="cart", entity_resource=resource, initial_pose=pose)) == OK
    assert call("spawn_model", name="Cup", id="later", pose=pose_message(0, 12, 1))["success"]
    call("delete_model", id="DrawerHandle")


def test_stopping_removes_what_was_spawned_and_restores_the_rest(call: Call, simulation: Simulation) -> None:
    before, first = simulation.state.ids, simulation.worlds
    spawn_later(call, simulation)
    assert code(call("set_simulation_state", state={"state": PLAYING})) == OK
    assert code(call("set_simulation_state", state={"state": STOPPED})) == OK
    assert set(simulation.state.ids) == set(before)
    assert simulation.state.time_s == 0.0
    assert simulation.worlds == first
    assert position_of(call("get_entity_state", entity="Mug")["state"]["pose"]) == (2.0, 0.0, 0.85)
    resource = {"resource_string": ROBOT}
    assert code(call("spawn_entity", name="cart", entity_resource=resource)) == OK


@pytest.mark.parametrize("scope", [0, 255, 7, 6])
def test_a_full_reset_removes_what_was_spawned(call: Call, simulation: Simulation, scope: int) -> None:
    before = simulation.state.ids
    spawn_later(call, simulation)
    assert code(call("reset_simulation", scope=scope)) == OK
    assert set(simulation.state.ids) == set(before)
    assert simulation.state.time_s == 0.0


@pytest.mark.parametrize("scope", [2, 3])
def test_a_reset_of_the_state_keeps_what_was_spawned(call: Call, simulation: Simulation, scope: int) -> None:
    before = simulation.state.ids
    spawn_later(call, simulation)
    call("delete_entity", entity="later")
    call("set_entity_state", entity="cart", state={"pose": pose_message(5, 5, 5)}, set_pose=True)
    assert code(call("reset_simulation", scope=scope)) == OK
    assert set(simulation.state.ids) == {*before, "cart", "cart/arm"}
    assert position_of(call("get_entity_state", entity="cart")["state"]["pose"]) == (0.0, 9.0, 1.0)
    assert position_of(call("get_entity_state", entity="Mug")["state"]["pose"]) == (2.0, 0.0, 0.85)
    assert code(call("reset_simulation")) == OK
    assert set(simulation.state.ids) == set(before)


def test_a_reset_of_spawned_entities_keeps_time_and_poses(call: Call, simulation: Simulation) -> None:
    spawn_later(call, simulation)
    before_s = simulation.state.time_s
    assert code(call("reset_simulation", scope=4)) == OK
    assert not {"cart", "cart/arm", "later"} & set(simulation.state.ids)
    assert simulation.state.time_s == before_s
    assert position_of(call("get_entity_state", entity="Mug")["state"]["pose"]) == (4.0, 4.0, 4.0)
    assert "DrawerHandle" not in simulation.state.ids
    for scope in (1, 5, 8):
        assert code(call("reset_simulation", scope=scope)) == UNSUPPORTED


def test_only_supported_features_are_listed(call: Call) -> None:
    features = set(call("get_simulator_features")["features"]["features"])
    assert features == {
        *(0, 1, 2, 3, 4, 5, 6, 8, 9, 10, 11, 12, 14),
        *(20, 22, 23, 24, 25, 26, 31, 32, 33),
        *(40, 41, 42, 43, 44, 45, 50),
    }


# -- named poses -------------------------------------------------------------------------------------------------------


def test_named_poses_are_support_surfaces_free_places_and_handles(call: Call) -> None:
    reply = call("get_named_poses")
    assert code(reply) == OK
    poses = {each["name"]: each for each in reply["poses"]}
    assert len(poses) == len(reply["poses"])
    top = poses["Cupboard/on"]
    assert position_of(top["pose"]) == (2.0, 0.0, 0.8)
    assert {"support_surface", "on", "spawn", "Cupboard"} <= set(top["tags"])
    assert "Cupboard" in top["description"]
    handle = poses["FridgeHandle/grasp"]
    assert position_of(handle["pose"]) == (1.64, 0.75, 1.0)
    assert {"handle", "Handle"} <= set(handle["tags"])
    named = {each["name"] for each in call("get_named_poses", tags={"tags": ["handle"]})["poses"]}
    assert named == {"DrawerHandle/grasp", "FridgeHandle/grasp"}
    both = {"tags": ["placement", "on", "Cupboard"], "filter_mode": 1}
    assert [each["name"] for each in call("get_named_poses", tags=both)["poses"]] == ["Cupboard/on/free"]


def test_an_entity_fits_at_a_free_named_pose(call: Call, simulation: Simulation) -> None:
    (place,) = call("get_named_poses", tags={"tags": ["placement", "on", "Cupboard"], "filter_mode": 1})["poses"]
    bounds = call("get_named_pose_bounds", name=place["name"])["bounds"]
    assert bounds["points"] == [{"x": 0.05, "y": 0.05, "z": 0.05}, {"x": -0.05, "y": -0.05, "z": -0.05}]
    box = "<geometry><box size='0.1 0.1 0.1'/></geometry>"
    cube = f"<robot name='c'><link name='l'><visual>{box}</visual></link></robot>"
    made = call("spawn_entity", entity_resource={"resource_string": cube}, initial_pose={"pose": place["pose"]})
    assert code(made) == OK
    simulation.step(0.5)
    there = simulation.snapshot()
    assert there.body("Mug").pose.position == pytest.approx((2.0, 0.0, 0.85), abs=2e-3)
    expected = place["pose"]["position"].values()
    assert there.body("c").pose.position == pytest.approx(tuple(expected), abs=2e-3)
    taken = call("get_named_poses", tags={"tags": ["placement", "on", "Cupboard"], "filter_mode": 1})["poses"]
    assert taken[0]["pose"] != place["pose"]


def test_bounds_of_a_surface_end_below_what_is_above(call: Call) -> None:
    upper, lower = call("get_named_pose_bounds", name="Cupboard/on")["bounds"]["points"]
    assert upper == {"x": 0.3, "y": 0.3, "z": 2.0}
    assert lower == {"x": -0.3, "y": -0.3, "z": 0.0}
    call("spawn_pro_mesh", id="shelf", width=1.0, height=0.1, depth=1.0, pose=pose_message(2, 0, 1.55))
    upper, _ = call("get_named_pose_bounds", name="Cupboard/on")["bounds"]["points"]
    assert upper["z"] == pytest.approx(0.7)
    reply = call("get_named_pose_bounds", name="Cupboard/onn")
    assert code(reply) == NOT_FOUND
    assert "Cupboard/on" in reply["result"]["error_message"]


def test_clients_can_quit_only_if_allowed(simulation: Simulation) -> None:
    ended: list[bool] = []
    with LocalNode() as local_node, RosInterface(simulation, local_node, on_quit=lambda: ended.append(True)):
        simulation.play()
        assert code(local_node.call_service("/unreal/set_simulation_state", {"state": {"state": QUITTING}})) == OK
    assert ended == [True]
    assert not simulation.state.playing
