"""Services at a hub: who answers whom, and that every call gets exactly one answer, in time."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable
from typing import Any

import msgspec
import pytest

from mindstage.bridge import Hub, Limits, Server
from mindstage.errors import (
    BodyUnknown,
    BridgeError,
    ConnectionLost,
    OfferRefused,
    ServiceFailed,
    ServiceTimedOut,
    ServiceUnknown,
)

from .talking import Talker, eventually

Talkers = Callable[..., Talker]


@pytest.fixture(autouse=True)
def settling(hub: Hub) -> None:
    async def settle(_: object) -> None:
        """Answered on the loop, so that it waits for nothing but what came before."""

    hub.offer_service("/settle", "std_srvs/Empty", settle)


def add(args: dict[str, int]) -> dict[str, int]:
    return {"sum": args["a"] + args["b"]}


# -- answered here -----------------------------------------------------------------------------------------------------


def test_a_function_answers_a_client(hub: Hub, talker: Talkers) -> None:
    hub.offer_service("/add", "x/Add", add)
    assert talker().ask("/add", {"a": 1, "b": 2})["values"] == {"sum": 3}


def test_a_coroutine_function_answers_a_client(hub: Hub, talker: Talkers) -> None:
    async def later(args: dict[str, int]) -> dict[str, int]:
        await asyncio.sleep(0)
        return add(args)

    hub.offer_service("/add", "x/Add", later)
    assert talker().ask("/add", {"a": 1, "b": 2})["values"] == {"sum": 3}


def test_a_struct_is_an_answer_and_nothing_is_an_empty_one(hub: Hub, talker: Talkers) -> None:
    class Sum(msgspec.Struct):
        sum: int

    hub.offer_service("/struct", "x/Add", lambda _: Sum(3))
    hub.offer_service("/nothing", "std_srvs/Empty", lambda _: None)
    client = talker()
    assert client.ask("/struct")["values"] == {"sum": 3}
    assert client.ask("/nothing") | {"id": 0} == {
        "op": "service_response", "id": 0, "service": "/nothing", "values": {}, "result": True,
    }  # fmt: skip


def test_arguments_arrive_as_they_were_sent(hub: Hub, talker: Talkers) -> None:
    hub.offer_service("/echo", "x/Echo", lambda args: {"args": args})
    client = talker()
    for args in ({"a": [1, 2.5, None, "é"]}, [1, {"b": 2}], []):
        assert client.ask("/echo", args)["values"] == {"args": args}
    client.say(op="call_service", id=1, service="/echo")
    assert client.hear("service_response", id=1)["values"] == {"args": {}}


def test_names_with_and_without_a_slash_are_one(hub: Hub, talker: Talkers) -> None:
    hub.offer_service("add", "x/Add", add)
    answer = talker().ask("/add", {"a": 1, "b": 1})
    assert answer["service"] == "/add"
    assert hub.call_service("add/", {"a": 1, "b": 2}) == {"sum": 3}


def test_the_worlds_no_is_the_services_own_affair(hub: Hub, talker: Talkers) -> None:
    hub.offer_service("/move", "x/Move", lambda _: {"success": False, "message": "it is bolted down"})
    answer = talker().ask("/move")
    assert answer["result"] is True
    assert answer["values"] == {"success": False, "message": "it is bolted down"}


def test_what_a_handler_raises_is_told(hub: Hub, talker: Talkers, caplog: pytest.LogCaptureFixture) -> None:
    def unknown(_: object) -> None:
        raise BodyUnknown("cupp", known=["cup"])

    async def broken(_: object) -> None:
        raise ZeroDivisionError("by naught")

    hub.offer_service("/unknown", "x/X", unknown)
    hub.offer_service("/broken", "x/X", broken)
    hub.offer_service("/unsayable", "x/X", lambda _: {"it": object()})
    client = talker()
    answer = client.ask("/unknown")
    assert answer["result"] is False
    assert answer["values"] == "no body 'cupp'; near: 'cup'"
    assert client.ask("/broken")["values"] == "/broken broke: ZeroDivisionError: by naught"
    assert client.ask("/unsayable")["values"].startswith("/unsayable broke: TypeError")
    assert "the handler of /broken broke" in caplog.text


def test_a_slow_function_holds_up_neither_others_nor_its_own_clients_actions(hub: Hub, talker: Talkers) -> None:
    release = threading.Event()
    hub.offer_service("/slow", "x/X", lambda _: release.wait(20.0) and None)
    hub.offer_service("/add", "x/Add", add)
    waiting, other = talker(), talker()
    waiting.say(op="call_service", id="slow", service="/slow")
    waiting.settle()
    assert other.ask("/add", {"a": 1, "b": 2})["values"] == {"sum": 3}
    release.set()
    assert waiting.hear("service_response", id="slow")["result"] is True


def test_what_one_client_asks_is_done_in_its_order(hub: Hub, talker: Talkers) -> None:
    done: list[tuple[str, int]] = []

    def note(args: dict[str, Any]) -> None:
        time.sleep(0.0005)
        done.append((args["who"], args["n"]))

    hub.offer_service("/note", "x/Note", note)
    clients = {who: talker() for who in "abc"}
    for n in range(50):
        for who, client in clients.items():
            client.say(op="call_service", id=n, service="/note", args={"who": who, "n": n})
    for client in clients.values():
        assert [client.hear("service_response")["id"] for _ in range(50)] == list(range(50))
    for who in clients:
        assert [n for name, n in done if name == who] == list(range(50))


# -- from this process -------------------------------------------------------------------------------------------------


def test_this_process_calls_itself_and_its_clients(hub: Hub, talker: Talkers) -> None:
    hub.offer_service("/add", "x/Add", add)
    assert hub.call_service("/add", {"a": 1, "b": 2}) == {"sum": 3}
    provider = talker()
    provider.say(op="advertise_service", service="/far", type="x/Far")
    provider.settle()
    future = hub.start_call("/far", {"n": 1})
    call = provider.hear("call_service")
    assert call["args"] == {"n": 1}
    provider.say(op="service_response", id=call["id"], service="/far", values={"m": 2}, result=True)
    assert future.result(20.0) == {"m": 2}


def test_each_way_to_fail_has_its_error(hub: Hub, talker: Talkers) -> None:
    hub.offer_service("/never", "x/X", lambda _: threading.Event().wait(1.0))
    with pytest.raises(ServiceTimedOut, match=r"/never did not answer within 0\.05 s"):
        hub.call_service("/never", timeout_s=0.05)
    with pytest.raises(ServiceUnknown, match="Service /nevr does not exist"):
        hub.call_service("/nevr")
    provider = talker()
    provider.say(op="advertise_service", service="/far", type="x/Far")
    provider.settle()
    failing = hub.start_call("/far")
    id = provider.hear("call_service")["id"]
    provider.say(op="service_response", id=id, service="/far", values="out of paper", result=False)
    with pytest.raises(ServiceFailed, match="/far failed: out of paper"):
        failing.result(20.0)


def test_waiting_on_the_bridges_own_thread_is_refused(hub: Hub, talker: Talkers) -> None:
    async def wait(_: object) -> Any:
        return hub.call_service("/add")

    async def await_(_: object) -> Any:
        return await asyncio.wrap_future(hub.start_call("/add", {"a": 1, "b": 2}))

    hub.offer_service("/add", "x/Add", add)
    hub.offer_service("/wait", "x/X", wait)
    hub.offer_service("/await", "x/X", await_)
    assert "start_call" in talker().ask("/wait")["values"]
    assert hub.call_service("/await") == {"sum": 3}


def test_a_closed_hub_refuses_and_leaves_nobody_waiting(talker: Talkers) -> None:
    hub = Hub()
    forever = threading.Event()
    hub.offer_service("/never", "x/X", lambda _: forever.wait(20.0))
    waiting = hub.start_call("/never")
    hub.close()
    hub.close()
    forever.set()
    with pytest.raises(ConnectionLost, match="it was closed"):
        waiting.result(20.0)
    with pytest.raises(BridgeError, match="closed"):
        hub.call_service("/never")
    with pytest.raises(BridgeError, match="closed"):
        hub.publish("/a", "x/A", {})


# -- from client to client ---------------------------------------------------------------------------------------------


def provide(provider: Talker, service: str = "/far") -> None:
    provider.say(op="advertise_service", service=service, type="x/Far")
    provider.settle()


def test_a_call_reaches_its_provider_and_the_answer_its_caller(talker: Talkers) -> None:
    provider, caller = talker(), talker()
    provide(provider)
    caller.say(op="call_service", id="mine", service="/far", args={"a": 1.50})
    call = provider.hear("call_service")
    assert call["id"] != "mine"
    assert call["service"] == "/far"
    provider.say(op="service_response", id=call["id"], service="/far", values={"b": 2}, result=True)
    answer = caller.hear("service_response")
    assert answer == {"op": "service_response", "id": "mine", "service": "/far", "values": {"b": 2}, "result": True}


def test_a_call_without_an_id_gets_an_answer_without_one(hub: Hub, talker: Talkers) -> None:
    hub.offer_service("/add", "x/Add", add)
    client = talker()
    client.say(op="call_service", service="/add", args={"a": 1, "b": 2})
    assert "id" not in client.hear("service_response", service="/add")


def test_an_unknown_service_is_named_with_those_near_it(hub: Hub, talker: Talkers) -> None:
    hub.offer_service("/unreal/spawn_model", "x/X", add)
    answer = talker().ask("/unreal/spawn_modell")
    assert answer["result"] is False
    assert answer["values"] == "Service /unreal/spawn_modell does not exist; near: '/unreal/spawn_model'"


def test_a_provider_that_dies_answers_its_callers(talker: Talkers) -> None:
    provider, caller = talker(), talker()
    provide(provider)
    for id in range(3):
        caller.say(op="call_service", id=id, service="/far")
    provider.hear("call_service")
    provider.kill()
    for id in range(3):
        answer = caller.hear("service_response", id=id)
        assert answer["result"] is False
        assert answer["values"] == "the provider of /far is gone"
    assert "does not exist" in caller.ask("/far")["values"]


def test_a_provider_that_is_silent_costs_its_caller_the_timeout_and_no_more(talker: Talkers) -> None:
    provider, caller = talker(), talker()
    provide(provider)
    answer = caller.ask("/far", timeout=0.05)
    assert answer["result"] is False
    assert answer["values"] == "/far did not answer within 0.05 s"


def test_late_double_and_foreign_answers_are_dropped_with_a_remark(talker: Talkers) -> None:
    provider, caller, stranger = talker(), talker(), talker()
    provide(provider)
    for client in (provider, stranger):
        client.say(op="set_level", level="warning")
        client.settle()
    caller.say(op="call_service", id="late", service="/far", timeout=0.01)
    late = provider.hear("call_service")["id"]
    caller.hear("service_response", id="late")
    caller.say(op="call_service", id="double", service="/far")
    double = provider.hear("call_service")["id"]
    stranger.say(op="service_response", id=double, service="/far", values={"stolen": 1}, result=True)
    assert "no service call waits" in stranger.hear("status", id=double)["msg"]
    for id in (late, double, double, "made up"):
        provider.say(op="service_response", id=id, service="/far", values={}, result=True)
    for id in (late, double, "made up"):
        assert "no service call waits" in provider.hear("status", id=id)["msg"]
    assert caller.hear("service_response")["values"] == {}
    caller.settle()
    assert not [each for each in caller.heard if each["op"] == "service_response"]


@pytest.mark.parametrize("garbage", ["text", 5, True])
def test_an_answer_that_is_no_object_becomes_an_error(talker: Talkers, garbage: object) -> None:
    provider, caller = talker(), talker()
    provide(provider)
    caller.say(op="call_service", id="mine", service="/far")
    id = provider.hear("call_service")["id"]
    provider.say(op="service_response", id=id, service="/far", values=garbage, result=True)
    assert caller.hear("service_response", id="mine")["values"] == "the answer of /far is no object"
    assert provider.hear("status", id=id)["level"] == "error"


def test_a_malformed_answer_leaves_the_call_open_for_a_good_one(talker: Talkers) -> None:
    provider, caller = talker(), talker()
    provide(provider)
    caller.say(op="call_service", id="mine", service="/far")
    id = provider.hear("call_service")["id"]
    provider.say(op="service_response", id=id, service="/far", result="yes")
    assert "result: Expected `bool`" in provider.hear("status", id=id)["msg"]
    provider.say(op="service_response", id=id, service="/far", values={"good": 1}, result=True)
    assert caller.hear("service_response", id="mine")["values"] == {"good": 1}


def test_a_newcomer_takes_a_clients_offer_over_but_not_the_hubs_own(hub: Hub, talker: Talkers) -> None:
    hub.offer_service("/ours", "x/X", add)
    old, new, caller = talker(), talker(), talker()
    old.say(op="set_level", level="warning")
    provide(old)
    provide(new)
    assert "offers the service /far now" in old.hear("status")["msg"]
    caller.say(op="call_service", id=1, service="/far")
    assert new.hear("call_service")
    new.say(op="advertise_service", id="ad", service="ours", type="x/X")
    assert "is the hub's own" in new.hear("status", id="ad")["msg"]
    old.close()  # whose offer is not its own any more
    new.settle()
    assert caller.ask("/ours", {"a": 1, "b": 2})["values"] == {"sum": 3}
    caller.say(op="call_service", id=2, service="/far")
    assert new.hear("call_service")


def test_an_offer_can_be_made_again_and_withdrawn(hub: Hub, talker: Talkers) -> None:
    hub.offer_service("/add", "x/Add", add)
    hub.offer_service("/add", "x/Add", lambda _: {"sum": 0})
    assert hub.call_service("/add") == {"sum": 0}
    hub.withdraw_service("/add")
    hub.withdraw_service("/add")
    with pytest.raises(ServiceUnknown):
        hub.call_service("/add")
    provider = talker()
    provider.say(op="set_level", level="warning")
    provide(provider)
    provide(provider)
    provider.say(op="unadvertise_service", service="/far")
    provider.settle()
    assert "does not exist" in provider.ask("/far")["values"]
    provider.say(op="unadvertise_service", service="/far")
    assert "was not offered by you" in provider.hear("status")["msg"]


def test_the_hub_cannot_take_what_it_offers_itself_from_itself(hub: Hub) -> None:
    hub.advertise("/a", "std_msgs/String")
    with pytest.raises(OfferRefused, match="'/a' cannot be offered: it is of the type std_msgs/String"):
        hub.advertise("/a", "std_msgs/Bool")


def test_one_client_may_only_have_so_many_calls_and_offers(talker: Talkers) -> None:
    with Hub(limits=Limits(calls=3, offers=2)) as hub, Server(hub, port=0) as server:
        hub.offer_service("/settle", "x/X", lambda _: None)
        provider, caller = talker(server.url), talker(server.url)
        provide(provider)
        provide(provider, "/second")
        provider.say(op="advertise_service", id="ad", service="/third", type="x/X")
        assert "2 offers of one client are enough" in provider.hear("status", id="ad")["msg"]
        for id in range(4):
            caller.say(op="call_service", id=id, service="/far")
        assert caller.hear("service_response")["values"] == "3 of your calls wait already"
        for _ in range(3):
            id = provider.hear("call_service")["id"]
            provider.say(op="service_response", id=id, service="/far", values={}, result=True)
        for _ in range(3):
            assert caller.hear("service_response")["result"] is True
        provider.say(op="unadvertise_service", service="/second")
        provide(provider, "/third")
        assert [each.name for each in hub.directory().services] == ["/far", "/settle", "/third"]


def test_the_directory_tells_who_offers_what(hub: Hub, talker: Talkers) -> None:
    hub.offer_service("/add", "x/Add", add)
    provider = talker()
    provide(provider)
    told = hub.directory()
    me, them = told.peers
    assert [(each.name, each.type, each.provider) for each in told.services] == [
        ("/add", "x/Add", me), ("/far", "x/Far", them), ("/settle", "std_srvs/Empty", me),
    ]  # fmt: skip
    provider.close()
    eventually(lambda: len(hub.directory().peers) == 1)
    assert [each.name for each in hub.directory().services] == ["/add", "/settle"]
