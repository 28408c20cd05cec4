"""World control: the services of UROSWorldControl."""

from __future__ import annotations

from typing import Any

import pytest

from mindstage.bridge import LocalNode
from mindstage.bridge.conversions_unreal import spawn_request, untranslatable_fields
from mindstage.knowledge import KnowledgeBase
from mindstage.msgs import encode
from mindstage.ros import RosInterface
from mindstage.scene import Mobility, diff
from mindstage.scene.world_diff import ChangeKind
from mindstage.simulation import Simulation
from tests.bridge.raw_client import TIMEOUT_S, eventually
from tests.ros.ros_messages import TURNED, Ask, Call, diagnostic_texts, pose_message, position_of

BOX = {"height": 0.2, "width": 0.3, "depth": 0.4}


@pytest.fixture
def diagnostics(local_node: LocalNode, ros_interface: RosInterface) -> list[Any]:
    """The diagnostic messages."""
    received: list[Any] = []
    local_node.subscribe("/mindstage/diagnostics", received.append)
    return received


def test_a_map_is_spawned_completely(call: Call, simulation: Simulation, knowledge: KnowledgeBase, ask: Ask) -> None:
    simulation.clear()
    kitchen = knowledge.world()
    reply = call("spawn_semantic_map", **encode(spawn_request(kitchen)))
    assert reply == {"success": True, "failed_model_ids": [], "failed_constraint_ids": [], "failed_relations": []}
    there = diff(kitchen, simulation.snapshot())
    assert not there.only_in_a
    assert not there.only_in_b
    errors = dict(there.max_error)
    # Limits of these messages are symmetric; that a range is not is reported.
    shifted = {id for note in untranslatable_fields(kitchen) for id in note.ids}
    assert {change.id for change in there.changed if change.kind == ChangeKind.LIMIT and change.error} <= shifted
    del errors[ChangeKind.LIMIT]
    assert max(errors.values()) <= 1e-6
    # The IRIs of the bodies are those of the map, so that questions about the map refer to them.
    assert simulation.worlds[0].iri == kitchen.iri
    assert ask("handle_of", individual="fridge_door")["answers"]


def test_partial_failures_of_a_map_are_listed_with_reasons(call: Call, diagnostics: list[Any]) -> None:
    reply = call(
        "spawn_semantic_map",
        models=[{"id": "Mug", "name": "Cup"}, {"id": "Bowl", "name": "Bowl", "pose": pose_message(0, 5, 1)}],
        constraints=[{"id": "joint", "constraint_details": {"id_first_model": "Bowl", "id_second_model": "nobody"}}],
        relations=[{"parent_id": "nobody", "child_id": "Bowl"}],
    )
    assert reply == {
        "success": False,
        "failed_model_ids": ["Mug"],
        "failed_constraint_ids": ["joint"],
        "failed_relations": [{"parent_id": "nobody", "child_id": "Bowl"}],
    }
    assert position_of(call("get_model_pose", id="Bowl")["pose"]) == (0, 5, 1)
    eventually(lambda: {"Mug", "joint", "Bowl"} <= {id for id, _ in diagnostic_texts(diagnostics)})
    assert any(id == "Mug" and "taken" in text for id, text in diagnostic_texts(diagnostics))


def test_a_model_is_spawned_and_attached_to_its_parent(call: Call, simulation: Simulation) -> None:
    pose = pose_message(1.0, 2.0, 3.0, TURNED)
    reply = call("spawn_model", name="Cup", id="New", pose=pose, parent_id="Drawer", actor_label="Best cup")
    assert reply == {"id": "New", "name": "Best cup", "etype": "", "success": True}
    assert call("get_model_pose", id="New") == {"pose": pose, "success": True}
    assert ("Drawer", "New") in {(hold.parent, hold.child) for hold in simulation.snapshot().attachments}
    body = simulation.snapshot().body("New")
    assert body.cls.endswith("#Cup")
    assert body.physics.mobility is Mobility.STATIC


def test_a_model_without_an_id_gets_a_new_one(call: Call) -> None:
    first, second = (call("spawn_model", name="Cup", pose=pose_message(0, y, 5)) for y in (5, 6))
    assert first["success"]
    assert second["success"]
    assert first["id"] != second["id"]
    assert call("get_model_pose", id=second["id"])["success"]


