"""A far side that answers as it is told to: properly, or not at all, or twice, or with nonsense."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from typing import Any

from websockets.sync.server import ServerConnection, serve

__all__ = ["DESCRIBED", "OddFarSide", "answer", "failed"]

Frames = list[str | bytes]
Behave = Callable[[dict[str, Any]], Frames]

FINE = {"kind": "", "text": "", "body": "", "parent": "", "child": "", "reason": "", "world": "", "near": []}
DESCRIBED = {
    "engine": "odd",
    "abilities": ["telepathy"],
    "time_s": 1.5,
    "format_version": 1,
    "session": "first",
    "takes": [],
}
REPORT = dict.fromkeys(("bodies", "constraints", "attachments"), 0) | {
    name: [] for name in ("failed_bodies", "failed_constraints", "failed_attachments", "notes")
}


def answer(**values: Any) -> Behave:
    """Answers with these values, and says that all went well."""
    told = {"success": True, "refusal": FINE, **values}
    return lambda call: [response(call, told)]


def failed(text: Any) -> Behave:
    return lambda call: [response(call, text, result=False)]


def response(call: dict[str, Any], values: Any, *, result: bool = True) -> str:
    service = call["service"]
    return json.dumps(
        {"op": "service_response", "id": call["id"], "service": service, "values": values, "result": result}
    )


class OddFarSide:
    """Serves as a context; `behave` may be changed at any time."""

    def __init__(self) -> None:
        self.behave: dict[str, Behave] = {
            "describe": lambda call: [response(call, DESCRIBED)],
            "set_speed": answer(before=0.0),
            "get_poses": answer(time_s=1.5, ids=[], poses=[], revision=0, rows=""),
            "spawn_world": answer(report=REPORT),
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
            for reply in self.behave.get(name, unknown)(call):
                connection.send(reply)

    def __enter__(self) -> OddFarSide:
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
