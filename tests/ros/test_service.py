"""Success, rejection by the world, and failure, which every service distinguishes."""

from __future__ import annotations

import threading
from collections.abc import Callable
from queue import SimpleQueue
from typing import Any

import pytest

from mindstage.access.limits import BridgeLimits
from mindstage.bridge import LocalNode, RosbridgeServer
from mindstage.bridge.conversions import error_from_text
from mindstage.bridge.conversions_unreal import spawn_request
from mindstage.engines import NullEngine
from mindstage.errors import EngineClosedError, ServiceCallError, SimulationTimeoutError
from mindstage.knowledge import KnowledgeBase
from mindstage.msgs import encode, service_type
from mindstage.msgs.schema.base import fields_of
from mindstage.ros import RosInterface
from mindstage.scene import World
from mindstage.simulation import Simulation
from tests.bridge.raw_client import TIMEOUT_S, RawClient, eventually
from tests.kitchenette import kitchenette
from tests.ros.ros_messages import pose_message

RawClientFactory = Callable[[], RawClient]


def test_every_service_rejects_a_malformed_request_with_the_path(
    make_raw_client: RawClientFactory, local_node: LocalNode
) -> None:
    client = make_raw_client()
    offered = local_node.graph_info().services
    assert len(offered) > 100
    for service in offered:
        fields = fields_of(service_type(service.type).request)
        wrong: dict[str, Any] = {"nonsense": 1}
        if fields:
            wrong = {fields[0].name: {"no": "such thing"} if fields[0].message is None else 7}
        answer = client.call_service(service.name, wrong)
        assert answer["result"] is False, service.name
        assert next(iter(wrong)) in answer["values"], (service.name, answer["values"])
        for args in ("text", 7, [1] * 50):
            answer = client.call_service(service.name, args)
            assert answer["result"] is False, (service.name, args)
            assert isinstance(answer["values"], str)


def test_the_path_of_an_error_is_complete(make_raw_client: RawClientFactory) -> None:
    client = make_raw_client()
    request = encode(spawn_request(kitchenette()))
    request["constraints"][1]["constraint_details"]["linear_limits"]["limit"] = "far"
    answer = client.call_service("/unreal/spawn_semantic_map", request)
    assert answer["result"] is False
    assert "constraints[1].constraint_details.linear_limits.limit: expected float, got str" in answer["values"]
    answer = client.call_service("/unreal/set_model_pose", {"id": "Mug", "pose": {"positon": {}}})
    assert "near: 'position'" in answer["values"]
    answer = client.call_service("/unreal/highlight_models", {"id": "Mug", "color": 9})
    assert "valid: 0 NONE, 1 BLACK, 2 RED" in answer["values"]


def test_success_rejection_and_failure_are_distinguished(
    make_raw_client: RawClientFactory, local_node: LocalNode
) -> None:
    diagnostics: list[Any] = []
    local_node.subscribe("/mindstage/diagnostics", diagnostics.append)
    client = make_raw_client()
    done = client.call_service("/unreal/set_model_pose", {"id": "Mug", "pose": pose_message(4, 4, 4)})
    assert (done["result"], done["values"]) == (True, {"success": True})
    refused = client.call_service("/unreal/set_model_pose", {"id": "Mugg", "pose": pose_message(4, 4, 4)})
    assert (refused["result"], refused["values"]) == (True, {"success": False})
    broken = client.call_service("/unreal/set_model_pose", {"id": 7})
    assert broken["result"] is False
    unknown = client.call_service("/unreal/set_model_pos", {})
    assert unknown["result"] is False
    assert "near: '/unreal/set_model_pose'" in unknown["values"]
    eventually(lambda: diagnostics)
    (status,) = diagnostics[0]["status"]
    assert status["hardware_id"] == "Mugg"
    assert status["name"] == "mindstage: /unreal/set_model_pose"
    values = {each["key"]: each["value"] for each in status["values"]}
    assert values == {"id": "Mugg", "code": "BodyNotFoundError"}


def test_a_failed_engine_is_reported_by_every_service(knowledge: KnowledgeBase) -> None:
    engine = NullEngine()
    with Simulation(knowledge, engine) as simulation, LocalNode() as local_node, RosInterface(simulation, local_node):
        simulation.spawn(kitchenette())
        assert simulation.engine.ping() >= 0.0
        assert local_node.call_service("/unreal/get_model_pose", {"id": "Mug"})["success"]
        engine.close()
        with pytest.raises(EngineClosedError):
            simulation.engine.ping()
        for service, args in (
            ("get_model_pose", {"id": "Mug"}),
            ("set_model_pose", {"id": "Mug"}),
            ("spawn_model", {"id": "New"}),
            ("get_entities", {}),
            ("get_entity_state", {"entity": "Mug"}),
            ("get_simulation_state", {}),
            ("mindstage/describe", {}),
            ("mindstage/get_poses", {}),
        ):
            with pytest.raises(ServiceCallError) as failure:
                local_node.call_service(f"/unreal/{service}", args, timeout_s=TIMEOUT_S)
            assert isinstance(error_from_text(failure.value.cause), EngineClosedError), service
        goal = local_node.send_goal("/unreal/simulate_steps", "simulation_interfaces/SimulateSteps", {"steps": 10})
        with pytest.raises(ServiceCallError, match="is closed"):
            goal.wait(TIMEOUT_S)
        assert local_node.call_service("/mindstage/maps", {})["success"]  # the knowledge base needs no engine


