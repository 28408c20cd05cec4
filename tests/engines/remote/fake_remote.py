"""A fake remote engine, whose responses can be set to valid, missing, duplicate or invalid ones."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from typing import Any

from websockets.sync.server import ServerConnection, serve

__all__ = ["DESCRIBE_VALUES", "FakeRemote", "failed", "ok_response"]

Frames = list[str | bytes]
Responder = Callable[[dict[str, Any]], Frames]

NO_REFUSAL = {
    "code": "",
    "text": "",
    "body": "",
    "parent": "",
    "child": "",
    "reason": "",
    "world": "",
    "suggestions": [],
}
DESCRIBE_VALUES = {
    "engine": "odd",
    "abilities": ["telepathy"],
    "time_s": 1.5,
    "format_version": 2,
    "session": "first",
    "takes": [],
}
REPORT = dict.fromkeys(("bodies", "joints", "attachments"), 0) | {
    name: [] for name in ("failed_bodies", "failed_joints", "failed_attachments", "notes")
}


def ok_response(**values: Any) -> Responder:
    """Responds with success and these values."""
    values_sent = {"success": True, "refusal": NO_REFUSAL, **values}
    return lambda call: [response(call, values_sent)]


def failed(text: Any) -> Responder:
    return lambda call: [response(call, text, result=False)]


def response(call: dict[str, Any], values: Any, *, result: bool = True) -> str:
    service = call["service"]
    return json.dumps(
        {"op": "service_response", "id": call["id"], "service": service, "values": values, "result": result}
    )


class FakeRemote:
    """A context manager; `respond` may be changed at any time."""

    def __init__(self) -> None:
        self.respond: dict[str, Responder] = {
            "describe": lambda call: [response(call, DESCRIBE_VALUES)],
            "set_speed": ok_response(before=0.0),
            "get_poses": ok_response(time_s=1.5, ids=[], poses=[], revision=0, rows=""),
            "spawn_world": ok_response(report=REPORT),
        }
        self.calls: list[str] = []
        self._server = serve(self._serve, "127.0.0.1", 0)
        self.address = f"ros://127.0.0.1:{self._server.socket.getsockname()[1]}/odd"

    def _serve(self, connection: ServerConnection) -> None:
        for frame in connection:
            call = json.loads(frame)
            name = call["service"].rpartition("/")[2]
            self.calls.append(name)
            unknown = failed(f"Service {call['service']} does not exist")
            for reply in self.respond.get(name, unknown)(call):
                connection.send(reply)

    def __enter__(self) -> FakeRemote:
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._thread.join(20.0)


def poses(*ids: str) -> Iterator[dict[str, Any]]:
    """A pose for each id."""
    for x, _ in enumerate(ids):
        yield {"position": {"x": x, "y": 0, "z": 0}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}
