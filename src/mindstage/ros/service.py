"""Job: a goal that is being reached for: it tells how it goes, and looks whether it shall be given up.

Whoever works at it does so in pieces and calls `check` between them. It raises what ends the work early, so that the
work itself is written as if it always went through.

Results: how a call of simulation_interfaces ended, in its own codes.

Outcomes: the three ends of a call on the wire.

It succeeds; the world says no (`success: false`, or a result code of simulation_interfaces), and why is told on the
diagnostics too; or it breaks for a reason outside of the world, and whoever called hears a text (`result: false`).

Offer: a service or an action as a part of the face declares it: a type, and a function over its messages.

Reaching: the handler of an action, for both of the ways in which goals come.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from mindstage.bridge import GoalResult, ServerGoalHandle
from mindstage.bridge.conversions import error_text, error_to_message
from mindstage.errors import BodyNotFoundError, EngineError, MindstageError, SimulationTimeoutError, WorldError
from mindstage.msgs import (
    Action,
    Message,
    RosVersion,
    Service,
    decode_arguments,
    encode,
    simulation_interfaces,
    snake_case,
)
from mindstage.ros.diagnostics import DiagnosticsPublisher

__all__ = [
    "FEEDBACK_INTERVAL_S",
    "OK",
    "ActionSpec",
    "GoalCanceled",
    "GoalContext",
    "ResultError",
    "ServiceSpec",
    "action_handler",
    "engine_error_text",
    "failed",
    "incorrect_state",
    "not_found",
    "refusal_response",
    "service_handler",
    "unsupported",
]


OK = simulation_interfaces.Result(result=simulation_interfaces.ResultCode.RESULT_OK)


class ResultError(Exception):
    """Ends a call with a code, from wherever it becomes clear."""

    def __init__(self, code: int, message: str) -> None:
        self.result = simulation_interfaces.Result(result=code, error_message=message)
        super().__init__(message)


def unsupported(message: str) -> ResultError:
    """There is no such feature here."""
    return ResultError(simulation_interfaces.ResultCode.RESULT_FEATURE_UNSUPPORTED, message)


def not_found(message: str) -> ResultError:
    """Nothing has that name."""
    return ResultError(simulation_interfaces.ResultCode.RESULT_NOT_FOUND, message)


def incorrect_state(message: str) -> ResultError:
    """Not while the simulation is as it is."""
    return ResultError(simulation_interfaces.ResultCode.RESULT_INCORRECT_STATE, message)


def failed(message: str) -> ResultError:
    """It was tried and did not work."""
    return ResultError(simulation_interfaces.ResultCode.RESULT_OPERATION_FAILED, message)


def service_handler(
    name: str,
    service: type[Service],
    handler: Callable[[Any], Any],
    *,
    diagnostics: DiagnosticsPublisher,
    ros: RosVersion,
) -> Callable[[object], object]:
    """The handler of a service: messages in and out, and every end told as it has to be."""

    def handle(args: object) -> object:
        request = decode_arguments(service.Request, args)
        try:
            reply = handler(request)
        except WorldError as error:
            diagnostics.report_refusal(name, error)
            reply = refusal_response(service.Response, error)
        except ResultError as error:
            diagnostics.report_failures(name, [(str(getattr(request, "entity", "")), str(error))])
            reply = service.Response(result=error.result)
        except EngineError as error:
            diagnostics.report_error(name, error)
            raise MindstageError(error_text(error)) from error
        return encode(reply, ros=ros)

    return handle


def refusal_response(response: type[Message], error: WorldError) -> Message:
    """The reply that says no.

    Raises:
        WorldError: the type has no way to say it.
    """
    fields = response.__struct_fields__
    if "result" in fields:
        code = (
            simulation_interfaces.ResultCode.RESULT_NOT_FOUND
            if isinstance(error, BodyNotFoundError)
            else simulation_interfaces.ResultCode.RESULT_OPERATION_FAILED
        )
        return response(result=simulation_interfaces.Result(result=code, error_message=str(error)))
    if "success" not in fields:
        raise error
    return response(refusal=error_to_message(error)) if "refusal" in fields else response()


def engine_error_text(error: MindstageError) -> str:
    """What broke, as the text that ends a call or a goal."""
    return error_text(error) if isinstance(error, EngineError) else str(error)


FEEDBACK_INTERVAL_S = 0.4
"""Whoever waits hears at least this often how it goes [s]."""


class GoalCanceled(Exception):
    """The goal shall not be reached any more."""


class GoalContext:
    """One goal under way."""

    def __init__(
        self, name: str, *, timeout_s: float, is_cancelled: Callable[[], bool], send_feedback: Callable[[Message], None]
    ) -> None:
        """It begins now.

        Args:
            name: the action's, for errors.
            timeout_s: how long it may take [s].
            is_cancelled: whether it shall be given up.
            tell: passes feedback on.
        """
        self.name = name
        self.timeout_s = timeout_s
        self._deadline = time.monotonic() + timeout_s
        self._is_cancelled = is_cancelled
        self._send_feedback = send_feedback
        self._last_feedback_s = 0.0

    @property
    def cancelled(self) -> bool:
        """Whether it shall be given up."""
        return self._is_cancelled()

    def send_feedback(self, feedback: Message) -> None:
        """Tells how it goes, now."""
        self._send_feedback(feedback)

    def check(self, make_feedback: Callable[[], Message]) -> None:
        """Tells how it goes if it is time to, and lets the work go on.

        Args:
            feedback: makes the message, when one is due.

        Raises:
            GoalCanceled: it was canceled.
            SimulationTimeoutError: it takes too long.
        """
        if self._is_cancelled():
            raise GoalCanceled
        now = time.monotonic()
        if now > self._deadline:
            raise SimulationTimeoutError(self.name, timeout_s=self.timeout_s)
        if now - self._last_feedback_s >= FEEDBACK_INTERVAL_S:
            self._last_feedback_s = now
            self._send_feedback(make_feedback())

    @contextmanager
    def sending_feedback(self, make_feedback: Callable[[], Message]) -> Iterator[None]:
        """Tells how it goes, again and again, while something goes on that cannot be divided."""
        over = threading.Event()

        def tell() -> None:
            while True:
                self._send_feedback(make_feedback())
                if over.wait(FEEDBACK_INTERVAL_S):
                    return

        teller = threading.Thread(target=tell, name="mindstage-feedback", daemon=True)
        teller.start()
        try:
            yield
        finally:
            over.set()
            teller.join()


@dataclass(frozen=True, slots=True)
class ServiceSpec:
    """One service."""

    type: type[Service]
    handler: Callable[[Any], Any]
    """Gets the type's request and gives its response; what it raises tells how else it ended."""
    name: str = ""
    """Below the namespace, or from the root where it begins with a slash; by default the type's own, in snake case."""
    quick: bool = False
    """Whether it never waits, not even for the stage."""
    timeout_s: float | None = None
    """How long callers wait who do not say it; by default as long as the hub has it [s]."""

    def full_name(self, namespace: str) -> str:
        """Its full name."""
        return _full_name(self.name or snake_case(self.type), namespace)


