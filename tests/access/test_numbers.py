"""Numbers that are not finite, and coordinates beyond all places, are refused at every port, with the id."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import cbor2
import msgspec
import pytest

from mindstage import msgs
from mindstage.access.policies import EntryKind
from mindstage.msgs.schema.base import fields_of
from tests.access.conftest import TOKEN, Served
from tests.bridge.raw_client import TIMEOUT_S, RawClient
from tests.cases import each_case
from tests.viewer.page_client import connect_page_client

NOT_FINITE = ("NaN", "Infinity", "-Infinity", "1e400", "1" + "0" * 400, "1" + "0" * 5000)
BEARER = {"Authorization": f"Bearer {TOKEN}"}
Path = tuple[str | int, ...]
NUMBER_TYPES = msgspec.inspect.FloatType | msgspec.inspect.IntType


def number_paths(message: Any, depth: int = 0) -> Iterator[tuple[Path, str]]:
    """The path and the type of each number in a message; 0 stands for the elements of an array."""
    for field in fields_of(message):
        step: Path = (field.name,) if field.length is None else (field.name, 0)
        if field.message is not None and depth < 8:
            yield from (((*step, *path), type) for path, type in number_paths(field.message, depth + 1))
        elif field.primitive.startswith(("float", "int", "uint")) and (step[-1] != 0 or field.primitive != "uint8"):
            yield step, field.primitive


def nested(path: Path, number: str) -> str:
    """JSON with a number at a path."""
    for step in reversed(path):
        number = f"[{number}]" if step == 0 else f'{{"{step}": {number}}}'
    return number


@pytest.fixture
def client(served: Served) -> Iterator[RawClient]:
    with closing(RawClient(f"{served.rosbridge.url}/?token={TOKEN}")) as client:
        yield client


def services(served: Served, client: RawClient) -> Iterator[tuple[str, Any]]:
    for entry in served.node.entry_points():
        if entry.kind is EntryKind.SERVICE:
            type = client.call_service("/rosapi/service_type", {"service": entry.name})["values"]["type"]
            yield entry.name, msgs.service_type(type).request


def call_with(client: RawClient, service: str, path: Path, number: str) -> Any:
    id = f"{service} {path} {number[:9]}"
    client.send(f'{{"op":"call_service","id":"{id}","service":"{service}","args":{nested(path, number)}}}')
    return client.receive("service_response", id=id)


@pytest.mark.parametrize("number", NOT_FINITE, ids=lambda number: number[:9] + str(len(number)))
def test_every_number_of_every_service_is_refused_if_it_is_not_finite(
    served: Served, client: RawClient, number: str
) -> None:
    tried, wrong = 0, []
    for service, request in services(served, client):
        for path, _ in number_paths(request):
            response, tried = call_with(client, service, path, number), tried + 1
            place = next(str(step) for step in reversed(path) if step != 0)
            if response["result"] or place not in json.dumps(response["values"]):
                wrong.append(f"{service} {path}: {response}")
    assert tried > 150
    assert wrong == []


@pytest.mark.parametrize("number", ["1e308", "-1e308"])
def test_every_coordinate_of_every_service_has_a_range(served: Served, client: RawClient, number: str) -> None:
    wrong = []
    for service, request in services(served, client):
        for path, type in number_paths(request):
            if type == "float64" and path[-1] in {"x", "y", "z", "w"}:
                response = call_with(client, service, path, number)
                text = json.dumps(response["values"])
                if response["result"] or str(path[-1]) not in text or "from" not in text:
                    wrong.append(f"{service} {path}: {response}")
    assert wrong == []


@pytest.mark.parametrize("timeout", ["NaN", "-1", "1e400", '"soon"'])
def test_a_call_with_an_invalid_field_beside_the_arguments_gets_a_response(client: RawClient, timeout: str) -> None:
    client.send(f'{{"op":"call_service","id":"t","service":"/rosapi/services","timeout":{timeout}}}')
    response = client.receive("service_response", id="t")
    assert not response["result"]
    assert "timeout" in response["values"]


@pytest.mark.parametrize("number", [2**80, -(2**80)])
def test_a_call_in_cbor_with_an_integer_beyond_json_gets_a_response(client: RawClient, number: int) -> None:
    client.send(cbor2.dumps({"op": "call_service", "id": "b", "service": "/x", "args": {"steps": number}}))
    assert not client.receive("service_response", id="b")["result"]


def test_a_goal_with_a_number_that_is_not_finite_gets_a_result(client: RawClient) -> None:
    client.send('{"op":"send_action_goal","id":"g","action":"/x","action_type":"a/B","args":{"duration_s":[1,NaN]}}')
    result = client.receive("action_result", id="g")
    assert not result["result"]
    assert "duration_s[1]" in result["values"]


def test_other_messages_with_numbers_that_are_not_finite_get_a_status(client: RawClient) -> None:
    client.send('{"op":"publish","id":"p","topic":"/x","msg":{"x":NaN}}')
    assert "msg.x" in client.receive("status", id="p")["msg"]


def page_requests(channel: Any) -> Iterator[tuple[str, str]]:
    """A method of the page and the name of a number in its request, for each."""
    for method, registered in channel._methods.items():
        info: Any = msgspec.inspect.type_info(registered.request_type)
        for field in info.fields:
            if any(isinstance(each, NUMBER_TYPES) for each in types_in(field.type)):
                yield method, field.encode_name


def types_in(type: msgspec.inspect.Type) -> Iterator[msgspec.inspect.Type]:
    yield type
    for name in ("types", "item_types"):
        for each in getattr(type, name, ()):
            yield from types_in(each)


@each_case("number", NOT_FINITE, ids=lambda number: number[:9] + str(len(number)))
def test_every_number_of_every_request_of_the_page_is_refused_if_it_is_not_finite(served: Served, number: str) -> None:
    tried = 0
    for viewer in (served.viewer, served.replay):
        with connect_page_client(viewer.url, headers=BEARER) as page:
            for method, field in page_requests(viewer.channel):
                tried += 1
                page.socket.send(f'{{"id":{tried},"method":"{method}","params":{{"{field}":{number}}}}}')
                while (answer := msgspec.json.decode(page.socket.recv(timeout=TIMEOUT_S))).get("id") != tried:
                    pass
                assert "error" in answer, (method, field)
    assert tried > 25