def test_a_taken_id_and_an_obstructed_pose_have_codes(call: Call, diagnostics: list[Any]) -> None:
    assert call("spawn_model", name="Cup", id="Mug")["etype"] == "1"
    inside = pose_message(2.0, 0.0, 0.4)
    reply = call("spawn_model", name="Cup", id="Other", pose=inside, spawn_collision_check=True)
    assert (reply["etype"], reply["success"]) == ("2", False)
    assert call("spawn_model", name="Cup", id="Far", pose=pose_message(0, 9, 9), spawn_collision_check=True)["success"]
    assert call("spawn_model", name="Cup", id="Other", pose=inside)["success"]
    eventually(lambda: any(id == "Other" and "Cupboard" in text for id, text in diagnostic_texts(diagnostics)))


def test_an_unknown_parent_is_rejected_before_spawning(call: Call, diagnostics: list[Any]) -> None:
    reply = call("spawn_model", name="Cup", id="Orphan", parent_id="Cupboart", pose=pose_message(0, 9, 9))
    assert not reply["success"]
    assert not call("get_model_pose", id="Orphan")["success"]
    eventually(lambda: ("Cupboart", "no body 'Cupboart' in 'map'; near: 'Cupboard'") in diagnostic_texts(diagnostics))


def test_a_box_has_the_requested_size(call: Call, simulation: Simulation) -> None:
    reply = call("spawn_pro_mesh", id="Box", pose=pose_message(0, 3, 1), parent_id="Fridge", **BOX)
    assert reply == {"id": "Box", "name": "Box", "success": True}
    assert simulation.snapshot().body("Box").size == (0.4, 0.3, 0.2)


def test_a_joint_is_spawned_between_existing_bodies(call: Call, simulation: Simulation) -> None:
    details = {"id_first_model": "Cupboard", "id_second_model": "Mug", "linear_limits": {"x_motion": 2, "y_motion": 2}}
    reply = call("spawn_physics_constraint", constraint_description={"id": "glue", "constraint_details": details})
    assert reply == {"success": True}
    assert "glue" in {constraint.id for constraint in simulation.snapshot().joints}
    details["id_second_model"] = "nobody"
    assert not call("spawn_physics_constraint", constraint_description={"constraint_details": details})["success"]


def test_attaching_keeps_poses_and_rejects_cycles(call: Call) -> None:
    before = call("get_model_pose", id="Mug")["pose"]
    assert call("attach_model_to_parent", parent_id="Drawer", child_id="Mug")["success"]
    assert position_of(call("get_model_pose", id="Mug")["pose"]) == position_of(before)
    assert not call("attach_model_to_parent", parent_id="Mug", child_id="Drawer")["success"]
    assert not call("attach_model_to_parent", parent_id="Mug", child_id="Mug")["success"]


def test_models_are_deleted_by_id_or_tag(call: Call, simulation: Simulation) -> None:
    assert call("delete_model", id="Mug")["success"]
    assert not call("delete_model", id="Mug")["success"]
    assert call("delete_all", type_to_delete="SemLog", key_to_delete="Class", value_to_delete="Handle")["success"]
    assert {"DrawerHandle", "FridgeHandle"} & set(simulation.state.ids) == set()
    assert "Fridge" in simulation.state.ids
    assert call("delete_all", type_to_delete="SemLog", key_to_delete="Class", ignore_value=True)["success"]
    assert simulation.state.ids == ()


def test_a_pose_that_is_set_is_returned(call: Call, diagnostics: list[Any]) -> None:
    pose = pose_message(4.0, -2.0, 1.5, TURNED)
    assert call("set_model_pose", id="Mug", pose=pose)["success"]
    assert call("get_model_pose", id="Mug") == {"pose": pose, "success": True}
    assert not call("set_model_pose", id="Drawer", pose=pose_message(9, 9, 9))["success"]
    eventually(
        lambda: any(id == "Drawer" and "cannot take that pose" in text for id, text in diagnostic_texts(diagnostics))
    )
    assert not call("get_model_pose", id="Mugg")["success"]
    eventually(lambda: any(id == "Mugg" and "near: 'Mug'" in text for id, text in diagnostic_texts(diagnostics)))


def test_an_actor_is_moved_by_its_unique_label(call: Call) -> None:
    for id in ("One", "Two", "Three"):
        label = "Unique" if id == "One" else "Twin"
        call("spawn_model", name="Cup", id=id, actor_label=label, pose=pose_message(0, 5, 1))
    assert call("move_object", Name="Unique", pose=pose_message(0, 6, 1))["success"]
    assert position_of(call("get_model_pose", id="One")["pose"]) == (0, 6, 1)
    assert not call("move_object", Name="Twin", pose=pose_message(0, 7, 1))["success"]
    assert call("move_object", name="Two", pose=pose_message(0, 7, 1))["success"]
    assert not call("move_object", Name="Nobody", pose=pose_message(0, 7, 1))["success"]


