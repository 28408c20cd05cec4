"""Outcomes: success, the world's no, and what is broken, told apart on the wire by every service."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import pytest

from mindstage.bridge import BridgeLimits, LocalNode, RosbridgeServer
from mindstage.bridge.conversions import error_from_text
from mindstage.bridge.conversions_unreal import spawn_request
from mindstage.engines import NullEngine
from mindstage.errors import EngineClosedError, ServiceCallError, SimulationTimeoutError
from mindstage.knowledge import KnowledgeBase
from mindstage.msgs import encode, service_type
from mindstage.msgs.base import fields_of
from mindstage.ros import RosInterface
from mindstage.scene import World
from mindstage.simulation import Simulation
from tests.bridge.talking import TIMEOUT_S, RawClient, eventually
from tests.kitchenette import kitchenette
from tests.ros.asking import pose_message

Talkers = Callable[[], RawClient]


def test_every_service_says_where_a_malformed_request_is_wrong(talker: Talkers, hub: LocalNode) -> None:
    client = talker()
    offered = hub.graph_info().services
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


def test_the_path_leads_deep(talker: Talkers) -> None:
    client = talker()
    request = encode(spawn_request(kitchenette()))
    request["constraints"][1]["constraint_details"]["linear_limits"]["limit"] = "far"
    answer = client.call_service("/unreal/spawn_semantic_map", request)
    assert answer["result"] is False
    assert "constraints[1].constraint_details.linear_limits.limit: expected float, got str" in answer["values"]
    answer = client.call_service("/unreal/set_model_pose", {"id": "Mug", "pose": {"positon": {}}})
    assert "near: 'position'" in answer["values"]
    answer = client.call_service("/unreal/highlight_models", {"id": "Mug", "color": 9})
    assert "valid: 0 NONE, 1 BLACK, 2 RED" in answer["values"]


def test_the_three_ends_are_told_apart(talker: Talkers, hub: LocalNode) -> None:
    told: list[Any] = []
    hub.subscribe("/mindstage/diagnostics", told.append)
    client = talker()
    done = client.call_service("/unreal/set_model_pose", {"id": "Mug", "pose": pose_message(4, 4, 4)})
    assert (done["result"], done["values"]) == (True, {"success": True})
    refused = client.call_service("/unreal/set_model_pose", {"id": "Mugg", "pose": pose_message(4, 4, 4)})
    assert (refused["result"], refused["values"]) == (True, {"success": False})
    broken = client.call_service("/unreal/set_model_pose", {"id": 7})
    assert broken["result"] is False
    unknown = client.call_service("/unreal/set_model_pos", {})
    assert unknown["result"] is False
    assert "near: '/unreal/set_model_pose'" in unknown["values"]
    eventually(lambda: told)
    (status,) = told[0]["status"]
    assert status["hardware_id"] == "Mugg"
    assert status["name"] == "mindstage: /unreal/set_model_pose"
    values = {each["key"]: each["value"] for each in status["values"]}
    assert values == {"id": "Mugg", "kind": "BodyUnknown"}


def test_a_lost_engine_is_told_from_every_side(knowledge: KnowledgeBase) -> None:
    engine = NullEngine()
    with Simulation(knowledge, engine) as stage, LocalNode() as hub, RosInterface(stage, hub):
        stage.spawn(kitchenette())
        assert stage.ping() >= 0.0
        assert hub.call_service("/unreal/get_model_pose", {"id": "Mug"})["success"]
        engine.close()
        with pytest.raises(EngineClosedError):
            stage.ping()
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
                hub.call_service(f"/unreal/{service}", args, timeout_s=TIMEOUT_S)
            assert isinstance(error_from_text(failure.value.cause), EngineClosedError), service
        goal = hub.send_goal("/unreal/simulate_steps", "simulation_interfaces/SimulateSteps", {"steps": 10})
        with pytest.raises(ServiceCallError, match="is closed"):
            goal.wait(TIMEOUT_S)
        assert hub.call_service("/mindstage/maps", {})["success"]  # what is known is known without an engine


def test_a_closed_stage_tells_nothing_old(stage: Simulation, face: RosInterface, hub: LocalNode) -> None:
    stage.close()
    for service in ("get_model_pose", "set_model_pose", "mindstage/get_poses"):
        with pytest.raises(ServiceCallError, match="is closed"):
            hub.call_service(f"/unreal/{service}", {})


class SlowEngine(NullEngine):
    """Logs only when it may."""

    def __init__(self) -> None:
        super().__init__()
        self.may_log = threading.Event()

    def snapshot(self) -> World:
        self.may_log.wait(TIMEOUT_S)
        return super().snapshot()


def test_a_call_that_takes_too_long_ends_and_the_next_one_works(knowledge: KnowledgeBase) -> None:
    engine = SlowEngine()
    with Simulation(knowledge, engine, timeout_s=0.2) as stage, LocalNode() as hub, RosInterface(stage, hub):
        stage.spawn(kitchenette())
        with pytest.raises(ServiceCallError, match=r"log.* 0\.2 s"):
            hub.call_service("/unreal/mindstage/log_world", {}, timeout_s=TIMEOUT_S)
        assert hub.call_service("/unreal/get_model_pose", {"id": "Mug"})["success"]  # it does not wait for the engine
        with pytest.raises(SimulationTimeoutError):
            stage.ping(timeout_s=0.1)
        assert stage.engine_error is None
        engine.may_log.set()
        assert hub.call_service("/unreal/mindstage/log_world", {}, timeout_s=TIMEOUT_S)["success"]


def test_a_caller_who_names_no_time_hears_of_its_end_from_the_hub(knowledge: KnowledgeBase) -> None:
    engine = SlowEngine()
    with (
        Simulation(knowledge, engine) as stage,
        LocalNode(limits=BridgeLimits(call_timeout_s=0.2)) as hub,
        RosInterface(stage, hub),
        RosbridgeServer(hub, port=0) as server,
    ):
        client = RawClient(server.url)
        answer = client.call_service("/unreal/mindstage/log_world")
        assert answer["result"] is False
        assert "did not answer within 0.2 s" in answer["values"]
        engine.may_log.set()
        assert client.call_service("/unreal/mindstage/describe", timeout=TIMEOUT_S)["result"] is True
        client.close()


def test_spawning_is_given_longer_than_other_calls(face: RosInterface, hub: LocalNode) -> None:
    patience = hub.broker.services.timeouts_s
    assert patience["/unreal/spawn_semantic_map"] >= 60.0
    assert patience["/unreal/mindstage/spawn_world"] >= 60.0
    assert "/unreal/get_model_pose" not in patience


def test_closing_the_face_takes_everything_back(stage: Simulation) -> None:
    with LocalNode() as hub:
        for _ in range(2):
            with RosInterface(stage, hub) as face:
                assert hub.call_service("/unreal/get_model_pose", {"id": "Mug"})["success"]
            face.close()
            left = hub.graph_info()
            assert (left.services, left.actions, left.topics) == ((), (), ())
        assert not [each for each in threading.enumerate() if each.name.startswith("mindstage-ros")]
