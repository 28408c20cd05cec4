"""Engine services: the whole engine interface as services, without loss and with the same errors."""

from __future__ import annotations

from base64 import b64decode
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mindstage.bridge import GoalStatus, LocalNode
from mindstage.bridge.conversions import (
    error_from_text,
    geometry_to_json,
    message_to_error,
    to_json,
    world_from_json,
    world_to_json,
)
from mindstage.engines import NullEngine, PoseArray
from mindstage.engines.base import Actuator
from mindstage.episodes.episode import Episode
from mindstage.errors import BodyNotFoundError, PoseUnreachableError, ServiceCallError, SimulationDivergedError
from mindstage.knowledge import KnowledgeBase
from mindstage.msgs import decode, engine_service, mindstage_msgs, service_types
from mindstage.ros import RosInterface
from mindstage.scene import BodyGeometry, BodyId, BodyPhysics, CollisionShape, Material, Mobility, diff
from mindstage.scene.edits import SetPhysics, edit_to_json
from mindstage.simulation import Simulation
from tests.bridge.raw_client import TIMEOUT_S, eventually
from tests.kitchenette import kitchenette
from tests.ros.ros_messages import TURNED, Call, pose_message, position_of


@pytest.fixture
def engine(call: Call) -> Call:
    return lambda name, /, **args: call(f"mindstage/{name}", **args)


def test_every_service_of_the_package_is_advertised(ros_interface: RosInterface, local_node: LocalNode) -> None:
    offered = {each.name for each in local_node.graph_info().services}
    engines = [cls for cls in vars(mindstage_msgs).values() if isinstance(cls, type)]
    others = {mindstage_msgs.Ask, mindstage_msgs.SaveScene, mindstage_msgs.Photograph}  # optional for engines
    expected = {
        engine_service(cls, "unreal")
        for cls in engines
        if f"mindstage_msgs/{cls.__name__}" in service_types() and cls not in others
    }
    assert len(expected) >= 19
    assert expected <= offered
    assert [each.name for each in local_node.entry_points() if each.policy is None] == [], "all state their limits"


def test_a_world_survives_a_round_trip_without_loss(engine: Call, simulation: Simulation) -> None:
    assert engine("clear").items() >= {"success": True, "refusal": EMPTY}.items()
    reply = engine("spawn_world", world=world_to_json(kitchenette()))
    assert reply["success"]
    assert (reply["report"]["bodies"], reply["report"]["joints"], reply["report"]["attachments"]) == (8, 2, 2)
    assert diff(kitchenette(), world_from_json(engine("log_world")["world"])).identical(0.0)


def test_failures_are_in_the_spawn_report(engine: Call) -> None:
    reply = engine("spawn_world", world=world_to_json(kitchenette()))
    assert not reply["success"]
    assert {each["id"] for each in reply["report"]["failed_bodies"]} >= {"Mug", "Fridge"}


def test_describe_returns_engine_and_capabilities(engine: Call) -> None:
    response = engine("describe")
    assert (response["engine"], response["abilities"], response["format_version"]) == (
        "mujoco", ["actuators", "joints", "kinematic velocities", "save"], 2,
    )  # fmt: skip
    assert response["takes"] == ["geometries"]


def test_bodies_are_edited(engine: Call, simulation: Simulation) -> None:
    assert engine("set_pose", id="Mug", pose=pose_message(4, 4, 4, TURNED))["success"]
    poses = engine("get_poses")
    assert position_of(dict(zip(poses["ids"], poses["poses"], strict=True))["Mug"]) == (4, 4, 4)
    assert engine("set_physics", id="Mug", physics=to_json(BodyPhysics(mobility=Mobility.KINEMATIC)))["success"]
    materials = (Material(name="Oak", color=(0.5, 0.25, 0.125)),)
    assert engine("set_materials", id="Mug", materials=to_json(materials, tuple[Material, ...]))["success"]
    assert engine("set_label", id="Mug", label="cup of Zoë")["success"]
    body = simulation.snapshot().body("Mug")
    assert body.label == "cup of Zoë"
    assert (body.physics, body.materials) == (BodyPhysics(mobility=Mobility.KINEMATIC), materials)
    assert engine("attach", parent="Fridge", child="Mug")["success"]
    assert engine("detach", child="Mug")["success"]
    assert engine("delete", ids=["Mug", "Drawer"])["success"]
    assert not {"Mug", "Drawer"} & set(simulation.state.ids)


