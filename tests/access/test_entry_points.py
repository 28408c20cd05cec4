"""Every entry point of the running servers has a policy, which is applied; a handler without one is found.

The list of entry points comes from the running servers: paths of the page and its websockets, methods of the page,
operations of the rosbridge, and the services, actions and subscribed topics that its broker has at that time.
"""

from __future__ import annotations

import re
import threading
from collections.abc import Iterator
from contextlib import closing
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

import msgspec
import pytest
from msgspec.structs import force_setattr

from mindstage import KnowledgeBase, NullEngine, Simulation
from mindstage.access.gate import Gate
from mindstage.access.limits import CONTROL_BYTES, EDIT_BYTES, FILE_BYTES, FILE_TIME, MESSAGE_BYTES, PLAIN_BYTES
from mindstage.access.policies import EDIT, Cost, EntryKind, EntryPoint
from mindstage.access.resources import from_outside
from mindstage.bridge import LocalNode
from mindstage.bridge.protocol import Status
from mindstage.prolog import PrologConsole
from mindstage.viewer.http import RequestFilter, Route
from mindstage.viewer.server import EmptyRequest, RpcChannel
from tests.access.conftest import TOKEN, Served
from tests.access.private_checks import private_checks
from tests.bridge.raw_client import TIMEOUT_S, RawClient
from tests.kitchenette import kitchenette
from tests.viewer.page_client import RequestFailedError, connect_page_client

SMALL = 3000
PADDING = "x" * (SMALL + 1000)
FOREIGN = "http://evil.example"
ELSEWHERE = ("127.0.0.7", 0)
"""An address of this machine that counts as another one while `is_loopback` is replaced."""
BEARER = {"Authorization": f"Bearer {TOKEN}"}


def undeclared(entries: tuple[EntryPoint, ...]) -> list[str]:
    return [f"{entry.kind}: {entry.name}" for entry in entries if entry.policy is None]


def names(served: Served, kind: EntryKind, *costs: Cost) -> list[str]:
    found = [e.name for e in served.entry_points() if e.kind is kind and e.policy is not None]
    costly = {e.name for e in served.entry_points() if e.kind is kind and e.policy and e.policy.cost in costs}
    return sorted({name for name in found if not costs or name in costly})


@pytest.fixture
def small_limits() -> Iterator[None]:
    """Limits of the table that are so small that requests beyond them can be sent to every entry point."""
    limits = (CONTROL_BYTES, EDIT_BYTES, FILE_BYTES, PLAIN_BYTES)
    before = [limit.maximum for limit in limits]
    for limit in limits:
        force_setattr(limit, "maximum", SMALL)
    yield
    for limit, maximum in zip(limits, before, strict=True):
        force_setattr(limit, "maximum", maximum)


@pytest.fixture
def client(served: Served) -> Iterator[RawClient]:
    with closing(RawClient(f"{served.rosbridge.url}/?token={TOKEN}")) as client:
        yield client


def page_status(served: Served, path: str, **headers: str) -> int:
    connection = HTTPConnection(served.viewer.url.removeprefix("http://"), timeout=TIMEOUT_S)
    with closing(connection):
        connection.request("GET", path, headers=headers)
        return connection.getresponse().status


def handshake_status(url: str, path: str, **headers: str) -> int:
    address = url.partition("://")[2].partition("/")[0]
    sent = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13"}
    with closing(HTTPConnection(address, timeout=TIMEOUT_S)) as connection:
        connection.request("GET", path, headers=sent | {"Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ=="} | headers)
        return connection.getresponse().status


PAGE_PATHS = {
    "/": "/",
    "/view/KEY": "/view/0123456789abcdef",
    "/mindstage/FILE": "/mindstage/index.html",
    "/mindstage/textures/NAME.jpg": "/mindstage/textures/oak-color-0123456789ab.jpg",
    "/mindstage/channel": "/mindstage/channel?client=0123456789abcdef",
}


def sockets(served: Served) -> list[tuple[str, str]]:
    """URL and path of each websocket of each port."""
    page = [(served.viewer.url, PAGE_PATHS[name]) for name in names(served, EntryKind.SOCKET)]
    return [*page, (served.rosbridge.url, "/"), (served.shell.url, "/")]


