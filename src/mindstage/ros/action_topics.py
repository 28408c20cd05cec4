"""Action topics: an action as ROS 1 has it: goals and cancels come as messages, status, feedback and results go so."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import Any

from mindstage.bridge import GoalOutcome, GoalStatus, Participant, ServedGoal
from mindstage.bridge.subscription import Sender
from mindstage.errors import MindstageError
from mindstage.msgs import (
    Action,
    ActionFeedback,
    ActionGoal,
    ActionResult,
    Message,
    RosVersion,
    decode,
    encode,
    std_msgs,
    type_name,
)
from mindstage.msgs import actionlib_msgs as wire
from mindstage.ros.diagnostics import Diagnostics
from mindstage.ros.outlet import Outlet

__all__ = ["ActionTopics"]

_KEPT_S = 5.0
"""So long does the status tell of a goal that has ended, as actionlib does [s]."""
_KEPT = 64
"""Of so many goals does it tell at most: those under way, and the last that have ended."""
_MOST_GOALS = 16
_ENDS = {
    GoalStatus.SUCCEEDED: wire.GoalStatusCode.SUCCEEDED,
    GoalStatus.CANCELED: wire.GoalStatusCode.PREEMPTED,
}
_log = logging.getLogger("mindstage.ros")


class _Goal:
    """One goal, as its client knows it."""

    def __init__(self, id: wire.GoalID, sender: Sender | None) -> None:
        self.id = id
        self.sender = sender
        self.served: ServedGoal | None = None
        self.status = wire.GoalStatusCode.PENDING
        self.text = ""
        self.ended_at: float | None = None

    def told(self) -> wire.GoalStatus:
        """Its status for the wire."""
        return wire.GoalStatus(goal_id=self.id, status=self.status, text=self.text)


class ActionTopics:
    """The five topics of one action."""

    def __init__(
        self,
        participant: Participant,
        name: str,
        action: type[Action],
        reach: Callable[[ServedGoal], GoalOutcome],
        *,
        diagnostics: Diagnostics,
        ros: RosVersion,
    ) -> None:
        """Takes goals from now on.

        Args:
            participant: at whose hub.
            name: the action's.
            action: its type.
            reach: works at one goal, in a thread of its own.
            diagnostics: told of a cancel that is none.
            ros: whose words to use.
        """
        self._name = name
        self._action = action
        self._reach = reach
        self._diagnostics = diagnostics
        self._ros = ros
        self._goals: dict[str, _Goal] = {}
        self._lock = threading.Lock()
        self._status = Outlet(participant, f"{name}/status", wire.GoalStatusArray, ros=ros)
        self._feedback: Outlet[Any] = Outlet(
            participant, f"{name}/feedback", _of(ActionFeedback, action.Feedback), ros=ros
        )
        self._result: Outlet[Any] = Outlet(participant, f"{name}/result", _of(ActionResult, action.Result), ros=ros)
        self._goal_type = _of(ActionGoal, action.Goal)
        self._inlets = (
            participant.subscribe(
                f"{name}/goal", self._on_goal, type=type_name(self._goal_type, ros), tells_sender=True
            ),
            participant.subscribe(f"{name}/cancel", self._on_cancel, type=type_name(wire.GoalID, ros)),
        )

    def tick(self) -> None:
        """Tells the status, and gives up what nobody waits for any more."""
        now = time.monotonic()
        with self._lock:
            self._goals = {
                id: goal for id, goal in self._goals.items() if goal.ended_at is None or now - goal.ended_at < _KEPT_S
            }
            goals = tuple(self._goals.values())
        for goal in goals:
            if goal.ended_at is None and self._is_orphaned(goal):
                self._cancel(goal)
        if self._status.wanted:
            self._status.publish(wire.GoalStatusArray(status_list=tuple(goal.told() for goal in goals)))

    def close(self) -> None:
        """Takes no more goals, and gives up those under way."""
        for inlet in self._inlets:
            inlet.close()
        with self._lock:
            goals = tuple(self._goals.values())
        for goal in goals:
            self._cancel(goal)
        for outlet in (self._status, self._feedback, self._result):
            outlet.close()

    def _is_orphaned(self, goal: _Goal) -> bool:
        """Whether its client is gone: known for sure at our own hub, elsewhere when nobody listens for the result."""
        return goal.sender.gone if goal.sender is not None else not self._result.wanted

    # -- in ------------------------------------------------------------------------------------------------------------

    def _on_goal(self, message: object, sender: Sender | None) -> None:
        try:
            order: Any = decode(self._goal_type, message)
        except MindstageError as error:
            self._refuse(_goal_id(message), str(error))
            return
        stamp = order.goal_id.stamp
        goal = _Goal(wire.GoalID(stamp=stamp, id=order.goal_id.id or f"{self._name}-{time.monotonic_ns()}"), sender)
        with self._lock:
            if goal.id.id in self._goals:
                return  # actionlib sends a goal once; what comes twice is the same one
            ended = [id for id, each in self._goals.items() if each.ended_at is not None]
            busy = len(self._goals) - len(ended) >= _MOST_GOALS
            if not busy:
                for id in ended[: max(0, len(self._goals) + 1 - _KEPT)]:
                    del self._goals[id]
                self._goals[goal.id.id] = goal
        if busy:
            self._refuse(goal.id.id, f"{_MOST_GOALS} goals are under way already")
            return
        goal.served = ServedGoal(self._name, goal.id.id, encode(order.goal, ros=self._ros), self._tell_feedback(goal))
        goal.status = wire.GoalStatusCode.ACTIVE
        worker = threading.Thread(target=self._work, args=(goal, goal.served), name="mindstage-goal", daemon=True)
        worker.start()

    def _on_cancel(self, message: object) -> None:
        """One goal by its id, all up to a moment, or all."""
        try:
            wanted = decode(wire.GoalID, message)
        except MindstageError as error:
            self._diagnostics.broke(f"{self._name}/cancel", error)
            return
        with self._lock:
            goals = tuple(self._goals.values())
        moment = wanted.stamp.seconds
        everything = not wanted.id and not moment
        for goal in goals:
            if everything or goal.id.id == wanted.id or (moment and goal.id.stamp.seconds <= moment):
                self._cancel(goal)

    def _cancel(self, goal: _Goal) -> None:
        if goal.ended_at is None and goal.served is not None:
            goal.status = wire.GoalStatusCode.PREEMPTING
            goal.served.request_cancel()

    # -- out -----------------------------------------------------------------------------------------------------------

    def _work(self, goal: _Goal, served: ServedGoal) -> None:
        try:
            outcome = self._reach(served)
        except Exception as error:
            if not isinstance(error, MindstageError):
                _log.exception("%s broke", self._name)
            self._end(goal, wire.GoalStatusCode.ABORTED, str(error), None)
        else:
            self._end(goal, _ENDS.get(outcome.status, wire.GoalStatusCode.ABORTED), "", outcome.values)

    def _tell_feedback(self, goal: _Goal) -> Callable[[Any, object], None]:
        def tell(_: Any, values: object) -> None:
            self._feedback.publish_written(self._written(goal, "feedback", values))

        return tell

    def _refuse(self, id: str, why: str) -> None:
        """A goal that is none; its client, if it can be told who that is, shall not wait for it."""
        self._end(_Goal(wire.GoalID(id=id), None), wire.GoalStatusCode.REJECTED, why, None)

    def _end(self, goal: _Goal, status: wire.GoalStatusCode, text: str, values: object) -> None:
        goal.status, goal.text, goal.ended_at = status, text, time.monotonic()
        if values is None:
            values = encode(self._action.Result(), ros=self._ros)
        self._result.publish_written(self._written(goal, "result", values))

    def _written(self, goal: _Goal, kind: str, values: object) -> dict[str, object]:
        header, status = encode(std_msgs.Header(), ros=self._ros), encode(goal.told(), ros=self._ros)
        return {"header": header, "status": status, kind: values}


def _of(kind: Any, part: type[Message]) -> Any:
    return kind[part]


def _goal_id(message: object) -> str:
    id = message.get("goal_id") if isinstance(message, dict) else None
    return str(id.get("id", "")) if isinstance(id, dict) else ""
