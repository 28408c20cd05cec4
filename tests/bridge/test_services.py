"""Services: routing of calls, and exactly one response to each call, in time."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable
from typing import Any

import msgspec
import pytest

from mindstage.access.limits import BridgeLimits
from mindstage.bridge import LocalNode, RosbridgeServer
from mindstage.errors import (
    AdvertiseError,
    BodyNotFoundError,
    BridgeError,
    ConnectionLostError,
    ServiceCallError,
    ServiceNotFoundError,
    ServiceTimeoutError,
)
from tests.bridge.raw_client import RawClient, eventually

RawClientFactory = Callable[..., RawClient]


@pytest.fixture(autouse=True)
def settling(local_node: LocalNode) -> None:
    async def settle(_: object) -> None:
        """Runs on the loop, so that it waits for earlier messages only."""

    local_node.create_service("/settle", "std_srvs/Empty", settle)


def add(args: dict[str, int]) -> dict[str, int]:
    return {"sum": args["a"] + args["b"]}


# -- answered here -----------------------------------------------------------------------------------------------------


def test_a_function_handles_a_call(local_node: LocalNode, make_raw_client: RawClientFactory) -> None:
    local_node.create_service("/add", "x/Add", add)
    assert make_raw_client().call_service("/add", {"a": 1, "b": 2})["values"] == {"sum": 3}


def test_a_coroutine_function_handles_a_call(local_node: LocalNode, make_raw_client: RawClientFactory) -> None:
    async def later(args: dict[str, int]) -> dict[str, int]:
        await asyncio.sleep(0)
        return add(args)

    local_node.create_service("/add", "x/Add", later)
    assert make_raw_client().call_service("/add", {"a": 1, "b": 2})["values"] == {"sum": 3}


def test_a_handler_may_return_a_struct_or_none(local_node: LocalNode, make_raw_client: RawClientFactory) -> None:
    class Sum(msgspec.Struct):
        sum: int

    local_node.create_service("/struct", "x/Add", lambda _: Sum(3))
    local_node.create_service("/nothing", "std_srvs/Empty", lambda _: None)
    client = make_raw_client()
    assert client.call_service("/struct")["values"] == {"sum": 3}
    assert client.call_service("/nothing") | {"id": 0} == {
        "op": "service_response", "id": 0, "service": "/nothing", "values": {}, "result": True,
    }  # fmt: skip


def test_arguments_arrive_as_they_were_sent(local_node: LocalNode, make_raw_client: RawClientFactory) -> None:
    local_node.create_service("/echo", "x/Echo", lambda args: {"args": args})
    client = make_raw_client()
    for args in ({"a": [1, 2.5, None, "é"]}, [1, {"b": 2}], []):
        assert client.call_service("/echo", args)["values"] == {"args": args}
    client.send_operation(op="call_service", id=1, service="/echo")
    assert client.receive("service_response", id=1)["values"] == {"args": {}}


def test_names_with_and_without_a_slash_are_equal(local_node: LocalNode, make_raw_client: RawClientFactory) -> None:
    local_node.create_service("add", "x/Add", add)
    answer = make_raw_client().call_service("/add", {"a": 1, "b": 1})
    assert answer["service"] == "/add"
    assert local_node.call_service("add/", {"a": 1, "b": 2}) == {"sum": 3}


def test_a_response_with_success_false_is_not_an_error(
    local_node: LocalNode, make_raw_client: RawClientFactory
) -> None:
    local_node.create_service("/move", "x/Move", lambda _: {"success": False, "message": "it is bolted down"})
    answer = make_raw_client().call_service("/move")
    assert answer["result"] is True
    assert answer["values"] == {"success": False, "message": "it is bolted down"}


def test_an_exception_of_a_handler_is_an_error_response(
    local_node: LocalNode, make_raw_client: RawClientFactory, caplog: pytest.LogCaptureFixture
) -> None:
    def unknown(_: object) -> None:
        raise BodyNotFoundError("cupp", known=["cup"])

    async def broken(_: object) -> None:
        raise ZeroDivisionError("by naught")

    local_node.create_service("/unknown", "x/X", unknown)
    local_node.create_service("/broken", "x/X", broken)
    local_node.create_service("/unsayable", "x/X", lambda _: {"it": object()})
    client = make_raw_client()
    answer = client.call_service("/unknown")
    assert answer["result"] is False
    assert answer["values"] == "no body 'cupp'; near: 'cup'"
    assert client.call_service("/broken")["values"] == "/broken failed: ZeroDivisionError: by naught"
    assert client.call_service("/unsayable")["values"].startswith("/unsayable failed: TypeError")
    assert "the handler of /broken failed" in caplog.text


def test_a_slow_handler_does_not_block_others(local_node: LocalNode, make_raw_client: RawClientFactory) -> None:
    release = threading.Event()
    local_node.create_service("/slow", "x/X", lambda _: release.wait(20.0) and None)
    local_node.create_service("/add", "x/Add", add)
    waiting, other = make_raw_client(), make_raw_client()
    waiting.send_operation(op="call_service", id="slow", service="/slow")
    waiting.flush()
    assert other.call_service("/add", {"a": 1, "b": 2})["values"] == {"sum": 3}
    release.set()
    assert waiting.receive("service_response", id="slow")["result"] is True


def test_calls_of_one_client_are_handled_in_order(local_node: LocalNode, make_raw_client: RawClientFactory) -> None:
    done: list[tuple[str, int]] = []

    def note(args: dict[str, Any]) -> None:
        time.sleep(0.0005)
        done.append((args["who"], args["n"]))

    local_node.create_service("/note", "x/Note", note)
    clients = {who: make_raw_client() for who in "abc"}
    for n in range(50):
        for who, client in clients.items():
            client.send_operation(op="call_service", id=n, service="/note", args={"who": who, "n": n})
    for client in clients.values():
        assert [client.receive("service_response")["id"] for _ in range(50)] == list(range(50))
    for who in clients:
        assert [n for name, n in done if name == who] == list(range(50))


# -- from this process -------------------------------------------------------------------------------------------------


def test_a_local_node_calls_its_own_services_and_those_of_clients(
    local_node: LocalNode, make_raw_client: RawClientFactory
) -> None:
    local_node.create_service("/add", "x/Add", add)
    assert local_node.call_service("/add", {"a": 1, "b": 2}) == {"sum": 3}
    provider = make_raw_client()
    provider.send_operation(op="advertise_service", service="/far", type="x/Far")
    provider.flush()
    future = local_node.call_service_async("/far", {"n": 1})
    call = provider.receive("call_service")
    assert call["args"] == {"n": 1}
    provider.send_operation(op="service_response", id=call["id"], service="/far", values={"m": 2}, result=True)
    assert future.result(20.0) == {"m": 2}


def test_each_failure_raises_its_error(local_node: LocalNode, make_raw_client: RawClientFactory) -> None:
    local_node.create_service("/never", "x/X", lambda _: threading.Event().wait(1.0))
    with pytest.raises(ServiceTimeoutError, match=r"/never did not answer within 0\.05 s"):
        local_node.call_service("/never", timeout_s=0.05)
    with pytest.raises(ServiceNotFoundError, match="Service /nevr does not exist"):
        local_node.call_service("/nevr")
    provider = make_raw_client()
    provider.send_operation(op="advertise_service", service="/far", type="x/Far")
    provider.flush()
    failing = local_node.call_service_async("/far")
    id = provider.receive("call_service")["id"]
    provider.send_operation(op="service_response", id=id, service="/far", values="out of paper", result=False)
    with pytest.raises(ServiceCallError, match="/far failed: out of paper"):
        failing.result(20.0)


def test_waiting_on_the_bridges_own_thread_is_an_error(
    local_node: LocalNode, make_raw_client: RawClientFactory
) -> None:
    async def wait(_: object) -> Any:
        return local_node.call_service("/add")

    async def await_(_: object) -> Any:
        return await asyncio.wrap_future(local_node.call_service_async("/add", {"a": 1, "b": 2}))

    local_node.create_service("/add", "x/Add", add)
    local_node.create_service("/wait", "x/X", wait)
    local_node.create_service("/await", "x/X", await_)
    assert "call_service_async" in make_raw_client().call_service("/wait")["values"]
    assert local_node.call_service("/await") == {"sum": 3}


def test_closing_a_node_fails_pending_calls(make_raw_client: RawClientFactory) -> None:
    local_node = LocalNode()
    forever = threading.Event()
    local_node.create_service("/never", "x/X", lambda _: forever.wait(20.0))
    waiting = local_node.call_service_async("/never")
    local_node.close()
    local_node.close()
    forever.set()
    with pytest.raises(ConnectionLostError, match="it was closed"):
        waiting.result(20.0)
    with pytest.raises(BridgeError, match="closed"):
        local_node.call_service("/never")
    with pytest.raises(BridgeError, match="closed"):
        local_node.publish("/a", "x/A", {})


# -- from client to client ---------------------------------------------------------------------------------------------


def provide(provider: RawClient, service: str = "/far") -> None:
    provider.send_operation(op="advertise_service", service=service, type="x/Far")
    provider.flush()


def test_a_call_and_its_response_are_forwarded(make_raw_client: RawClientFactory) -> None:
    provider, caller = make_raw_client(), make_raw_client()
    provide(provider)
    caller.send_operation(op="call_service", id="mine", service="/far", args={"a": 1.50})
    call = provider.receive("call_service")
    assert call["id"] != "mine"
    assert call["service"] == "/far"
    provider.send_operation(op="service_response", id=call["id"], service="/far", values={"b": 2}, result=True)
    answer = caller.receive("service_response")
    assert answer == {"op": "service_response", "id": "mine", "service": "/far", "values": {"b": 2}, "result": True}


def test_a_call_without_an_id_gets_a_response_without_one(
    local_node: LocalNode, make_raw_client: RawClientFactory
) -> None:
    local_node.create_service("/add", "x/Add", add)
    client = make_raw_client()
    client.send_operation(op="call_service", service="/add", args={"a": 1, "b": 2})
    assert "id" not in client.receive("service_response", service="/add")


def test_an_unknown_service_is_named_with_similar_names(
    local_node: LocalNode, make_raw_client: RawClientFactory
) -> None:
    local_node.create_service("/unreal/spawn_model", "x/X", add)
    answer = make_raw_client().call_service("/unreal/spawn_modell")
    assert answer["result"] is False
    assert answer["values"] == "Service /unreal/spawn_modell does not exist; near: '/unreal/spawn_model'"


def test_calls_to_a_disconnected_provider_fail(make_raw_client: RawClientFactory) -> None:
    provider, caller = make_raw_client(), make_raw_client()
    provide(provider)
    for id in range(3):
        caller.send_operation(op="call_service", id=id, service="/far")
    provider.receive("call_service")
    provider.kill()
    for id in range(3):
        answer = caller.receive("service_response", id=id)
        assert answer["result"] is False
        assert answer["values"] == "the provider of /far disconnected"
    assert "does not exist" in caller.call_service("/far")["values"]


def test_a_call_without_a_response_times_out(make_raw_client: RawClientFactory) -> None:
    provider, caller = make_raw_client(), make_raw_client()
    provide(provider)
    answer = caller.call_service("/far", timeout=0.05)
    assert answer["result"] is False
    assert answer["values"] == "/far did not answer within 0.05 s"


def test_late_duplicate_and_foreign_responses_are_dropped_with_a_status(make_raw_client: RawClientFactory) -> None:
    provider, caller, other_client = make_raw_client(), make_raw_client(), make_raw_client()
    provide(provider)
    for client in (provider, other_client):
        client.send_operation(op="set_level", level="warning")
        client.flush()
    caller.send_operation(op="call_service", id="late", service="/far", timeout=0.01)
    late = provider.receive("call_service")["id"]
    caller.receive("service_response", id="late")
    caller.send_operation(op="call_service", id="double", service="/far")
    double = provider.receive("call_service")["id"]
    other_client.send_operation(op="service_response", id=double, service="/far", values={"stolen": 1}, result=True)
    assert "no pending service request" in other_client.receive("status", id=double)["msg"]
    for id in (late, double, double, "made up"):
        provider.send_operation(op="service_response", id=id, service="/far", values={}, result=True)
    for id in (late, double, "made up"):
        assert "no pending service request" in provider.receive("status", id=id)["msg"]
    assert caller.receive("service_response")["values"] == {}
    caller.flush()
    assert not [each for each in caller.received if each["op"] == "service_response"]


@pytest.mark.parametrize("garbage", ["text", 5, True])
def test_a_response_that_is_not_an_object_becomes_an_error(make_raw_client: RawClientFactory, garbage: object) -> None:
    provider, caller = make_raw_client(), make_raw_client()
    provide(provider)
    caller.send_operation(op="call_service", id="mine", service="/far")
    id = provider.receive("call_service")["id"]
    provider.send_operation(op="service_response", id=id, service="/far", values=garbage, result=True)
    assert caller.receive("service_response", id="mine")["values"] == "the response of /far is not an object"
    assert provider.receive("status", id=id)["level"] == "error"


def test_a_malformed_response_leaves_the_call_pending(make_raw_client: RawClientFactory) -> None:
    provider, caller = make_raw_client(), make_raw_client()
    provide(provider)
    caller.send_operation(op="call_service", id="mine", service="/far")
    id = provider.receive("call_service")["id"]
    provider.send_operation(op="service_response", id=id, service="/far", result="yes")
    assert "result: Expected `bool`" in provider.receive("status", id=id)["msg"]
    provider.send_operation(op="service_response", id=id, service="/far", values={"good": 1}, result=True)
    assert caller.receive("service_response", id="mine")["values"] == {"good": 1}


def test_a_client_can_replace_the_service_of_a_client_but_not_of_the_local_node(
    local_node: LocalNode, make_raw_client: RawClientFactory
) -> None:
    local_node.create_service("/ours", "x/X", add)
    old, new, caller = make_raw_client(), make_raw_client(), make_raw_client()
    old.send_operation(op="set_level", level="warning")
    provide(old)
    provide(new)
    assert "is now the provider of the service /far" in old.receive("status")["msg"]
    caller.send_operation(op="call_service", id=1, service="/far")
    assert new.receive("call_service")
    new.send_operation(op="advertise_service", id="ad", service="ours", type="x/X")
    assert "belongs to the local node" in new.receive("status", id="ad")["msg"]
    old.close()  # its service was replaced before
    new.flush()
    assert caller.call_service("/ours", {"a": 1, "b": 2})["values"] == {"sum": 3}
    caller.send_operation(op="call_service", id=2, service="/far")
    assert new.receive("call_service")


def test_a_service_can_be_advertised_again_and_withdrawn(
    local_node: LocalNode, make_raw_client: RawClientFactory
) -> None:
    local_node.create_service("/add", "x/Add", add)
    local_node.create_service("/add", "x/Add", lambda _: {"sum": 0})
    assert local_node.call_service("/add") == {"sum": 0}
    local_node.destroy_service("/add")
    local_node.destroy_service("/add")
    with pytest.raises(ServiceNotFoundError):
        local_node.call_service("/add")
    provider = make_raw_client()
    provider.send_operation(op="set_level", level="warning")
    provide(provider)
    provide(provider)
    provider.send_operation(op="unadvertise_service", service="/far")
    provider.flush()
    assert "does not exist" in provider.call_service("/far")["values"]
    provider.send_operation(op="unadvertise_service", service="/far")
    assert "you did not advertise the" in provider.receive("status")["msg"]


def test_a_local_node_cannot_advertise_another_type(local_node: LocalNode) -> None:
    local_node.advertise("/a", "std_msgs/String")
    with pytest.raises(AdvertiseError, match="'/a' cannot be advertised: its type is std_msgs/String"):
        local_node.advertise("/a", "std_msgs/Bool")


def test_calls_and_advertisements_of_a_client_are_limited(make_raw_client: RawClientFactory) -> None:
    with (
        LocalNode(limits=BridgeLimits(calls=3, advertisements=2)) as local_node,
        RosbridgeServer(local_node, port=0) as server,
    ):
        local_node.create_service("/settle", "x/X", lambda _: None)
        provider, caller = make_raw_client(server.url), make_raw_client(server.url)
        provide(provider)
        provide(provider, "/second")
        provider.send_operation(op="advertise_service", id="ad", service="/third", type="x/X")
        assert "a client has at most 2 advertisements" in provider.receive("status", id="ad")["msg"]
        for id in range(4):
            caller.send_operation(op="call_service", id=id, service="/far")
        assert caller.receive("service_response")["values"] == "you have 3 pending calls already"
        for _ in range(3):
            id = provider.receive("call_service")["id"]
            provider.send_operation(op="service_response", id=id, service="/far", values={}, result=True)
        for _ in range(3):
            assert caller.receive("service_response")["result"] is True
        provider.send_operation(op="unadvertise_service", service="/second")
        provide(provider, "/third")
        assert [each.name for each in local_node.graph_info().services] == ["/far", "/settle", "/third"]


def test_the_graph_lists_services_and_their_providers(local_node: LocalNode, make_raw_client: RawClientFactory) -> None:
    local_node.create_service("/add", "x/Add", add)
    provider = make_raw_client()
    provide(provider)
    graph = local_node.graph_info()
    me, them = graph.peers
    assert [(each.name, each.type, each.provider) for each in graph.services] == [
        ("/add", "x/Add", me), ("/far", "x/Far", them), ("/settle", "std_srvs/Empty", me),
    ]  # fmt: skip
    provider.close()
    eventually(lambda: len(local_node.graph_info().peers) == 1)
    assert [each.name for each in local_node.graph_info().services] == ["/add", "/settle"]


def test_a_number_that_no_float_can_hold_is_refused_and_other_calls_are_answered(
    local_node: LocalNode, make_raw_client: RawClientFactory, caplog: pytest.LogCaptureFixture
) -> None:
    local_node.create_service("/add", "x/Add", add)
    client = make_raw_client()
    call = '{"op": "call_service", "id": "%s", "service": "/add", "args": {"a": %s, "b": 1}}'
    for id, number in (("first", "1"), ("huge", "1e999"), ("last", "2")):
        client.send(call % (id, number))
    assert client.receive("service_response", id="first")["values"] == {"sum": 2}
    refused = client.receive("service_response", id="huge")
    assert refused["result"] is False
    assert "out of range" in str(refused["values"])
    assert client.receive("service_response", id="last")["values"] == {"sum": 3}
    assert not [each for each in caplog.records if each.levelname == "ERROR"]
