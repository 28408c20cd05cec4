"""The actions of mindstage_msgs: what takes time, tells how far it is, and can be given up."""
# ruff: noqa: D106 - Goal, Result and Feedback say what they are

from __future__ import annotations

from mindstage.msgs.message import Action, Message
from mindstage.msgs.mindstage_msgs.messages import Refusal, SpawnReport
from mindstage.msgs.primitives import Bool, Float64, String, Uint32

__all__ = ["Simulate", "SpawnMap"]


class SpawnMap(Action):
    """Spawns a world, and tells how far it is."""

    class Goal(Message, frozen=True):
        world: String = ""
        forms: String = ""
        plan: String = ""

    class Result(Message, frozen=True):
        success: Bool = False
        refusal: Refusal = Refusal()
        report: SpawnReport = SpawnReport()

    class Feedback(Message, frozen=True):
        phase: String = ""
        done: Uint32 = 0
        total: Uint32 = 0


class Simulate(Action):
    """Lets time pass, and tells how much has."""

    class Goal(Message, frozen=True):
        duration_s: Float64 = 0.0

    class Result(Message, frozen=True):
        success: Bool = False
        refusal: Refusal = Refusal()
        time_s: Float64 = 0.0

    class Feedback(Message, frozen=True):
        elapsed_s: Float64 = 0.0
        remaining_s: Float64 = 0.0
