"""Helpers for the tests of the ROS interface: calls, questions and messages."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

__all__ = ["Ask", "Call", "diagnostic_texts", "pose_message", "position_of", "question_caller"]

Call = Callable[..., Any]
Ask = Callable[..., Any]

TURNED = {"x": 0.0, "y": 0.0, "z": 0.25881904510252074, "w": 0.9659258262890683}
"""A rotation by 30 degrees about z."""


def question_caller(call: Call) -> Ask:
    def ask(question: str, /, **args: Any) -> Any:
        reply = call(f"/mindstage/{question}", args=json.dumps(args))
        assert reply["success"]
        return json.loads(reply["answers"])

    return ask


def pose_message(x: float, y: float, z: float, orientation: dict[str, float] | None = None) -> dict[str, Any]:
    orientation = orientation or {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    return {"position": {"x": x, "y": y, "z": z}, "orientation": orientation}


def position_of(pose: dict[str, Any]) -> tuple[float, float, float]:
    place = pose["position"]
    return round(place["x"], 6), round(place["y"], 6), round(place["z"], 6)


def diagnostic_texts(messages: list[Any]) -> list[tuple[str, str]]:
    """Returns the id and the text of each diagnostic status."""
    return [(status["hardware_id"], status["message"]) for each in messages for status in each["status"]]