# -- what there is -----------------------------------------------------------------------------------------------------


def test_every_entry_point_of_the_running_servers_has_a_policy(served: Served) -> None:
    assert undeclared(served.entry_points()) == []


def test_the_list_has_what_the_servers_say_that_they_have(served: Served, client: RawClient) -> None:
    listed = {kind: set(names(served, kind)) for kind in EntryKind}
    assert set(client.call_service("/rosapi/services")["values"]["services"]) <= listed[EntryKind.SERVICE]
    assert {"/mindstage/ask", "/mindstage/query", "/unreal/spawn_entity"} <= listed[EntryKind.SERVICE]
    assert "/unreal/mindstage/evaluate_plan" in listed[EntryKind.ACTION]
    assert {"/unreal/highlight", "/unreal/markers"} <= listed[EntryKind.TOPIC]
    assert any(name.endswith("follow_joint_trajectory/goal") for name in listed[EntryKind.TOPIC])
    assert {"ask", "ask.prolog", "ask.sparql", "add", "drop", "load", "save", "timeline.seek"} <= listed[
        EntryKind.METHOD
    ]
    assert {"publish", "call_service", "send_action_goal", "subscribe"} <= listed[EntryKind.OPERATION]
    assert listed[EntryKind.ROUTE] | listed[EntryKind.SOCKET] == set(PAGE_PATHS)


# -- how much ----------------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("small_limits")
def test_every_service_refuses_a_request_that_is_too_large(served: Served, client: RawClient) -> None:
    for name in names(served, EntryKind.SERVICE):
        response = client.call_service(name, {"padding": PADDING})
        assert not response["result"], name
        assert "bytes" in str(response["values"]), (name, response)


@pytest.mark.usefixtures("small_limits")
def test_every_action_refuses_a_goal_that_is_too_large(served: Served, client: RawClient) -> None:
    for name in names(served, EntryKind.ACTION):
        client.send_operation(op="send_action_goal", id=name, action=name, action_type="x/Y", args={"padding": PADDING})
        result = client.receive("action_result", id=name)
        assert not result["result"], name
        assert "bytes" in str(result["values"]), (name, result)


@pytest.mark.usefixtures("small_limits")
def test_every_topic_refuses_a_message_that_is_too_large(served: Served, client: RawClient) -> None:
    for name in names(served, EntryKind.TOPIC):
        type = client.call_service("/rosapi/topic_type", {"topic": name})["values"]["type"]
        client.send_operation(op="advertise", topic=name, type=type or "geometry_msgs/Twist")
        client.send(f'{{"op": "publish", "topic": "{name}", "msg": {{{" " * len(PADDING)}}}}}')
        status = client.receive("status")["msg"]
        assert status.startswith(f"{name}: "), status
        assert "bytes" in status, status


@pytest.mark.usefixtures("small_limits")
def test_every_operation_refuses_a_message_that_is_too_large(served: Served, client: RawClient) -> None:
    before = MESSAGE_BYTES.maximum
    force_setattr(MESSAGE_BYTES, "maximum", SMALL)
    try:
        for name in names(served, EntryKind.OPERATION):
            fields = dict.fromkeys(("topic", "service", "action", "type", "action_type"), "/x") | {"id": name}
            others: dict[str, Any] = {"msg": {}, "result": True, "status": 4, "level": "error", "padding": PADDING}
            client.send_operation(op=name, **fields, **others)
            assert "bytes" in client.receive("status", id=name)["msg"], name
    finally:
        force_setattr(MESSAGE_BYTES, "maximum", before)


@pytest.mark.usefixtures("small_limits")
def test_every_method_of_the_page_refuses_a_request_that_is_too_large(served: Served) -> None:
    for viewer in (served.viewer, served.replay):
        with connect_page_client(viewer.url, headers=BEARER) as page:
            for name in {each.name for each in viewer.entry_points() if each.kind is EntryKind.METHOD}:
                with pytest.raises(RequestFailedError, match=r"RequestLimitError.*bytes"):
                    page.ask(name, padding=PADDING)


