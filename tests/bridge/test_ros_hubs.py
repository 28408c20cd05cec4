"""At a rosbridge of ROS that lacks packages, types or rosapi, or that has a short queue of answers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import pytest

from mindstage.bridge import Refusal, RosbridgeClient
from mindstage.engines import NullEngine
from mindstage.knowledge import KnowledgeBase
from mindstage.ros import RosInterface
from mindstage.simulation import Simulation
from tests.bridge.raw_client import TIMEOUT_S, eventually
from tests.bridge.ros_hub import Hub


@pytest.fixture
def make_hub() -> Iterator[Callable[..., Hub]]:
    with ExitStack() as stack:

        def make(**options: Any) -> Hub:
            hub = Hub(**options)
            stack.callback(hub.close)
            return hub

        yield make


def offer(member: RosbridgeClient, number: int = 120) -> list[str]:
    """Offers that many names of each of three packages, in turns; returns the names of those of std_srvs."""
    for at in range(number):
        member.create_service(f"/own/{at}", f"mindstage_msgs/Ask{at}", dict)
        member.create_service(f"/plain/{at}", "std_srvs/Trigger", dict)
        member.advertise(f"/topics/{at}", "simulation_interfaces/msg/Result", latch=at % 2 == 0)
    return [f"/plain/{at}" for at in range(number)]


@pytest.mark.parametrize("rosapi", [True, False], ids=["rosapi", "no rosapi"])
def test_what_needs_a_missing_package_is_left_out_and_all_else_is_there(
    make_hub: Callable[..., Hub], *, rosapi: bool
) -> None:
    hub = make_hub(lacks=("mindstage_msgs/", "simulation_interfaces/"), rosapi=rosapi)
    reported: list[Refusal] = []
    with RosbridgeClient(hub.url, on_refusal=reported.append) as member:
        member.wait_connected(TIMEOUT_S)
        assert member.needs_packages
        plain = offer(member)
        assert member.wait_advertised(TIMEOUT_S * 3)
        assert sorted(hub.advertised) == sorted(plain)
        assert hub.connections == 1
        assert [each.package for each in reported] == ["mindstage_msgs", "simulation_interfaces"]
        assert {(each.operation, each.name) for each in member.refusals} >= {
            *(("advertise_service", f"/own/{at}") for at in range(120)),
            *(("advertise", f"/topics/{at}") for at in range(120)),
        }
        sent = [each["type"].partition("/")[0] for each in hub.received if "type" in each]
        assert sent.count("mindstage_msgs") == sent.count("simulation_interfaces") == 1
        assert not member.has_subscribers("/topics/5")
        assert member.has_rosapi is rosapi


def test_a_type_that_is_missing_in_its_package_is_left_out_alone(make_hub: Callable[..., Hub]) -> None:
    hub = make_hub(lacks=("std_srvs/Future",))
    with RosbridgeClient(hub.url) as member:
        member.create_service("/future", "std_srvs/Future", dict)
        names = [f"/plain/{at}" for at in range(20)]
        for name in names:
            member.create_service(name, "std_srvs/Trigger", dict)
        member.wait_connected(TIMEOUT_S)
        assert member.wait_advertised(TIMEOUT_S)
        assert sorted(hub.advertised) == sorted(names)
        assert [(each.name, each.package) for each in member.refusals] == [("/future", "")]


def test_a_package_of_which_all_is_refused_for_an_unknown_reason_is_missing(make_hub: Callable[..., Hub]) -> None:
    hub = make_hub(lacks=tuple(f"odd_msgs/T{at}" for at in range(9)))
    with RosbridgeClient(hub.url) as member:
        member.wait_connected(TIMEOUT_S)
        for at in range(9):
            member.create_service(f"/odd/{at}", f"odd_msgs/T{at}", dict)
        assert member.wait_advertised(TIMEOUT_S)
        assert len([each for each in hub.received if each["op"] == "advertise_service"]) == 2
        assert len(member.refusals) == 9


def test_a_hub_whose_queue_is_full_gets_smaller_batches(make_hub: Callable[..., Hub]) -> None:
    hub = make_hub(lacks=tuple(f"std_srvs/T{at}" for at in range(1, 40)), places=3)
    with RosbridgeClient(hub.url, on_refusal=lambda _: None, max_reconnect_delay_s=0.5) as member:
        for at in range(40):
            member.create_service(f"/s{at}", f"std_srvs/T{at}", dict)
        eventually(lambda: member.connected and member.wait_advertised(TIMEOUT_S) and member.connected)
        assert "/s0" in hub.advertised
        assert hub.connections <= 4
        first = [each["id"] for each in hub.received if each["op"] == "advertise_service"]
        assert len(set(first)) == 40


def test_a_message_waits_for_its_advertisement_and_says_that_it_is_latched(make_hub: Callable[..., Hub]) -> None:
    hub = make_hub(lacks=("none/",))
    with RosbridgeClient(hub.url, on_refusal=lambda _: None) as member:
        member.wait_connected(TIMEOUT_S)
        offer(member, 20)
        member.advertise("/latched", "std_msgs/msg/String", latch=True)
        member.publish("/latched", "std_msgs/msg/String", {"data": "kept"})
        member.publish("/plain_words", "std_msgs/msg/String", {"data": "first"})
        member.publish("/plain_words", "std_msgs/msg/String", {"data": "second"})
        member.publish("/refused", "none/msg/String", {"data": "never"})
        assert member.wait_advertised(TIMEOUT_S)
        member.publish("/plain_words", "std_msgs/msg/String", {"data": "third"})
        eventually(lambda: [each for each in hub.received if each.get("msg") == {"data": "third"}])
        assert hub.early == []
        messages = [(each["topic"], each["msg"]["data"], each.get("latch")) for each in hub.received if "msg" in each]
        assert messages == [
            ("/latched", "kept", True),
            ("/plain_words", "first", None),
            ("/plain_words", "second", None),
            ("/plain_words", "third", None),
        ]


def test_what_is_withdrawn_before_its_turn_is_not_sent(make_hub: Callable[..., Hub]) -> None:
    hub = make_hub(lacks=("mindstage_msgs/",))
    with RosbridgeClient(hub.url, on_refusal=lambda _: None) as member:
        member.wait_connected(TIMEOUT_S)
        plain = offer(member, 60)
        for name in plain[30:]:
            member.destroy_service(name)
        for at in range(60):
            member.destroy_service(f"/own/{at}")
        assert member.wait_advertised(TIMEOUT_S)
        withdrawn = {each["service"] for each in hub.received if each["op"] == "unadvertise_service"}
        offered = {each["service"] for each in hub.received if each["op"] == "advertise_service"}
        assert offered >= set(plain[:30])
        assert withdrawn <= offered
        assert {each for each in offered - withdrawn if each.startswith("/plain")} == set(plain[:30])


def test_the_own_server_gets_everything_at_once(client: Callable[..., RosbridgeClient]) -> None:
    member = client()
    assert not member.needs_packages
    assert member.wait_advertised(TIMEOUT_S)


def test_a_simulation_is_offered_at_a_hub_without_packages_of_its_own(make_hub: Callable[..., Hub]) -> None:
    own = ("mindstage_msgs/", "world_control_msgs/", "unreal_vis_msgs/", "modul_spawner_msgs/")
    hub = make_hub(lacks=own)
    with (
        Simulation(KnowledgeBase(), NullEngine()) as simulation,
        RosbridgeClient(hub.url, on_refusal=lambda _: None) as member,
        RosInterface(simulation, member.wait_connected(TIMEOUT_S)),
    ):
        eventually(lambda: [each for each in hub.received if each["op"] == "publish" and each["topic"] == "/clock"])
        assert {"/unreal/get_entities", "/unreal/simulate_steps", "/tf", "/clock", "/unreal/world"} <= set(
            hub.advertised
        )
        assert not [each for each in hub.advertised.values() if each["type"].startswith(own)]
        assert sorted({each.package for each in member.refusals}) == sorted(each.rstrip("/") for each in own)
        assert (hub.connections, hub.early) == (1, [])
        polls = [each for each in hub.received if each.get("service") == "/rosapi/subscribers"]
        assert len(polls) < 100
