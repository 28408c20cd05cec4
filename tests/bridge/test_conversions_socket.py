"""Messages and worlds over a socket, sent by a raw client."""

from __future__ import annotations

from collections.abc import Callable

from mindstage.bridge import LocalNode, RosbridgeClient
from mindstage.bridge.conversions import world_from_json, world_to_json
from mindstage.bridge.conversions_unreal import spawn_request, world_from_request
from mindstage.msgs import decode_arguments, encode, mindstage_msgs, world_control_msgs
from mindstage.scene import World
from tests.bridge.raw_client import RawClient
from tests.kitchenette import kitchenette


def test_a_world_is_spawned_over_a_socket(local_node: LocalNode, make_raw_client: Callable[..., RawClient]) -> None:
    spawned: list[World] = []

    def spawn(args: object) -> object:
        request = decode_arguments(world_control_msgs.SpawnSemanticMap.Request, args, strict=True)
        spawned.append(world_from_request(request, iri=kitchenette().iri, name="map")[0])
        return encode(world_control_msgs.SpawnSemanticMap.Response(success=True))

    local_node.create_service("/unreal/spawn_semantic_map", "world_control_msgs/SpawnSemanticMap", spawn)
    caller = make_raw_client()
    answer = caller.call_service("/unreal/spawn_semantic_map", encode(spawn_request(kitchenette())))
    assert answer["values"] == {
        "success": True, "failed_model_ids": [], "failed_constraint_ids": [], "failed_relations": [],
    }  # fmt: skip
    assert spawned[0].bodies == kitchenette().bodies
    refused = caller.call_service("/unreal/spawn_semantic_map", {"models": [], "constraints": []})
    assert refused["result"] is False
    assert "SpawnSemanticMapRequest: relations: it is missing" in refused["values"]


def test_a_world_is_returned_over_a_socket_without_loss(
    local_node: LocalNode, client: Callable[..., RosbridgeClient]
) -> None:
    local_node.create_service(
        "/mindstage/log_world",
        "mindstage_msgs/LogWorld",
        lambda _: encode(mindstage_msgs.LogWorld.Response(success=True, world=world_to_json(kitchenette()))),
    )
    values = client().call_service("/mindstage/log_world")
    reply = decode_arguments(mindstage_msgs.LogWorld.Response, values, strict=True)
    assert world_from_json(reply.world) == kitchenette()
