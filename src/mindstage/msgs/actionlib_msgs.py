"""actionlib_msgs: what ROS 1 says of goals, and what its five topics of an action carry."""

from __future__ import annotations

from typing import Generic, TypeVar

from mindstage.msgs.builtin_interfaces import Time
from mindstage.msgs.message import Message
from mindstage.msgs.primitives import String, Uint8Code
from mindstage.msgs.std_msgs import Header

__all__ = ["ActionFeedback", "ActionGoal", "ActionResult", "GoalID", "GoalStatus", "GoalStatusArray", "GoalStatusCode"]

M = TypeVar("M")


class GoalStatusCode(Uint8Code):
    """What became of a goal so far."""

    PENDING = 0
    ACTIVE = 1
    PREEMPTED = 2
    SUCCEEDED = 3
    ABORTED = 4
    REJECTED = 5
    PREEMPTING = 6
    RECALLING = 7
    RECALLED = 8
    LOST = 9


class GoalID(Message, frozen=True):
    """Which goal; on the topic `cancel`, an empty id means all of them."""

    stamp: Time = Time()
    id: String = ""


class GoalStatus(Message, frozen=True):
    """What became of one goal so far."""

    goal_id: GoalID = GoalID()
    status: GoalStatusCode = GoalStatusCode.PENDING
    text: String = ""


class GoalStatusArray(Message, frozen=True):
    """What became of all goals that are not forgotten yet."""

    header: Header = Header()
    status_list: tuple[GoalStatus, ...] = ()


class ActionGoal(Message, Generic[M], frozen=True, kw_only=True):
    """The topic `goal` of an action: `SimulateStepsActionGoal` is `ActionGoal[SimulateSteps.Goal]`."""

    header: Header = Header()
    goal_id: GoalID = GoalID()
    goal: M


class ActionResult(Message, Generic[M], frozen=True, kw_only=True):
    """The topic `result` of an action."""

    header: Header = Header()
    status: GoalStatus = GoalStatus()
    result: M


class ActionFeedback(Message, Generic[M], frozen=True, kw_only=True):
    """The topic `feedback` of an action."""

    header: Header = Header()
    status: GoalStatus = GoalStatus()
    feedback: M