def test_a_closed_simulation_returns_no_old_state(
    simulation: Simulation, ros_interface: RosInterface, local_node: LocalNode
) -> None:
    simulation.close()
    for service in ("get_model_pose", "set_model_pose", "mindstage/get_poses"):
        with pytest.raises(ServiceCallError, match="is closed"):
            local_node.call_service(f"/unreal/{service}", {})


class SlowEngine(NullEngine):
    """An engine whose snapshot blocks until the test allows it."""

    def __init__(self) -> None:
        super().__init__()
        self.may_log = threading.Event()

    def snapshot(self) -> World:
        self.may_log.wait(TIMEOUT_S)
        return super().snapshot()


def test_a_call_times_out_and_the_next_one_works(knowledge: KnowledgeBase) -> None:
    engine = SlowEngine()
    with (
        Simulation(knowledge, engine, timeout_s=2.0) as simulation,
        LocalNode() as local_node,
        RosInterface(simulation, local_node),
    ):
        simulation.spawn(kitchenette())
        with pytest.raises(ServiceCallError, match=r"log.* 2 s"):
            local_node.call_service("/unreal/mindstage/log_world", {}, timeout_s=TIMEOUT_S)
        assert local_node.call_service("/unreal/get_model_pose", {"id": "Mug"})[
            "success"
        ]  # quick services do not wait for the engine
        with pytest.raises(SimulationTimeoutError):
            simulation.engine.ping(timeout_s=0.1)
        assert simulation.engine.error is None
        engine.may_log.set()
        assert local_node.call_service("/unreal/mindstage/log_world", {}, timeout_s=TIMEOUT_S)["success"]


def test_a_call_without_a_timeout_has_the_default_timeout(knowledge: KnowledgeBase) -> None:
    engine = SlowEngine()
    with (
        Simulation(knowledge, engine) as simulation,
        LocalNode(limits=BridgeLimits(call_timeout_s=1.0)) as local_node,
        RosInterface(simulation, local_node),
        RosbridgeServer(local_node, port=0) as server,
    ):
        client = RawClient(server.url)
        client.send_operation(op="call_service", id="begun", service="/unreal/mindstage/log_world")
        client.send_operation(op="call_service", id="worlds", service="/unreal/get_available_worlds")
        answer = client.call_service("/unreal/mindstage/clear")
        assert answer["result"] is False
        assert "did not begin within 1 s" in answer["values"]
        engine.may_log.set()
        # Listing worlds reads files, so it may wait as long as loading them.
        assert client.receive("service_response", id="worlds")["result"] is True
        assert client.receive("service_response", id="begun")["result"] is True
        assert client.call_service("/unreal/mindstage/describe", timeout=TIMEOUT_S)["result"] is True
        client.close()


def test_the_end_of_a_call_that_takes_too_long_is_reported(knowledge: KnowledgeBase) -> None:
    engine = SlowEngine()
    with (
        Simulation(knowledge, engine, timeout_s=1.0) as simulation,
        LocalNode() as local_node,
        RosInterface(simulation, local_node),
    ):
        reports: SimpleQueue[Any] = SimpleQueue()
        local_node.subscribe("/mindstage/diagnostics", reports.put)
        with pytest.raises(ServiceCallError, match="it has begun: it is not interrupted, and its end is reported"):
            local_node.call_service("/unreal/mindstage/log_world", {}, timeout_s=TIMEOUT_S)
        engine.may_log.set()
        while True:
            (status,) = reports.get(timeout=TIMEOUT_S)["status"]
            if "has ended" in status["message"]:
                break
        assert "snapshot" in status["name"]


def test_spawn_calls_have_a_longer_timeout(ros_interface: RosInterface, local_node: LocalNode) -> None:
    patience = local_node.broker.services.timeouts_s
    assert patience["/unreal/spawn_semantic_map"] >= 60.0
    assert patience["/unreal/mindstage/spawn_world"] >= 60.0
    assert "/unreal/get_model_pose" not in patience


def test_closing_the_interface_withdraws_everything(simulation: Simulation) -> None:
    with LocalNode() as local_node:
        for _ in range(2):
            with RosInterface(simulation, local_node) as ros_interface:
                assert local_node.call_service("/unreal/get_model_pose", {"id": "Mug"})["success"]
            ros_interface.close()
            left = local_node.graph_info()
            assert (left.services, left.actions, left.topics) == ((), (), ())
        assert not [each for each in threading.enumerate() if each.name.startswith("mindstage-ros")]