def test_bodies_without_weight_hover(engine: Call, simulation: Simulation) -> None:
    def height_after_a_fall() -> float:
        assert engine("set_pose", id="Mug", pose=pose_message(4, 4, 4))["success"]
        simulation.step(0.3)
        return simulation.snapshot().body("Mug").pose.position[2]

    assert height_after_a_fall() < 3.7
    none = to_json((), tuple[Actuator, ...])
    assert engine("set_actuators", actuators=none, without_weight=["Mug"])["success"]
    assert height_after_a_fall() == pytest.approx(4.0, abs=0.01)


def test_responses_to_edits_have_the_expected_time_of_a_rebuild(engine: Call, simulation: Simulation) -> None:
    simulation.step(0.01)
    assert engine("set_label", id="Mug", label="cup")["expected_rebuild_s"] == 0.0
    edits: dict[str, dict[str, object]] = {
        "set_physics": {"id": "Mug", "physics": to_json(BodyPhysics(mobility=Mobility.STATIC))},
        "attach": {"parent": "Fridge", "child": "Mug"},
        "delete": {"ids": ["Mug"]},
        "apply_edit": {"edit": edit_to_json(SetPhysics(id=BodyId("Drawer"), physics=BodyPhysics())).decode()},
        "clear": {},
        "spawn_world": {"world": world_to_json(kitchenette())},
    }
    for name, arguments in edits.items():
        simulation.step(0.01)
        assert engine(name, **arguments)["expected_rebuild_s"] == simulation.state.expected_rebuild_s > 0.0, name


def test_bodies_are_highlighted_in_any_color(engine: Call, simulation: Simulation) -> None:
    color = {"r": 0.1, "g": 0.2, "b": 0.3, "a": 1.0}
    assert engine("highlight", ids=["Mug", "Fridge"], highlighted=True, color=color)["success"]
    assert simulation.state.highlights == {"Mug": (0.1, 0.2, 0.3), "Fridge": (0.1, 0.2, 0.3)}
    highlighted = engine("get_highlights")
    assert highlighted["ids"] == ["Mug", "Fridge"]
    assert highlighted["colors"] == [color, color]
    assert engine("highlight", ids=["Mug"])["success"]
    assert set(simulation.state.highlights) == {"Fridge"}


def test_a_force_acts_throughout_the_step(engine: Call) -> None:
    before = engine("describe")["time_s"]
    force = {"x": -40.0, "y": 0.0, "z": 0.0}
    assert engine("push", id="Drawer", force=force)["success"]
    assert engine("step", duration_s=0.2)["time_s"] == pytest.approx(before + 0.2)
    joints = {each["id"]: each for each in engine("get_joint_positions")["joints"]}
    assert joints["DrawerSlide"]["x"] < -0.05
    assert abs(joints["FridgeHinge"]["swing1"]) < 1e-3


def test_a_step_applies_forces_and_returns_poses(engine: Call, simulation: Simulation) -> None:
    push = {"id": "Drawer", "force": {"x": -40.0, "y": 0.0, "z": 0.0}}
    reply = engine("step", duration_s=0.2, forces=[push, push], packed=True)
    np.testing.assert_array_equal(rows(reply), simulation.state.poses)
    assert simulation.state.poses[simulation.state.ids.index(BodyId("Drawer")), 0] < 1.95 - 0.1
    assert rows(engine("step", duration_s=0.2)).size == 0  # not requested
    with pytest.raises(BodyNotFoundError):
        raise message_to_error(decode(mindstage_msgs.Refusal, engine("step", forces=[{"id": "Drawr"}])["refusal"]))


def test_packed_poses_leave_out_known_ids(engine: Call, simulation: Simulation) -> None:
    first = engine("get_poses", packed=True)
    assert (first["ids"], first["poses"]) == (list(simulation.state.ids), [])
    np.testing.assert_array_equal(rows(first), simulation.state.poses)
    again = engine("get_poses", packed=True, known=first["revision"])
    assert (again["ids"], again["revision"], again["rows"]) == ([], first["revision"], first["rows"])
    engine("delete", ids=["Mug"])
    other = engine("get_poses", packed=True, known=first["revision"])
    assert other["revision"] not in {0, first["revision"]}
    assert "Mug" not in other["ids"]
    assert len(rows(other)) == len(other["ids"])


