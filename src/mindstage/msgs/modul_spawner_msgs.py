"""modul_spawner_msgs: robots in Unreal."""
# ruff: noqa: D106 - Request and Response say what they are

from __future__ import annotations

from typing import ClassVar

from mindstage.msgs.message import Message, Service
from mindstage.msgs.primitives import Bool, String

__all__ = ["SpawnRobot"]


class SpawnRobot(Service):
    """Brings a robot: one that Unreal knows by that name, or a description (SDF) in its place."""

    class Request(Message, frozen=True):
        name: String = ""
        id: String = ""

    class Response(Message, frozen=True):
        spellings: ClassVar = {"Name": "name"}

        id: String = ""
        name: String = ""
        success: Bool = False
