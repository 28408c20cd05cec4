"""Causes: what msgspec says about a value that it refuses, as a cause and a path in our words."""

from __future__ import annotations

import re

__all__ = ["cause_and_path"]


def cause_and_path(error: Exception) -> tuple[str, str]:
    """Why a value was refused, and where in it: "expected float, got str" and "models[3].pose.position.x"."""
    found = re.fullmatch(r"(.*?)(?: - at (`key` in )?`\$\.?(.*?)`)?", str(error), re.DOTALL)
    cause, key, path = found.groups() if found else (str(error), None, None)
    if key:
        return "one of its keys is no text", path or ""
    return (cause[:1].lower() + cause[1:]).replace("`", ""), path or ""