def test_geometries_in_the_request_are_used(engine: Call, simulation: Simulation) -> None:
    engine("clear")
    flat = BodyGeometry(
        key="0123456789abcdef",
        visuals=(),
        collision_shapes=(CollisionShape(size=(0.08, 0.08, 0.02)),),
        shape_name="puck",
    )
    forms = geometry_to_json({BodyId("Mug"): flat})
    assert engine("spawn_world", world=world_to_json(kitchenette()), geometries=forms)["success"]
    assert simulation.geometry[BodyId("Mug")].collision_shapes == flat.collision_shapes
    engine("step", duration_s=1.0)
    assert position_of(engine("get_poses")["poses"][7])[2] == pytest.approx(
        0.81, abs=0.003
    )  # half the height of the body above the cupboard


def test_invalid_geometries_are_rejected_before_spawning(engine: Call, simulation: Simulation) -> None:
    engine("clear")
    with pytest.raises(ServiceCallError, match="no geometry has the key"):
        engine("spawn_world", world=world_to_json(kitchenette()), geometries='{"bodies": {"Mug": "0123456789abcdef"}}')
    assert simulation.state.ids == ()


def rows(reply: dict[str, Any]) -> PoseArray:
    return np.frombuffer(b64decode(reply["rows"]), dtype="<f8").reshape(-1, 7)


def test_states_are_saved_and_restored_exactly(engine: Call, simulation: Simulation) -> None:
    handle = engine("save_state")["handle"]
    before = simulation.state.poses.copy()
    engine("push", id="Drawer", force={"x": -40.0, "y": 0.0, "z": 0.0})
    engine("step", duration_s=0.2)
    assert (simulation.state.poses != before).any()
    revision = simulation.state.revision
    assert engine("restore_state", handle=handle)["success"]
    assert simulation.state.revision > revision, "pages and caches read the bodies again"
    assert (simulation.state.poses == before).all()
    assert engine("forget_state", handle=handle)["success"]
    with pytest.raises(ServiceCallError, match="no saved state"):
        engine("restore_state", handle=handle)


def test_the_number_of_saved_states_is_limited(engine: Call) -> None:
    for _ in range(64):
        engine("save_state")
    with pytest.raises(ServiceCallError, match="64 states are saved already"):
        engine("save_state")


def test_world_errors_survive_a_round_trip(engine: Call) -> None:
    def refused(name: str, **args: Any) -> Exception:
        reply = engine(name, **args)
        assert not reply["success"]
        return message_to_error(decode(mindstage_msgs.Refusal, reply["refusal"]))

    unknown = refused("set_pose", id="Mugg", pose=pose_message(0, 0, 0))
    assert isinstance(unknown, BodyNotFoundError)
    assert (unknown.body, unknown.suggestions) == ("Mugg", ("Mug",))
    unreachable = refused("set_pose", id="Drawer", pose=pose_message(9, 9, 9))
    assert isinstance(unreachable, PoseUnreachableError)
    assert unreachable.reason
    for name, args in (
        ("delete", {"ids": ["nobody"]}),
        ("attach", {"parent": "nobody", "child": "Mug"}),
        ("detach", {"child": "nobody"}),
        ("highlight", {"ids": ["nobody"], "highlighted": True}),
        ("push", {"id": "nobody"}),
        ("set_physics", {"id": "nobody", "physics": "{}"}),
        ("set_materials", {"id": "nobody", "materials": "[]"}),
        ("set_label", {"id": "nobody", "label": "cup"}),
    ):
        assert isinstance(refused(name, **args), BodyNotFoundError), name


