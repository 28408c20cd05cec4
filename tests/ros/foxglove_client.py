"""A client of the Foxglove WebSocket protocol (subprotocol `foxglove.sdk.v1`), with a decoder of protobuf.

Messages are decoded by the descriptors that the server advertises, so they are read as the app reads them. The protocol
is documented in foxglove/ws-protocol, the wire format in the protobuf encoding guide.
"""

from __future__ import annotations

import base64
import json
import struct
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from tests.bridge.raw_client import TIMEOUT_S

__all__ = ["FoxgloveClient"]

_MESSAGE, _TIME, _RESPONSE = 1, 2, 3
_DOUBLE, _FIXED32, _BOOL, _STRING, _MESSAGE_FIELD, _REPEATED = 1, 7, 8, 9, 11, 3


def wire_fields(data: bytes) -> Iterator[tuple[int, int, Any]]:
    """Yields the number, the wire type and the raw value of each field of a protobuf message."""
    at = 0

    def varint() -> int:
        nonlocal at
        value = shift = 0
        while True:
            byte = data[at]
            value, shift, at = value | (byte & 0x7F) << shift, shift + 7, at + 1
            if byte < 0x80:
                return value

    while at < len(data):
        number, kind = divmod(varint(), 8)
        if kind == 0:
            yield number, kind, varint()
        else:
            size = varint() if kind == 2 else {1: 8, 5: 4}[kind]
            yield number, kind, data[at : at + size]
            at += size


class Schema:
    """The message types in an encoded FileDescriptorSet."""

    def __init__(self, data: bytes) -> None:
        self._fields: dict[str, dict[int, tuple[str, int, int, str]]] = {}
        for _, _, file in wire_fields(data):
            parts = list(wire_fields(file))
            package = next(value.decode() for number, _, value in parts if number == 2)
            for number, _, message in parts:
                if number == 4:
                    self._add(f".{package}", message)

    def _add(self, scope: str, data: bytes) -> None:
        parts = list(wire_fields(data))
        name = f"{scope}.{next(value.decode() for number, _, value in parts if number == 1)}"
        fields = self._fields[name] = {}
        for number, _, value in parts:
            if number == 2:
                field = {key: part for key, _, part in wire_fields(value)}
                fields[field[3]] = field[1].decode(), field[5], field[4], field.get(6, b"").decode()
            elif number == 3:
                self._add(name, value)

    def decode(self, name: str, data: bytes) -> dict[str, Any]:
        """Decodes a message; fields that are absent have no key, except repeated ones."""
        fields = self._fields[f".{name.lstrip('.')}"]
        found: dict[str, Any] = {field: [] for field, _, label, _ in fields.values() if label == _REPEATED}
        for number, kind, raw in wire_fields(data):
            field, type, label, inner = fields[number]
            values = list(self._values(type, inner, kind, raw))
            if label == _REPEATED:
                found[field] += values
            else:
                (found[field],) = values
        return found

    def _values(self, type: int, inner: str, kind: int, raw: Any) -> Iterator[Any]:
        if type == _MESSAGE_FIELD:
            yield self.decode(inner, raw)
        elif type == _STRING:
            yield raw.decode()
        elif type in {_DOUBLE, _FIXED32}:
            yield from (each for (each,) in struct.iter_unpack("<d" if type == _DOUBLE else "<I", raw))
        else:
            yield bool(raw) if type == _BOOL else raw


class FoxgloveClient:
    """A connection, whose messages a thread collects."""

    def __init__(self, url: str) -> None:
        self.socket = connect(url, subprotocols=["foxglove.sdk.v1"], max_size=None, open_timeout=TIMEOUT_S)
        self.operations: list[dict[str, Any]] = []
        self.messages: dict[str, list[dict[str, Any]]] = {}
        self.times_s: list[float] = []
        self.responses: dict[int, Any] = {}
        self._channels: dict[str, tuple[int, str, Schema]] = {}
        self._services: dict[str, int] = {}
        self._subscribed: dict[int, str] = {}
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._receive, daemon=True)
        self._thread.start()
        self.wait(lambda: len(self._channels) >= 3 and self._services)

    def wait(self, condition: Callable[[], Any]) -> Any:
        """Waits until a condition is true, and returns its value."""
        deadline = time.monotonic() + TIMEOUT_S
        with self._changed:
            while not (value := condition()):
                assert time.monotonic() < deadline, "timed out"
                self._changed.wait(0.1)
            return value

    def subscribe(self, topic: str) -> list[dict[str, Any]]:
        """Subscribes to a topic; returns the list of its messages, which grows."""
        channel, _, _ = self._channels[topic]
        self._subscribed[channel] = topic
        self.send(op="subscribe", subscriptions=[{"id": channel, "channelId": channel}])
        return self.messages.setdefault(topic, [])

    def send(self, **operation: Any) -> None:
        """Sends an operation."""
        self.socket.send(json.dumps(operation))

    def parameters(self, **changes: Any) -> dict[str, Any]:
        """Sets parameters and returns all."""
        id = f"request {len(self.operations)}"
        if changes:
            values = [{"name": name, "value": value} for name, value in changes.items()]
            self.send(op="setParameters", parameters=values, id=id)
        else:
            self.send(op="getParameters", parameterNames=[], id=id)
        reply = self.wait(lambda: next((each for each in self.operations if each.get("id") == id), None))
        return {each["name"]: each["value"] for each in reply["parameters"]}

    def call(self, service: str, payload: bytes | dict[str, Any]) -> Any:
        """Calls a service; returns its response, or the text of the failure."""
        data = payload if isinstance(payload, bytes) else json.dumps(payload).encode()
        call = len(self.responses) + 1
        self.socket.send(struct.pack("<BIII", 2, self._services[service], call, 4) + b"json" + data)
        self.wait(lambda: call in self.responses)
        return self.responses[call]

    def close(self) -> None:
        self.socket.close()
        self._thread.join(TIMEOUT_S)

    def _receive(self) -> None:
        try:
            for frame in self.socket:
                with self._changed:
                    self._handle(frame)
                    self._changed.notify_all()
        except ConnectionClosed:
            pass

    def _handle(self, frame: str | bytes) -> None:
        if isinstance(frame, str):
            self._handle_operation(json.loads(frame))
        elif frame[0] == _MESSAGE:
            subscription, time_ns = struct.unpack_from("<IQ", frame, 1)
            topic = self._subscribed[subscription]
            _, name, schema = self._channels[topic]
            self.messages[topic].append({**schema.decode(name, frame[13:]), "log_time_s": time_ns / 1e9})
        elif frame[0] == _TIME:
            self.times_s.append(struct.unpack_from("<Q", frame, 1)[0] / 1e9)
        elif frame[0] == _RESPONSE:
            _, call, size = struct.unpack_from("<III", frame, 1)
            self.responses[call] = json.loads(frame[13 + size :])

    def _handle_operation(self, operation: dict[str, Any]) -> None:
        self.operations.append(operation)
        for each in operation.get("channels", ()):
            assert (each["encoding"], each["schemaEncoding"]) == ("protobuf", "protobuf")
            schema = Schema(base64.b64decode(each["schema"] + "=="))
            self._channels[each["topic"]] = each["id"], each["schemaName"], schema
        for each in operation.get("services", ()):
            self._services[each["name"]] = each["id"]
        if operation["op"] == "serviceCallFailure":
            self.responses[operation["callId"]] = operation["message"]
