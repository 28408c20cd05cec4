"""The golden messages in `wire/`, as parameters of tests."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from mindstage.msgs import Message, action_type, message_type, service_type

__all__ = ["cases", "each_case", "each_refused", "part_type"]

WIRE = Path(__file__).resolve().parent.parent.parent / "wire"


def cases(*, refused: bool = False) -> list[Any]:
    return [
        pytest.param(case, id=f"{case['type']}.{case['part']}: {case['name']}")
        for path in sorted(WIRE.glob("*.json"))
        if (path.stem == "refused") == refused
        for case in json.loads(path.read_text(encoding="utf-8"))
    ]


def part_type(case: dict[str, Any]) -> type[Message]:
    match case["part"]:
        case "message":
            return message_type(case["type"])
        case "request" | "response" as part:
            return getattr(service_type(case["type"]), part)
        case part:
            return getattr(action_type(case["type"]), part)


each_case = pytest.mark.parametrize("case", cases())
each_refused = pytest.mark.parametrize("case", cases(refused=True))