def test_attached_bodies_are_sockets(call: Call) -> None:
    handle = call("get_model_pose", id="DrawerHandle")
    for socket in ("DrawerHandle", "Handle"):
        assert call("get_model_socket_pose", id="Drawer", socket=socket) == handle
    assert call("get_model_socket_pose", id="Drawer") == call("get_model_pose", id="Drawer")
    assert not call("get_model_socket_pose", id="Drawer", socket="Mug")["success"]


def test_the_spatial_relation_of_two_bodies_is_one_word(call: Call) -> None:
    def state(one: str, other: str) -> str:
        reply = call("object_to_object_state", source_object_id=one, other_object_id=other)
        return str(reply["state"]) if reply["success"] else "no"

    assert state("Mug", "Cupboard") == "on"
    assert state("Cupboard", "Mug") == "below"
    assert state("Drawer", "Cupboard") == "inside"
    assert state("Mug", "Fridge") == "apart"
    assert state("Mug", "nobody") == "no"


def test_materials_and_physics_can_be_changed(call: Call, simulation: Simulation) -> None:
    assert call("change_material", id="Mug", material_names=["Oak"], material_paths=["/Game/Oak"])["success"]
    assert [(each.name, each.path) for each in simulation.snapshot().body("Mug").materials] == [("Oak", "/Game/Oak")]
    physics = {"mobility": 0, "gravity": True, "mass": 0.5}
    assert call("set_physics_properties", id="Mug", physics_properties=physics)["success"]
    assert simulation.snapshot().body("Mug").physics.mobility is Mobility.STATIC
    assert not call("change_material", id="nobody")["success"]
    assert not call("set_physics_properties", id="nobody")["success"]


def test_bodies_are_highlighted_by_color_codes(call: Call, simulation: Simulation) -> None:
    assert call("highlight_models", id="Mug", color=2)["success"]
    red = simulation.state.highlights["Mug"]  # type: ignore[index]
    assert red[0] > 0.8
    assert max(red[1:]) < 0.2
    assert call("highlight_models", id="Mug", color=0)["success"]
    assert not simulation.state.highlights
    assert not call("highlight_models", id="nobody", color=2)["success"]


def test_checkpoints_save_and_restore_the_full_state(call: Call, diagnostics: list[Any]) -> None:
    before = call("get_model_pose", id="Mug")
    assert call("checkpoint", command="save", args="start")["success"]
    call("set_model_pose", id="Mug", pose=pose_message(4, 4, 4))
    call("delete_model", id="Fridge")
    assert call("checkpoint", command="restore", args="start")["success"]
    assert call("get_model_pose", id="Mug") == before
    assert call("get_model_pose", id="Fridge")["success"]
    assert call("checkpoint", command="forget", args="start")["success"]
    assert not call("checkpoint", command="restore", args="start")["success"]
    eventually(lambda: any("no saved state 'start'" in text for _, text in diagnostic_texts(diagnostics)))


def test_a_level_is_reset(call: Call, simulation: Simulation) -> None:
    before = call("get_model_pose", id="Mug")
    call("set_model_pose", id="Mug", pose=pose_message(4, 4, 4))
    simulation.step(0.5)
    assert call("reset_level")["success"]
    assert call("get_model_pose", id="Mug") == before


def test_assumptions_about_a_model_are_published(call: Call, diagnostics: list[Any]) -> None:
    call("spawn_model", name="Cup", id="Unsized", pose=pose_message(0, 9, 9))
    eventually(lambda: ("Unsized", "a model has no size") in diagnostic_texts(diagnostics))


def test_calls_of_one_client_keep_their_order(client: Any, ros_interface: RosInterface) -> None:
    """A quick service must not run before an earlier call of a slow one."""
    futures = []
    for number in range(50):
        client.call_service_async(
            "/unreal/set_model_pose", {"id": "Mug", "pose": pose_message(4.0, float(number), 1.0)}
        )
        futures.append(client.call_service_async("/unreal/get_model_pose", {"id": "Mug"}))
    assert [position_of(each.result(TIMEOUT_S)["pose"])[1] for each in futures] == [
        float(number) for number in range(50)
    ]


def test_a_failure_is_reported_with_its_operation(call: Call, diagnostics: list[Any]) -> None:
    details = {"id_first_model": "Cupboard", "id_second_model": "nobody"}
    assert not call("spawn_physics_constraint", constraint_description={"id": "glue", "constraint_details": details})[
        "success"
    ]
    assert not call("spawn_pro_mesh", id="Mug", pose=pose_message(0, 3, 1), **BOX)["success"]

    def names() -> set[str]:
        return {status["name"] for each in diagnostics for status in each["status"]}

    eventually(lambda: {"mindstage: spawn_physics_constraint", "mindstage: spawn_pro_mesh"} <= names())
