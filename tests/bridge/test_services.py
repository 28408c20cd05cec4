"""Services at a hub: who answers whom, and that every call gets exactly one answer, in time."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable
from typing import Any

import msgspec
import pytest

from mindstage.bridge import BridgeLimits, LocalNode, RosbridgeServer
from mindstage.errors import (
    AdvertiseError,
    BodyNotFoundError,
    BridgeError,
    ConnectionLostError,
    ServiceCallError,
    ServiceNotFoundError,
    ServiceTimeoutError,
)
from tests.bridge.talking import RawClient, eventually

Talkers = Callable[..., RawClient]


@pytest.fixture(autouse=True)
def settling(hub: LocalNode) -> None:
    async def settle(_: object) -> None:
        """Answered on the loop, so that it waits for nothing but what came before."""

    hub.create_service("/settle", "std_srvs/Empty", settle)


def add(args: dict[str, int]) -> dict[str, int]:
    return {"sum": args["a"] + args["b"]}


# -- answered here -----------------------------------------------------------------------------------------------------


def test_a_function_answers_a_client(hub: LocalNode, talker: Talkers) -> None:
    hub.create_service("/add", "x/Add", add)
    assert talker().call_service("/add", {"a": 1, "b": 2})["values"] == {"sum": 3}


def test_a_coroutine_function_answers_a_client(hub: LocalNode, talker: Talkers) -> None:
    async def later(args: dict[str, int]) -> dict[str, int]:
        await asyncio.sleep(0)
        return add(args)

    hub.create_service("/add", "x/Add", later)
    assert talker().call_service("/add", {"a": 1, "b": 2})["values"] == {"sum": 3}


def test_a_struct_is_an_answer_and_nothing_is_an_empty_one(hub: LocalNode, talker: Talkers) -> None:
    class Sum(msgspec.Struct):
        sum: int

    hub.create_service("/struct", "x/Add", lambda _: Sum(3))
    hub.create_service("/nothing", "std_srvs/Empty", lambda _: None)
    client = talker()
    assert client.call_service("/struct")["values"] == {"sum": 3}
    assert client.call_service("/nothing") | {"id": 0} == {
        "op": "service_response", "id": 0, "service": "/nothing", "values": {}, "result": True,
    }  # fmt: skip


def test_arguments_arrive_as_they_were_sent(hub: LocalNode, talker: Talkers) -> None:
    hub.create_service("/echo", "x/Echo", lambda args: {"args": args})
    client = talker()
    for args in ({"a": [1, 2.5, None, "é"]}, [1, {"b": 2}], []):
        assert client.call_service("/echo", args)["values"] == {"args": args}
    client.send_operation(op="call_service", id=1, service="/echo")
    assert client.receive("service_response", id=1)["values"] == {"args": {}}


def test_names_with_and_without_a_slash_are_one(hub: LocalNode, talker: Talkers) -> None:
    hub.create_service("add", "x/Add", add)
    answer = talker().call_service("/add", {"a": 1, "b": 1})
    assert answer["service"] == "/add"
    assert hub.call_service("add/", {"a": 1, "b": 2}) == {"sum": 3}


def test_the_worlds_no_is_the_services_own_affair(hub: LocalNode, talker: Talkers) -> None:
    hub.create_service("/move", "x/Move", lambda _: {"success": False, "message": "it is bolted down"})
    answer = talker().call_service("/move")
    assert answer["result"] is True
    assert answer["values"] == {"success": False, "message": "it is bolted down"}


def test_what_a_handler_raises_is_told(hub: LocalNode, talker: Talkers, caplog: pytest.LogCaptureFixture) -> None:
    def unknown(_: object) -> None:
        raise BodyNotFoundError("cupp", known=["cup"])

    async def broken(_: object) -> None:
        raise ZeroDivisionError("by naught")

    hub.create_service("/unknown", "x/X", unknown)
    hub.create_service("/broken", "x/X", broken)
    hub.create_service("/unsayable", "x/X", lambda _: {"it": object()})
    client = talker()
    answer = client.call_service("/unknown")
    assert answer["result"] is False
    assert answer["values"] == "no body 'cupp'; near: 'cup'"
    assert client.call_service("/broken")["values"] == "/broken broke: ZeroDivisionError: by naught"
    assert client.call_service("/unsayable")["values"].startswith("/unsayable broke: TypeError")
    assert "the handler of /broken broke" in caplog.text


def test_a_slow_function_holds_up_neither_others_nor_its_own_clients_actions(hub: LocalNode, talker: Talkers) -> None:
    release = threading.Event()
    hub.create_service("/slow", "x/X", lambda _: release.wait(20.0) and None)
    hub.create_service("/add", "x/Add", add)
    waiting, other = talker(), talker()
    waiting.send_operation(op="call_service", id="slow", service="/slow")
    waiting.flush()
    assert other.call_service("/add", {"a": 1, "b": 2})["values"] == {"sum": 3}
    release.set()
    assert waiting.receive("service_response", id="slow")["result"] is True


def test_what_one_client_asks_is_done_in_its_order(hub: LocalNode, talker: Talkers) -> None:
    done: list[tuple[str, int]] = []

    def note(args: dict[str, Any]) -> None:
        time.sleep(0.0005)
        done.append((args["who"], args["n"]))

    hub.create_service("/note", "x/Note", note)
    clients = {who: talker() for who in "abc"}
    for n in range(50):
        for who, client in clients.items():
            client.send_operation(op="call_service", id=n, service="/note", args={"who": who, "n": n})
    for client in clients.values():
        assert [client.receive("service_response")["id"] for _ in range(50)] == list(range(50))
    for who in clients:
        assert [n for name, n in done if name == who] == list(range(50))


# -- from this process -------------------------------------------------------------------------------------------------


def test_this_process_calls_itself_and_its_clients(hub: LocalNode, talker: Talkers) -> None:
    hub.create_service("/add", "x/Add", add)
    assert hub.call_service("/add", {"a": 1, "b": 2}) == {"sum": 3}
    provider = talker()
    provider.send_operation(op="advertise_service", service="/far", type="x/Far")
    provider.flush()
    future = hub.call_service_async("/far", {"n": 1})
    call = provider.receive("call_service")
    assert call["args"] == {"n": 1}
    provider.send_operation(op="service_response", id=call["id"], service="/far", values={"m": 2}, result=True)
    assert future.result(20.0) == {"m": 2}


def test_each_way_to_fail_has_its_error(hub: LocalNode, talker: Talkers) -> None:
    hub.create_service("/never", "x/X", lambda _: threading.Event().wait(1.0))
    with pytest.raises(ServiceTimeoutError, match=r"/never did not answer within 0\.05 s"):
        hub.call_service("/never", timeout_s=0.05)
    with pytest.raises(ServiceNotFoundError, match="Service /nevr does not exist"):
        hub.call_service("/nevr")
    provider = talker()
    provider.send_operation(op="advertise_service", service="/far", type="x/Far")
    provider.flush()
    failing = hub.call_service_async("/far")
    id = provider.receive("call_service")["id"]
    provider.send_operation(op="service_response", id=id, service="/far", values="out of paper", result=False)
    with pytest.raises(ServiceCallError, match="/far failed: out of paper"):
        failing.result(20.0)


def test_waiting_on_the_bridges_own_thread_is_refused(hub: LocalNode, talker: Talkers) -> None:
    async def wait(_: object) -> Any:
        return hub.call_service("/add")

    async def await_(_: object) -> Any:
        return await asyncio.wrap_future(hub.call_service_async("/add", {"a": 1, "b": 2}))

    hub.create_service("/add", "x/Add", add)
    hub.create_service("/wait", "x/X", wait)
    hub.create_service("/await", "x/X", await_)
    assert "start_call" in talker().call_service("/wait")["values"]
    assert hub.call_service("/await") == {"sum": 3}


def test_a_closed_hub_refuses_and_leaves_nobody_waiting(talker: Talkers) -> None:
    hub = LocalNode()
    forever = threading.Event()
    hub.create_service("/never", "x/X", lambda _: forever.wait(20.0))
    waiting = hub.call_service_async("/never")
    hub.close()
    hub.close()
    forever.set()
    with pytest.raises(ConnectionLostError, match="it was closed"):
        waiting.result(20.0)
    with pytest.raises(BridgeError, match="closed"):
        hub.call_service("/never")
    with pytest.raises(BridgeError, match="closed"):
        hub.publish("/a", "x/A", {})


# -- from client to client ---------------------------------------------------------------------------------------------


def provide(provider: RawClient, service: str = "/far") -> None:
    provider.send_operation(op="advertise_service", service=service, type="x/Far")
    provider.flush()


def test_a_call_reaches_its_provider_and_the_answer_its_caller(talker: Talkers) -> None:
    provider, caller = talker(), talker()
    provide(provider)
    caller.send_operation(op="call_service", id="mine", service="/far", args={"a": 1.50})
    call = provider.receive("call_service")
    assert call["id"] != "mine"
    assert call["service"] == "/far"
    provider.send_operation(op="service_response", id=call["id"], service="/far", values={"b": 2}, result=True)
    answer = caller.receive("service_response")
    assert answer == {"op": "service_response", "id": "mine", "service": "/far", "values": {"b": 2}, "result": True}


def test_a_call_without_an_id_gets_an_answer_without_one(hub: LocalNode, talker: Talkers) -> None:
    hub.create_service("/add", "x/Add", add)
    client = talker()
    client.send_operation(op="call_service", service="/add", args={"a": 1, "b": 2})
    assert "id" not in client.receive("service_response", service="/add")


def test_an_unknown_service_is_named_with_those_near_it(hub: LocalNode, talker: Talkers) -> None:
    hub.create_service("/unreal/spawn_model", "x/X", add)
    answer = talker().call_service("/unreal/spawn_modell")
    assert answer["result"] is False
    assert answer["values"] == "Service /unreal/spawn_modell does not exist; near: '/unreal/spawn_model'"


def test_a_provider_that_dies_answers_its_callers(talker: Talkers) -> None:
    provider, caller = talker(), talker()
    provide(provider)
    for id in range(3):
        caller.send_operation(op="call_service", id=id, service="/far")
    provider.receive("call_service")
    provider.kill()
    for id in range(3):
        answer = caller.receive("service_response", id=id)
        assert answer["result"] is False
        assert answer["values"] == "the provider of /far is gone"
    assert "does not exist" in caller.call_service("/far")["values"]


def test_a_provider_that_is_silent_costs_its_caller_the_timeout_and_no_more(talker: Talkers) -> None:
    provider, caller = talker(), talker()
    provide(provider)
    answer = caller.call_service("/far", timeout=0.05)
    assert answer["result"] is False
    assert answer["values"] == "/far did not answer within 0.05 s"


def test_late_double_and_foreign_answers_are_dropped_with_a_remark(talker: Talkers) -> None:
    provider, caller, stranger = talker(), talker(), talker()
    provide(provider)
    for client in (provider, stranger):
        client.send_operation(op="set_level", level="warning")
        client.flush()
    caller.send_operation(op="call_service", id="late", service="/far", timeout=0.01)
    late = provider.receive("call_service")["id"]
    caller.receive("service_response", id="late")
    caller.send_operation(op="call_service", id="double", service="/far")
    double = provider.receive("call_service")["id"]
    stranger.send_operation(op="service_response", id=double, service="/far", values={"stolen": 1}, result=True)
    assert "no service call waits" in stranger.receive("status", id=double)["msg"]
    for id in (late, double, double, "made up"):
        provider.send_operation(op="service_response", id=id, service="/far", values={}, result=True)
    for id in (late, double, "made up"):
        assert "no service call waits" in provider.receive("status", id=id)["msg"]
    assert caller.receive("service_response")["values"] == {}
    caller.flush()
    assert not [each for each in caller.received if each["op"] == "service_response"]


@pytest.mark.parametrize("garbage", ["text", 5, True])
def test_an_answer_that_is_no_object_becomes_an_error(talker: Talkers, garbage: object) -> None:
    provider, caller = talker(), talker()
    provide(provider)
    caller.send_operation(op="call_service", id="mine", service="/far")
    id = provider.receive("call_service")["id"]
    provider.send_operation(op="service_response", id=id, service="/far", values=garbage, result=True)
    assert caller.receive("service_response", id="mine")["values"] == "the answer of /far is no object"
    assert provider.receive("status", id=id)["level"] == "error"


def test_a_malformed_answer_leaves_the_call_open_for_a_good_one(talker: Talkers) -> None:
    provider, caller = talker(), talker()
    provide(provider)
    caller.send_operation(op="call_service", id="mine", service="/far")
    id = provider.receive("call_service")["id"]
    provider.send_operation(op="service_response", id=id, service="/far", result="yes")
    assert "result: Expected `bool`" in provider.receive("status", id=id)["msg"]
    provider.send_operation(op="service_response", id=id, service="/far", values={"good": 1}, result=True)
    assert caller.receive("service_response", id="mine")["values"] == {"good": 1}


def test_a_newcomer_takes_a_clients_offer_over_but_not_the_hubs_own(hub: LocalNode, talker: Talkers) -> None:
    hub.create_service("/ours", "x/X", add)
    old, new, caller = talker(), talker(), talker()
    old.send_operation(op="set_level", level="warning")
    provide(old)
    provide(new)
    assert "offers the service /far now" in old.receive("status")["msg"]
    caller.send_operation(op="call_service", id=1, service="/far")
    assert new.receive("call_service")
    new.send_operation(op="advertise_service", id="ad", service="ours", type="x/X")
    assert "is the hub's own" in new.receive("status", id="ad")["msg"]
    old.close()  # whose offer is not its own any more
    new.flush()
    assert caller.call_service("/ours", {"a": 1, "b": 2})["values"] == {"sum": 3}
    caller.send_operation(op="call_service", id=2, service="/far")
    assert new.receive("call_service")


def test_an_offer_can_be_made_again_and_withdrawn(hub: LocalNode, talker: Talkers) -> None:
    hub.create_service("/add", "x/Add", add)
    hub.create_service("/add", "x/Add", lambda _: {"sum": 0})
    assert hub.call_service("/add") == {"sum": 0}
    hub.destroy_service("/add")
    hub.destroy_service("/add")
    with pytest.raises(ServiceNotFoundError):
        hub.call_service("/add")
    provider = talker()
    provider.send_operation(op="set_level", level="warning")
    provide(provider)
    provide(provider)
    provider.send_operation(op="unadvertise_service", service="/far")
    provider.flush()
    assert "does not exist" in provider.call_service("/far")["values"]
    provider.send_operation(op="unadvertise_service", service="/far")
    assert "was not offered by you" in provider.receive("status")["msg"]


def test_the_hub_cannot_take_what_it_offers_itself_from_itself(hub: LocalNode) -> None:
    hub.advertise("/a", "std_msgs/String")
    with pytest.raises(AdvertiseError, match="'/a' cannot be advertised: it is of the type std_msgs/String"):
        hub.advertise("/a", "std_msgs/Bool")


def test_one_client_may_only_have_so_many_calls_and_offers(talker: Talkers) -> None:
    with LocalNode(limits=BridgeLimits(calls=3, advertisements=2)) as hub, RosbridgeServer(hub, port=0) as server:
        hub.create_service("/settle", "x/X", lambda _: None)
        provider, caller = talker(server.url), talker(server.url)
        provide(provider)
        provide(provider, "/second")
        provider.send_operation(op="advertise_service", id="ad", service="/third", type="x/X")
        assert "2 offers of one client are enough" in provider.receive("status", id="ad")["msg"]
        for id in range(4):
            caller.send_operation(op="call_service", id=id, service="/far")
        assert caller.receive("service_response")["values"] == "3 of your calls wait already"
        for _ in range(3):
            id = provider.receive("call_service")["id"]
            provider.send_operation(op="service_response", id=id, service="/far", values={}, result=True)
        for _ in range(3):
            assert caller.receive("service_response")["result"] is True
        provider.send_operation(op="unadvertise_service", service="/second")
        provide(provider, "/third")
        assert [each.name for each in hub.graph_info().services] == ["/far", "/settle", "/third"]


def test_the_directory_tells_who_offers_what(hub: LocalNode, talker: Talkers) -> None:
    hub.create_service("/add", "x/Add", add)
    provider = talker()
    provide(provider)
    told = hub.graph_info()
    me, them = told.peers
    assert [(each.name, each.type, each.provider) for each in told.services] == [
        ("/add", "x/Add", me), ("/far", "x/Far", them), ("/settle", "std_srvs/Empty", me),
    ]  # fmt: skip
    provider.close()
    eventually(lambda: len(hub.graph_info().peers) == 1)
    assert [each.name for each in hub.graph_info().services] == ["/add", "/settle"]