@pytest.mark.usefixtures("small_limits")
def test_every_path_of_the_page_refuses_a_request_that_is_too_large(served: Served) -> None:
    for name in names(served, EntryKind.ROUTE):
        path = f"{PAGE_PATHS[name]}?x={PADDING}"
        assert page_status(served, path, **BEARER) == 429, name
    for name in names(served, EntryKind.SOCKET):
        path = f"{PAGE_PATHS[name].partition('?')[0]}?x={PADDING}"
        assert handshake_status(served.viewer.url, path, **BEARER) == 429, name


def test_queries_of_one_address_are_limited_at_every_port(served: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mindstage.access.visitors.is_loopback", lambda host: False)
    costly = (Cost.QUERY, Cost.FILE)
    with closing(RawClient(f"{served.rosbridge.url}/?token={TOKEN}", source_address=ELSEWHERE)) as client:
        client.call_service("/mindstage/query", {"language": "none"})
        for name in names(served, EntryKind.SERVICE, *costly):
            response = client.call_service(name, {})
            assert "too many requests" in str(response["values"]), (name, response)
    with connect_page_client(served.viewer.url, headers=BEARER, source_address=ELSEWHERE) as page:
        with pytest.raises(RequestFailedError):
            page.ask("load", name="x.txt", text="")
        for name in names(served, EntryKind.METHOD, *costly):
            with pytest.raises(RequestFailedError, match="too many requests"):
                page.ask(name)


def test_a_request_of_the_page_is_answered_at_its_deadline(served: Served) -> None:
    release = threading.Event()
    short = msgspec.structs.replace(EDIT, deadline=msgspec.structs.replace(FILE_TIME, maximum=0.05))
    served.viewer.channel.register("planted.slow", EmptyRequest, lambda _, __: release.wait(TIMEOUT_S) and None, short)
    with connect_page_client(served.viewer.url, headers=BEARER) as page:
        try:
            with pytest.raises(RequestFailedError, match=r"TimedOut.*within 0.05 s"):
                page.ask("planted.slow")
        finally:
            release.set()


# -- who ---------------------------------------------------------------------------------------------------------------


def test_without_the_token_nothing_is_reached(served: Served) -> None:
    for name in names(served, EntryKind.ROUTE):
        assert page_status(served, PAGE_PATHS[name]) == 401, name
    for name in names(served, EntryKind.SOCKET):
        assert handshake_status(served.viewer.url, PAGE_PATHS[name]) == 401, name
    for url in (served.rosbridge.url, served.shell.url):
        for name in names(served, EntryKind.OPERATION):
            with closing(RawClient(url)) as stranger:
                fields = dict.fromkeys(("topic", "service", "action", "type", "action_type"), "/x") | {"id": name}
                stranger.send_operation(op=name, **fields, msg={}, result=True, status=4, level="error")
                code, reason = stranger.wait_closed()
                assert code == 1008, name
                assert "a token is required" in reason, name


def test_pages_of_other_sites_open_no_websocket(served: Served) -> None:
    for url, path in sockets(served):
        assert handshake_status(url, path, Origin=FOREIGN, **BEARER) == 403, (url, path)


def test_names_of_other_hosts_are_refused_everywhere(served: Served) -> None:
    for name in names(served, EntryKind.ROUTE):
        assert page_status(served, PAGE_PATHS[name], Host="evil.example", **BEARER) == 421, name
    for url, path in sockets(served):
        assert handshake_status(url, path, Host="evil.example", **BEARER) == 421, (url, path)


def test_wrong_tokens_are_refused_everywhere(served: Served) -> None:
    wrong = {"Authorization": "Bearer open"}
    for url, path in sockets(served):
        assert handshake_status(url, path, **wrong) == 401, (url, path)


# -- handlers without a policy -----------------------------------------------------------------------------------------


def test_a_path_without_a_policy_is_found() -> None:
    requests = RequestFilter(Gate(host="127.0.0.1"))
    planted: Any = None
    requests.routes += (Route("/planted", re.compile("/planted"), planted, lambda path, headers: None),)
    assert undeclared(requests.entry_points()) == ["page: request: /planted"]


def test_a_method_without_a_policy_cannot_be_registered() -> None:
    channel, missing_policy = RpcChannel(), ()
    with pytest.raises(TypeError, match="policy"):
        channel.register("planted", EmptyRequest, lambda _, __: None, *missing_policy)
    planted: Any = None
    channel.register("planted", EmptyRequest, lambda _, __: None, planted)
    assert undeclared(channel.entry_points()) == ["page: method: planted"]
    channel.close()


def test_services_actions_and_topics_without_a_policy_are_found() -> None:
    with LocalNode() as node:
        node.create_service("/planted/service", "std_srvs/Trigger", lambda args: {})
        node.create_action_server("/planted/action", "x/Y", lambda goal: {})
        node.subscribe("/planted/topic", print)
        assert undeclared(node.entry_points()) == [
            "ROS: service: /planted/service",
            "ROS: action: /planted/action",
            "ROS: subscribed topic: /planted/topic",
        ]


def test_an_operation_without_a_policy_is_found() -> None:
    planted: Any = None
    with LocalNode() as node:
        node.broker.handlers = {**node.broker.handlers, Status: (planted, lambda peer, operation: None)}
        assert undeclared(node.entry_points()) == ["rosbridge: operation: status"]


def test_a_request_of_prolog_without_a_policy_is_found_and_refused(prolog: Path) -> None:
    with Simulation(KnowledgeBase(), NullEngine()) as simulation, PrologConsole(simulation) as console:
        simulation.spawn(kitchenette())
        assert undeclared(console.entry_points()) == []
        console.handlers = {**console.handlers, "planted": lambda: True}
        assert undeclared(console.entry_points()) == ["Prolog: request: planted"]
        goal = "mindstage_questions:python(planted, answer(true))"
        assert console.solutions(goal)
        with from_outside():
            assert not console.solutions(goal)


def test_clients_send_requests_of_questions_only(prolog: Path) -> None:
    with Simulation(KnowledgeBase(), NullEngine()) as simulation, PrologConsole(simulation) as console:
        trusted = [each.name for each in console.entry_points() if each.policy and each.policy.cost is Cost.TRUSTED]
        assert {"add_robot", "perform", "evaluate_plan"} <= set(trusted)
        with from_outside():
            for name in trusted:
                (row,) = console.solutions(f"mindstage_questions:python({name}, Reply)")
                assert "PrologUnavailableError" in str(row["Reply"]), name


# -- handlers that decide by themselves --------------------------------------------------------------------------------


def test_no_handler_has_a_check_of_its_own() -> None:
    assert private_checks() == []


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("_MAX_WORDS = 7", "the limit _MAX_WORDS is not in the table"),
        ("QUERY_TIMEOUT_S: float = 2 * 7.5", "the limit QUERY_TIMEOUT_S is not in the table"),
        ("def f(token): return hmac.compare_digest(token, 'x')", "compare_digest is of the gate"),
        ("def f(headers): return headers.get('Origin') == 'http://here'", "the header Origin is of the gate"),
        ("def f(host): return is_loopback(host)", "is_loopback is of the gate"),
        ("def f(request): return 'file:' in request.text", "'file:' is searched in a text"),
        ("def f(request): return request.uri.startswith('http://')", "'http://' is searched in a text"),
        ("def f(request): return Path(request.name).resolve()", "resolve of a path in a request"),
        ("def f(request): return open(request.name)", "open of a path in a request"),
        ("def f(goal): return (FOLDER / goal.name).read_text()", "read_text of a path in a request"),
        ("def f(request): raise RequestLimitError('x', cause='y')", "RequestLimitError is raised by a handler"),
    ],
)
@pytest.mark.parametrize("package", ["ros", "viewer", "bridge", "prolog"])
def test_a_private_check_is_found(source: str, found: str, package: str, tmp_path: Path) -> None:
    (tmp_path / package).mkdir()
    (tmp_path / package / "planted.py").write_text(source + "\n", encoding="utf-8")
    assert private_checks(tmp_path) == [f"{package}/planted.py:1: {found}"]
