"""An action in ROS 1: its five topics for goals, cancellations, status, feedback and results."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from mindstage.access.limits import ACTIONLIB_GOALS, STATUS_ENTRIES, Timeout
from mindstage.access.policies import CONTROL, Policy
from mindstage.bridge import GoalResult, GoalStatus, Node, ServerGoalHandle
from mindstage.bridge.node import MessageSender
from mindstage.errors import BridgeError, FailureResponseError, MindstageError
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
from mindstage.ranges import checked
from mindstage.ros.diagnostics import DiagnosticsPublisher, Publisher
from mindstage.ros.service import EndedGoal, decode_request, failure_response

__all__ = ["ActionlibServer"]

_STATUS_RETENTION_S = 5.0
"""Time for which the status of a goal is published after its end, as in actionlib [s]."""
_STATUS_BY_RESULT = {
    GoalStatus.SUCCEEDED: wire.GoalStatusCode.SUCCEEDED,
    GoalStatus.CANCELED: wire.GoalStatusCode.PREEMPTED,
}
_log = logging.getLogger("mindstage.ros")


class _Goal:
    """A goal and its status."""

    def __init__(self, id: wire.GoalID, sender: MessageSender | None) -> None:
        self.id = id
        self.sender = sender
        self.handle: ServerGoalHandle | None = None
        self.status = wire.GoalStatusCode.PENDING
        self.text = ""
        self.ended_at: float | None = None

    def to_message(self) -> wire.GoalStatus:
        """Returns its status as a message."""
        return wire.GoalStatus(goal_id=self.id, status=self.status, text=self.text)


class _GoalHandle(ServerGoalHandle):
    """Says when its handler begins to move something: when it first looks for a cancellation or sends feedback."""

    def __init__(self, *args: Any, on_begin: Callable[[], None]) -> None:
        super().__init__(*args)
        self._on_begin = on_begin

    @property
    def cancel_requested(self) -> bool:
        self._on_begin()
        return super().cancel_requested

    def feedback(self, values: object) -> None:
        self._on_begin()
        super().feedback(values)

    @checked
    def wait_for_cancel(self, timeout_s: Timeout) -> bool:
        self._on_begin()
        return super().wait_for_cancel(timeout_s)

    def on_cancel(self, callback: Callable[[], object]) -> None:
        self._on_begin()
        super().on_cancel(callback)


class ActionlibServer:
    """The topics of one action."""

    def __init__(
        self,
        node: Node,
        name: str,
        action: type[Action],
        handler: Callable[[ServerGoalHandle], GoalResult],
        policy: Policy,
        *,
        diagnostics: DiagnosticsPublisher,
        ros: RosVersion,
    ) -> None:
        """Starts to accept goals.

        Args:
            node: node that publishes and subscribes.
            name: name of the action.
            handler: executes one goal, in a thread of its own.
            policy: the limits of its goals.
            diagnostics: publishes errors of invalid cancellations.
            ros: version of ROS for names and formats.
        """
        self.name = name
        """Absolute name of the action."""
        self._action = action
        self._handler = handler
        self._diagnostics = diagnostics
        self._ros = ros
        self._goals: dict[str, _Goal] = {}
        self._lock = threading.Lock()
        self._status = Publisher(node, f"{name}/status", wire.GoalStatusArray, ros=ros)
        self._feedback: Publisher[Any] = Publisher(
            node, f"{name}/feedback", _message_class(ActionFeedback, action.Feedback), ros=ros
        )
        self._result: Publisher[Any] = Publisher(
            node, f"{name}/result", _message_class(ActionResult, action.Result), ros=ros
        )
        self._goal_type = _message_class(ActionGoal, action.Goal)
        self._subscriptions = (
            node.subscribe(
                f"{name}/goal", self._on_goal, type=type_name(self._goal_type, ros), with_sender=True, policy=policy
            ),
            node.subscribe(f"{name}/cancel", self._on_cancel, type=type_name(wire.GoalID, ros), policy=CONTROL),
        )

    def publish_status(self) -> None:
        """Publishes the status of the goals, and cancels those whose client has disconnected."""
        now = time.monotonic()
        with self._lock:
            self._goals = {
                id: goal
                for id, goal in self._goals.items()
                if goal.ended_at is None or now - goal.ended_at < _STATUS_RETENTION_S
            }
            goals = tuple(self._goals.values())
        for goal in goals:
            if goal.ended_at is None and self._is_orphaned(goal):
                self._cancel(goal)
        if self._status.has_subscribers:
            self._status.publish(wire.GoalStatusArray(status_list=tuple(goal.to_message() for goal in goals)))

    def close(self) -> None:
        """Accepts no more goals, and cancels the active ones."""
        for subscription in self._subscriptions:
            subscription.close()
        with self._lock:
            goals = tuple(self._goals.values())
        for goal in goals:
            self._cancel(goal)
        for publisher in (self._status, self._feedback, self._result):
            publisher.close()

    def _is_orphaned(self, goal: _Goal) -> bool:
        """Whether the client has disconnected; at another server, whether the result has no subscribers."""
        return goal.sender.has_left if goal.sender is not None else not self._result.has_subscribers

    # -- in ------------------------------------------------------------------------------------------------------------

    def _on_goal(self, message: object, sender: MessageSender | None) -> None:
        try:
            request: Any = decode_request(self._goal_type, message)
        except MindstageError as error:
            self._reject_goal(_goal_id(message), error)
            return
        stamp = request.goal_id.stamp
        goal = _Goal(wire.GoalID(stamp=stamp, id=request.goal_id.id or f"{self.name}-{time.monotonic_ns()}"), sender)
        with self._lock:
            if goal.id.id in self._goals:
                return  # a duplicate; actionlib does not reuse ids
            ended = [id for id, each in self._goals.items() if each.ended_at is not None]
            busy = len(self._goals) - len(ended) >= ACTIONLIB_GOALS.count
            if not busy:
                for id in ended[: max(0, len(self._goals) + 1 - STATUS_ENTRIES.count)]:
                    del self._goals[id]
                self._goals[goal.id.id] = goal
        if busy:
            self._reject_goal(goal.id.id, BridgeError(f"{ACTIONLIB_GOALS.count} goals are active already"))
            return
        goal.handle = _GoalHandle(
            self.name,
            goal.id.id,
            encode(request.goal, ros=self._ros),
            self._feedback_publisher(goal),
            on_begin=partial(self._set_active, goal),
        )
        worker = threading.Thread(target=self._run_goal, args=(goal, goal.handle), name="mindstage-goal", daemon=True)
        worker.start()

    def _on_cancel(self, message: object) -> None:
        """Cancels one goal by its id, all up to a time, or all."""
        try:
            request = decode(wire.GoalID, message)
        except MindstageError as error:
            self._diagnostics.report_error(f"{self.name}/cancel", error)
            return
        with self._lock:
            goals = tuple(self._goals.values())
        until_s = request.stamp.seconds
        cancels_all = not request.id and not until_s
        for goal in goals:
            if cancels_all or goal.id.id == request.id or (until_s and goal.id.stamp.seconds <= until_s):
                self._cancel(goal)

    def _cancel(self, goal: _Goal) -> None:
        if goal.ended_at is None and goal.handle is not None:
            goal.status = wire.GoalStatusCode.PREEMPTING
            goal.handle.request_cancel()

    # -- out -----------------------------------------------------------------------------------------------------------

    def _run_goal(self, goal: _Goal, handle: ServerGoalHandle) -> None:
        try:
            result = self._handler(handle)
        except Exception as error:
            if not isinstance(error, MindstageError):
                _log.exception("%s failed", self.name)
            values = error.response if isinstance(error, FailureResponseError) else None
            self._finish(goal, wire.GoalStatusCode.ABORTED, str(error), values)
        else:
            status = _STATUS_BY_RESULT.get(result.status, wire.GoalStatusCode.ABORTED)
            text = ""
            if isinstance(result, EndedGoal):
                status, text = wire.GoalStatusCode.REJECTED if result.rejected else status, result.text
            self._finish(goal, status, text, result.values)

    def _feedback_publisher(self, goal: _Goal) -> Callable[[Any, object], None]:
        def send(_: Any, values: object) -> None:
            self._feedback.publish_encoded(self._encode(goal, "feedback", values))

        return send

    def _set_active(self, goal: _Goal) -> None:
        if goal.status is wire.GoalStatusCode.PENDING:
            goal.status = wire.GoalStatusCode.ACTIVE

    def _reject_goal(self, id: str, error: MindstageError) -> None:
        """Publishes the result of a goal that is not valid."""
        values = encode(failure_response(self._action.Result, error, str(error)), ros=self._ros)
        self._finish(_Goal(wire.GoalID(id=id), None), wire.GoalStatusCode.REJECTED, str(error), values)

    def _finish(self, goal: _Goal, status: wire.GoalStatusCode, text: str, values: object) -> None:
        goal.status, goal.text, goal.ended_at = status, text, time.monotonic()
        if values is None:
            values = encode(self._action.Result(), ros=self._ros)
        self._result.publish_encoded(self._encode(goal, "result", values))

    def _encode(self, goal: _Goal, kind: str, values: object) -> dict[str, object]:
        header, status = encode(std_msgs.Header(), ros=self._ros), encode(goal.to_message(), ros=self._ros)
        return {"header": header, "status": status, kind: values}


def _message_class(action: Any, part: type[Message]) -> Any:
    return action[part]


def _goal_id(message: object) -> str:
    id = message.get("goal_id") if isinstance(message, dict) else None
    return str(id.get("id", "")) if isinstance(id, dict) else ""
