"""The golden messages in `wire/`, and which class each is of."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from mindstage.msgs import Message, action_type, message_type, service_type

__all__ = ["case_name", "cases", "part_type"]

WIRE = Path(__file__).resolve().parent.parent.parent / "wire"


def cases(*, refused: bool = False) -> list[dict[str, Any]]:
    return [
        case
        for path in sorted(WIRE.glob("*.json"))
        if (path.stem == "refused") == refused
        for case in json.loads(path.read_text(encoding="utf-8"))
    ]


def case_name(case: dict[str, Any]) -> str:
    return f"{case['type']}.{case['part']}: {case['name']}"


def part_type(case: dict[str, Any]) -> type[Message]:
    match case["part"]:
        case "message":
            return message_type(case["type"])
        case "request" | "response" as part:
            return getattr(service_type(case["type"]), part)
        case part:
            return getattr(action_type(case["type"]), part)