@pytest.mark.parametrize(
    ("service", "args", "text"),
    [
        ("spawn_world", {"world": "{}"}, "format_version"),
        ("spawn_world", {"world": '{"format_version": 99}'}, "this version of Mindstage reads 2"),
        ("set_physics", {"id": "Mug", "physics": '{"mass": 1}'}, "mass"),
        ("set_materials", {"id": "Mug", "materials": "{}"}, "expected array"),
        ("step", {"duration_s": -1.0}, "it must be a number from 0 to 3600 s"),
        ("set_pose", {"id": "Mug", "pose": {"position": {"x": 1e308}}}, "pose.position.x"),
        (
            "step",
            {"duration_s": 0.1, "forces": [{"id": "Mug"}, {"id": "Mug", "force": {"y": 1e308}}]},
            "forces[1].force.y",
        ),
    ],
)
def test_invalid_parts_of_a_world_fail_the_call(engine: Call, service: str, args: Any, text: str) -> None:
    with pytest.raises(ServiceCallError) as failure:
        engine(service, **args)
    assert text in str(failure.value)


def test_a_missing_capability_is_an_error(knowledge: KnowledgeBase) -> None:
    with (
        Simulation(knowledge, NullEngine()) as simulation,
        LocalNode() as local_node,
        RosInterface(simulation, local_node),
    ):
        assert local_node.call_service("/unreal/mindstage/describe")["abilities"] == ["save"]
        with pytest.raises(ServiceCallError, match="has no joint positions"):
            local_node.call_service("/unreal/mindstage/get_joint_positions")


class ExplodingEngine(NullEngine):
    def step(self, duration_s: float) -> None:
        raise SimulationDivergedError(time_s=1.5, what="everything flies")


def test_engine_errors_survive_a_round_trip(knowledge: KnowledgeBase) -> None:
    with (
        Simulation(knowledge, ExplodingEngine()) as simulation,
        LocalNode() as local_node,
        RosInterface(simulation, local_node),
        pytest.raises(ServiceCallError) as failure,
    ):
        local_node.call_service("/unreal/mindstage/step", {"duration_s": 0.1})
    error = error_from_text(failure.value.cause)
    assert isinstance(error, SimulationDivergedError)
    assert (error.time_s, error.what) == (1.5, "everything flies")


def test_spawn_map_sends_feedback(engine: Call, local_node: LocalNode, simulation: Simulation) -> None:
    engine("clear")
    response: list[Any] = []
    goal = {"world": world_to_json(kitchenette())}
    sent = local_node.send_goal(
        "/unreal/mindstage/spawn_map", "mindstage_msgs/SpawnMap", goal, on_feedback=response.append
    )
    outcome = sent.wait(TIMEOUT_S)
    assert outcome.status is GoalStatus.SUCCEEDED
    assert outcome.values["report"]["bodies"] == 8
    assert response[0]["phase"] == "reading"
    assert response[-1] == {"phase": "spawned", "done": 12, "total": 12}
    again = local_node.send_goal("/unreal/mindstage/spawn_map", "mindstage_msgs/SpawnMap", goal).wait(TIMEOUT_S)
    assert again.status is GoalStatus.ABORTED
    assert len(again.values["report"]["failed_bodies"]) == 8
    eventually(lambda: len(simulation.state.ids) == 8)


EMPTY = {"code": "", "text": "", "body": "", "parent": "", "child": "", "reason": "", "world": "", "suggestions": []}


def test_a_client_records_an_episode(simulation: Simulation, local_node: LocalNode, tmp_path: Path) -> None:
    with RosInterface(simulation, local_node, episodes=tmp_path):

        def call(service: str, **args: Any) -> Any:
            return local_node.call_service(f"/unreal/{service}", args, timeout_s=TIMEOUT_S)

        started = call("mindstage/record", name="run")
        assert started["success"]
        call("set_model_pose", id="Mug", pose=pose_message(0.0, 0.0, 0.05))
        with pytest.raises(ServiceCallError, match="stop that first"):
            call("mindstage/record", name="other")
        assert call("mindstage/record", stop=True)["path"] == started["path"] == "run.mcap"
        with pytest.raises(ServiceCallError, match="nothing is being recorded"):
            call("mindstage/record", stop=True)
        with pytest.raises(ServiceCallError, match="not the name of a file"):
            call("mindstage/record", name="../outside")
    with Episode(tmp_path / "run.mcap") as episode:
        assert [(each.kind, each.client) for each in episode.edits()] == [("set poses", "ROS: /unreal/set_model_pose")]


def test_clients_cannot_record_without_a_folder(engine: Call) -> None:
    with pytest.raises(ServiceCallError, match="--episodes"):
        engine("record")
