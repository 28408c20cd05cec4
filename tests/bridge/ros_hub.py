"""A rosbridge of ROS that lacks packages, types or rosapi, or that has a short queue of answers."""

from __future__ import annotations

import queue
import threading
from typing import Any

import msgspec
from websockets.exceptions import ConnectionClosed
from websockets.sync.server import ServerConnection, serve

from tests.bridge.raw_client import TIMEOUT_S

__all__ = ["Hub"]

Message = dict[str, Any]


class Hub:
    """A rosbridge that refuses operations of packages and types that it lacks, and sends few answers at a time.

    Its answers are those of rosbridge-server-rs 0.1.6: a status with the id of the operation, and the code 1013 if more
    answers wait than its queue has places. The answers wait until the operations that have arrived are handled.
    """

    def __init__(self, *, lacks: tuple[str, ...] = (), places: int = 64, rosapi: bool = True) -> None:
        self.lacks = lacks
        self.places = places
        self.rosapi = rosapi
        self.connections = 0
        self.received: list[Message] = []
        self.advertised: dict[str, Message] = {}
        self.early: list[str] = []
        """Topics of messages that arrived before their advertisement was accepted."""
        self._server = serve(self._handle, "127.0.0.1", 0, server_header=None)
        self.url = f"ws://127.0.0.1:{self._server.socket.getsockname()[1]}"
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    def _handle(self, connection: ServerConnection) -> None:
        self.connections += 1
        self.advertised = {}
        arrived: queue.SimpleQueue[Message | None] = queue.SimpleQueue()
        handling = threading.Thread(target=self._answer, args=(connection, arrived), daemon=True)
        handling.start()
        try:
            for frame in connection:
                arrived.put(msgspec.json.decode(frame))
        except ConnectionClosed:
            pass
        finally:
            arrived.put(None)
            handling.join(TIMEOUT_S)

    def _answer(self, connection: ServerConnection, arrived: queue.SimpleQueue[Message | None]) -> None:
        waiting: list[Message] = []
        while (message := arrived.get()) is not None:
            self.received.append(message)
            if (answer := self._reply(message)) is not None:
                waiting.append(answer)
            if len(waiting) > self.places:
                connection.close(1013, "control send queue full")
                return
            if arrived.empty() or message["op"] == "call_service":
                try:
                    for each in waiting:
                        connection.send(msgspec.json.encode(each).decode())
                except ConnectionClosed:
                    return
                waiting.clear()

    def _reply(self, message: Message) -> Message | None:
        op, type = message["op"], message.get("type", "")
        if op == "call_service":
            has = self.rosapi and message["service"] == "/rosapi/get_time"
            values = {"time": {"sec": 1, "nanosec": 0}} if has else "type is required when interface is absent"
            return {"op": "service_response", "id": message["id"], "service": message["service"]} | {
                "result": has,
                "values": values,
            }
        if op == "publish" and message["topic"] not in self.advertised:
            self.early.append(message["topic"])
        if type.startswith(self.lacks) if self.lacks else False:
            package = type.partition("/")[0]
            is_package = f"{package}/" in self.lacks
            more = "; install and source its ROS package" if is_package else ""
            text = f"load message definition {type}{more}"
            return {"op": "status", "level": "error", "msg": text, "id": message["id"]}
        if op.startswith(("advertise", "subscribe")):
            self.advertised[message.get("topic") or message.get("service") or message["action"]] = message
        return None

    def close(self) -> None:
        self._server.shutdown()
        self._thread.join(TIMEOUT_S)