@dataclass(frozen=True, slots=True)
class ActionSpec:
    """One action."""

    type: type[Action]
    handler: Callable[[Any, GoalContext], Any]
    """Gets the type's goal and what is needed to reach for it, and gives its result."""
    name: str = ""
    """As of a service."""

    def full_name(self, namespace: str) -> str:
        """Its full name."""
        return _full_name(self.name or snake_case(self.type), namespace)


def _full_name(name: str, namespace: str) -> str:
    return name if name.startswith("/") else "/".join(("", *filter(None, namespace.split("/")), name))


def action_handler(
    name: str, spec: ActionSpec, *, diagnostics: DiagnosticsPublisher, ros: RosVersion, timeout_s: float
) -> Callable[[ServerGoalHandle], GoalResult]:
    """The handler: messages in and out, and every end told as it has to be.

    Args:
        name: the action's.
        offer: what it is.
        diagnostics: told what was refused.
        ros: whose words to use.
        timeout_s: how long a goal may take [s].
    """

    def handle(goal: ServerGoalHandle) -> GoalResult:
        wanted = decode_arguments(spec.type.Goal, goal.args)
        job = GoalContext(
            name,
            timeout_s=timeout_s,
            is_cancelled=lambda: goal.cancel_requested,
            send_feedback=lambda feedback: goal.feedback(encode(feedback, ros=ros)),
        )
        try:
            result = spec.handler(wanted, job)
        except GoalCanceled:
            return goal.canceled(encode(_canceled_result(spec.type.Result), ros=ros))
        except ResultError as error:
            diagnostics.report_failures(name, [("", str(error))])
            return goal.aborted(encode(spec.type.Result(result=error.result), ros=ros))
        except WorldError as error:
            diagnostics.report_refusal(name, error)
            return goal.aborted(encode(refusal_response(spec.type.Result, error), ros=ros))
        except EngineError as error:
            diagnostics.report_error(name, error)
            raise MindstageError(engine_error_text(error)) from error
        succeeded = getattr(result, "success", True)
        return (goal.succeeded if succeeded else goal.aborted)(encode(result, ros=ros))

    return handle


def _canceled_result(result: type[Message]) -> Message:
    if "result" not in result.__struct_fields__:
        return result()
    told = simulation_interfaces.Result(
        result=simulation_interfaces.ResultCode.RESULT_OPERATION_FAILED, error_message="it was cancelled"
    )
    return result(result=told)
