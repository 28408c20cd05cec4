"""Declarations and handlers of services and actions, with one mapping of errors to responses.

A call succeeds, or the world rejects it (`success: false`, or a result code of simulation_interfaces; the reason is
also published on the diagnostics), or it fails for another reason (`result: false` with the error message, which is
published too). Another rosbridge transmits only messages of the type; there, a failed call returns the failure as far
as the type can express it.

The handler of an action calls `GoalContext.check` regularly, which sends feedback and raises an exception when the goal
is canceled or its time is over.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeVar

from mindstage.access.limits import NAMES_TIME
from mindstage.access.policies import Policy
from mindstage.access.resources import values_without_paths, without_paths
from mindstage.bridge import GoalResult, GoalStatus, Refusal, RosbridgeClient, ServerGoalHandle
from mindstage.bridge.conversions import error_text, error_to_message
from mindstage.errors import (
    AdvertiseError,
    BodyNotFoundError,
    BridgeError,
    EngineError,
    FailureResponseError,
    MessageValidationError,
    MindstageError,
    SimulationTimeoutError,
    WorldError,
)
from mindstage.msgs import (
    Action,
    Message,
    RosVersion,
    Service,
    control_msgs,
    decode_arguments,
    encode,
    geometry_msgs,
    mindstage_msgs,
    nav2_msgs,
    simulation_interfaces,
    snake_case,
    type_name,
    visualization_msgs,
)
from mindstage.msgs.schema.base import fields_of, struct_of
from mindstage.ranges import Component, Coordinate, Range, RotationQuaternion, declared_range
from mindstage.ros.diagnostics import DiagnosticsPublisher
from mindstage.simulation.observation import as_client

__all__ = [
    "FEEDBACK_INTERVAL_S",
    "OK",
    "ActionSpec",
    "EndedGoal",
    "GoalAbortedError",
    "GoalCanceledError",
    "GoalContext",
    "ResultError",
    "ServiceSpec",
    "action_handler",
    "batch_handler",
    "decode_request",
    "failed",
    "failure_response",
    "mapped",
    "names_elsewhere",
    "refusal_response",
    "service_handler",
    "unsupported",
]


M = TypeVar("M", bound=Message)
T = TypeVar("T")
R = TypeVar("R")
OK = simulation_interfaces.Result(result=simulation_interfaces.ResultCode.RESULT_OK)
FEEDBACK_INTERVAL_S = 0.4
"""Longest time between two feedback messages [s]."""
_log = logging.getLogger("mindstage.ros")


class ResultError(Exception):
    """Ends a call with a result code of simulation_interfaces."""

    def __init__(self, code: int, message: str) -> None:
        self.result = simulation_interfaces.Result(result=code, error_message=message)
        super().__init__(message)


def unsupported(message: str) -> ResultError:
    """Returns the error for a feature that is not supported."""
    return ResultError(simulation_interfaces.ResultCode.RESULT_FEATURE_UNSUPPORTED, message)


def failed(message: str) -> ResultError:
    """Returns the error for an operation that failed."""
    return ResultError(simulation_interfaces.ResultCode.RESULT_OPERATION_FAILED, message)


def service_handler(
    name: str,
    service: type[Service],
    handler: Callable[[Any], Any],
    *,
    diagnostics: DiagnosticsPublisher,
    ros: RosVersion,
) -> Callable[[object], object]:
    """Returns the handler of a service for a node, which decodes and encodes messages and maps errors to responses."""
    failure_to_response = _error_mapping(name, service, diagnostics=diagnostics, ros=ros)

    def handle(args: object) -> object:
        request = None

        def call() -> Any:
            nonlocal request
            request = decode_request(service.Request, args)
            with as_client(f"ROS: {name}"):
                return handler(request)

        def encoded(get_response: Callable[[], Any]) -> object:
            try:
                response = get_response()
            except (MindstageError, ResultError) as error:
                failure = encode(failure_to_response(error, request), ros=ros)
                return values_without_paths(failure, given=repr(request))
            if isinstance(response, Future):
                return mapped(response, lambda done: encoded(done.result))
            return encode(response, ros=ros)

        return encoded(call)

    return handle


class _MappedFuture(Future[R]):
    def __init__(self, source: Future[Any]) -> None:
        super().__init__()
        self._source = source

    def cancel(self) -> bool:
        return self._source.cancel()


def mapped(future: Future[T], function: Callable[[Future[T]], R]) -> Future[R]:
    """A future of what a function makes of another one when that has ended, in the thread that ends it.

    Canceling it cancels the other one.
    """
    result: _MappedFuture[R] = _MappedFuture(future)

    def end(done: Future[T]) -> None:
        if done.cancelled():
            Future.cancel(result)
            return
        try:
            result.set_result(function(done))
        except Exception as error:
            result.set_exception(error)

    future.add_done_callback(end)
    return result


def batch_handler(
    name: str,
    service: type[Service],
    handler: Callable[[list[Any]], Sequence[Any]],
    *,
    diagnostics: DiagnosticsPublisher,
    ros: RosVersion,
) -> Callable[[list[object]], list[object]]:
    """Returns the handler of consecutive calls of a service, as `service_handler`; see `ServiceSpec.batched`."""
    failure_to_response = _error_mapping(name, service, diagnostics=diagnostics, ros=ros)

    def encode_result(result: Any, request: object) -> object:
        try:
            if isinstance(result, Exception):
                failure = encode(failure_to_response(result, request), ros=ros)
                return values_without_paths(failure, given=repr(request))
            return encode(result, ros=ros)
        except Exception as error:
            return error

    def handle(calls: list[object]) -> list[object]:
        requests: list[Any] = []
        for args in calls:
            try:
                requests.append(decode_request(service.Request, args))
            except MindstageError as error:
                requests.append(error)
        valid = [request for request in requests if not isinstance(request, Exception)]
        with as_client(f"ROS: {name}"):
            results = iter(handler(valid) if valid else ())
        answers = [request if isinstance(request, Exception) else next(results) for request in requests]
        return [encode_result(*each) for each in zip(answers, requests, strict=True)]

    return handle


def decode_request(cls: type[M], args: object) -> M:
    """Decodes a request, a goal or a message from a client, and checks the coordinates in it.

    Their types are those of ROS, which have every float64; published messages are not checked, since bodies may be
    anywhere.

    Raises:
        MessageValidationError: it is not of that type, or a coordinate is beyond its range.
    """
    request = decode_arguments(cls, args)
    for path, message in _geometry_in(request, ""):
        range = _RANGES[type(message)]
        for name in message.__struct_fields__:
            if (value := getattr(message, name)) not in range:
                cause = f"{value:g} is not {range.text}"
                raise MessageValidationError(type_name(cls), path=f"{path}{name}", cause=cause)
    return request


_RANGES: Mapping[type[Message], Range] = {
    geometry_msgs.Point: declared_range(Coordinate),
    geometry_msgs.Quaternion: declared_range(RotationQuaternion),
    geometry_msgs.Vector3: declared_range(Component),
}


def _geometry_in(message: Message, path: str) -> Iterator[tuple[str, Message]]:
    """The points, rotations and vectors in a message, with the begin of the paths of their fields."""
    if type(message) in _RANGES:
        yield path, message
        return
    for name in _fields_with_geometry(type(message)):
        value = getattr(message, name)
        parts = enumerate(value) if isinstance(value, list | tuple) else ((None, value),)
        for at, part in parts:
            yield from _geometry_in(part, f"{path}{name}." if at is None else f"{path}{name}[{at}].")


@cache
def _fields_with_geometry(cls: Any) -> tuple[str, ...]:
    found = zip(struct_of(cls).__struct_fields__, fields_of(cls), strict=True)
    return tuple(name for name, field in found if field.message and _has_geometry(field.message))


def _has_geometry(cls: Any) -> bool:
    return struct_of(cls) in _RANGES or bool(_fields_with_geometry(struct_of(cls)))


def _error_mapping(
    name: str, service: type[Service], *, diagnostics: DiagnosticsPublisher, ros: RosVersion
) -> Callable[[Exception, object], Message]:
    """Returns a function that reports the error of a request and returns the response for it, or raises another."""

    def failure_to_response(error: Exception, request: object) -> Message:
        match error:
            case WorldError():
                diagnostics.report_refusal(name, error)
                return refusal_response(service.Response, error)
            case ResultError():
                diagnostics.report_failures(name, [(str(getattr(request, "entity", "")), str(error))])
                return service.Response(result=error.result)
            case MindstageError():
                diagnostics.report_error(name, error)
                text = error_text(error) if isinstance(error, EngineError) else str(error)
                text = without_paths(text, given=repr(request))
                failure = encode(failure_response(service.Response, error, text), ros=ros)
                raise FailureResponseError(text, response=failure) from error
        raise error

    return failure_to_response


def failure_response(response: type[Message], error: MindstageError, text: str) -> Message:
    """Returns the response for a failure that is not an error of the world, as far as the type can express it.

    Args:
        response: the type; its default is returned if it has no field for a failure.
        error: the failure.
        text: its message.
    """
    fields = response.__struct_fields__
    if _has_result_code(response):
        code = simulation_interfaces.ResultCode.RESULT_OPERATION_FAILED
        return response(result=simulation_interfaces.Result(result=code, error_message=text))
    if "refusal" in fields:
        return response(refusal=mindstage_msgs.Refusal(code=error.code, text=text))
    if response in _FAILURE_CODES:
        code_of_failure, text_field = _FAILURE_CODES[response]
        return response(**{"error_code": code_of_failure, text_field: text})
    return response()


_FAILURE_CODES: Mapping[type[Message], tuple[int, str]] = {
    control_msgs.FollowJointTrajectory.Result: (control_msgs.FollowJointTrajectoryCode.INVALID_GOAL, "error_string"),
    nav2_msgs.NavigateToPose.Result: (nav2_msgs.NavigateToPose.Result.UNKNOWN, "error_msg"),
}
"""The code of a failure without a more exact one, and the field of its reason; the default code means success."""


def _has_result_code(response: type[Message]) -> bool:
    """Whether a response has a `Result` of simulation_interfaces; in others, a field of that name may be a text."""
    return isinstance(getattr(response(), "result", None), simulation_interfaces.Result)


def refusal_response(response: type[Message], error: WorldError) -> Message:
    """Returns the response for an operation that the world rejected.

    Raises:
        WorldError: the type has no field for it.
    """
    fields = response.__struct_fields__
    if _has_result_code(response):
        code = (
            simulation_interfaces.ResultCode.RESULT_NOT_FOUND
            if isinstance(error, BodyNotFoundError)
            else simulation_interfaces.ResultCode.RESULT_OPERATION_FAILED
        )
        return response(result=simulation_interfaces.Result(result=code, error_message=str(error)))
    if "success" not in fields:
        raise error
    return response(refusal=error_to_message(error)) if "refusal" in fields else response()


def names_elsewhere(node: RosbridgeClient, names: Iterable[str], *, namespace: str, ros: RosVersion) -> frozenset[str]:
    """Returns those names outside the namespace that another client of a server already provides.

    They are left to it, and reported as refusals. If names in the namespace exist, another simulation might be running
    there; it is if a message of it arrives. Otherwise they are left over from a connection that has ended (a rosbridge
    of ROS 1 does not remove services then), and can be replaced.

    Args:
        node: the connection to the server. If the server has no rosapi, nothing is checked.
        names: absolute names of services.
        namespace: the namespace of this simulation.
        ros: version of ROS for type names.

    Raises:
        AdvertiseError: another simulation in the same namespace is running at the server.
    """
    try:
        existing = set(node.call_service("/rosapi/services", {}, timeout_s=NAMES_TIME.maximum)["services"])
    except (BridgeError, KeyError, TypeError) as error:
        _log.info("%s does not list its services, so name clashes are not detected: %s", node.url, error)
        return frozenset()
    prefix = "/".join(("", *filter(None, namespace.split("/")), ""))
    taken = sorted(existing.intersection(names))
    inside = [name for name in taken if name.startswith(prefix)]
    if inside and _is_published(node, f"{prefix}world", ros=ros):
        others = f" and {len(inside) - 1} more" if len(inside) > 1 else ""
        cause = f"another simulation at {node.url} provides it{others}; choose another namespace (--namespace)"
        raise AdvertiseError(inside[0], cause=cause)
    if inside:
        _log.info("%s has %d services of an ended connection, which are replaced", node.url, len(inside))
        return frozenset()
    for name in taken:
        cause = f"another client of the server provides it; use {prefix}mindstage/ask"
        node.report_refusal(Refusal(operation="advertise_service", name=name, cause=cause))
    return frozenset(taken)


def _is_published(node: RosbridgeClient, topic: str, *, ros: RosVersion) -> bool:
    """Whether a message on a topic with markers of the world arrives."""
    arrived = threading.Event()
    type = type_name(visualization_msgs.MarkerArray, ros)
    subscription = node.subscribe(topic, lambda _: arrived.set(), type=type)
    try:
        return arrived.wait(NAMES_TIME.maximum)
    finally:
        subscription.close()


class GoalCanceledError(Exception):
    """The goal was canceled."""

    def __init__(self, result: Message | None = None, *, reason: str = "") -> None:
        super().__init__(reason or "the goal was canceled")
        self.reason = reason
        """Why, if its client did not cancel it."""
        self.result = result
        """What is known by then; None for the default of the type."""


class GoalAbortedError(Exception):
    """The goal was not reached, or was rejected before it began."""

    def __init__(self, result: Message, *, reason: str, rejected: bool = False) -> None:
        super().__init__(reason)
        self.result = result
        self.rejected = rejected


class EndedGoal(GoalResult, frozen=True):
    """The result of a goal, with what actionlib adds to it."""

    text: str = ""
    """Why it ended; the text of the status in ROS 1."""
    rejected: bool = False
    """Whether it did not begin; a status of its own in ROS 1."""


class GoalContext:
    """Cancellation, timeout and feedback of one goal."""

    def __init__(
        self,
        name: str,
        *,
        timeout_s: float,
        is_cancelled: Callable[[], bool],
        send_feedback: Callable[[Message], None],
        wait_for_cancel: Callable[[float], bool],
        on_cancel: Callable[[Callable[[], object]], object],
    ) -> None:
        """Starts the timeout.

        Args:
            name: name of the action, for errors.
            timeout_s: largest duration of the goal [s].
            is_cancelled: returns whether cancellation was requested.
            wait_for_cancel: sleeps for a time [s], at most until cancellation is requested.
            on_cancel: registers a callback for the request; see `ServerGoalHandle.on_cancel`.
        """
        self.name = name
        self.timeout_s = timeout_s
        self._deadline = time.monotonic() + timeout_s
        self._is_cancelled = is_cancelled
        self._send_feedback = send_feedback
        self._wait_for_cancel = wait_for_cancel
        self._on_cancel = on_cancel
        self._last_feedback_s = 0.0

    @property
    def cancelled(self) -> bool:
        """Whether cancellation was requested."""
        return self._is_cancelled()

    def on_cancel(self, callback: Callable[[], object]) -> None:
        """Registers a callback that is called at once when cancellation is requested; see `ServerGoalHandle`."""
        self._on_cancel(callback)

    def send_feedback(self, feedback: Message) -> None:
        """Sends feedback now."""
        self._send_feedback(feedback)

    def wait(self, duration_s: float) -> None:
        """Sleeps, at most until cancellation is requested [s]."""
        self._wait_for_cancel(duration_s)

    def check(
        self, make_feedback: Callable[[], Message | None] | None, *, interval_s: float = FEEDBACK_INTERVAL_S
    ) -> None:
        """Sends feedback if it is due.

        Args:
            make_feedback: creates the feedback message, or returns None while there is none; None for no feedback.
            interval_s: least time between two feedback messages [s].

        Raises:
            GoalCanceledError: cancellation was requested.
            SimulationTimeoutError: the goal takes too long.
        """
        if self._is_cancelled():
            raise GoalCanceledError
        now = time.monotonic()
        if now > self._deadline:
            raise SimulationTimeoutError(self.name, timeout_s=self.timeout_s)
        if make_feedback is not None and now - self._last_feedback_s >= interval_s:
            feedback = make_feedback()
            if feedback is not None:
                self._last_feedback_s = now
                self._send_feedback(feedback)

    @contextmanager
    def sending_feedback(self, make_feedback: Callable[[], Message]) -> Iterator[None]:
        """Sends feedback periodically during an operation that cannot be divided."""
        finished = threading.Event()

        def send() -> None:
            while True:
                self._send_feedback(make_feedback())
                if finished.wait(FEEDBACK_INTERVAL_S):
                    return

        thread = threading.Thread(target=send, name="mindstage-feedback", daemon=True)
        thread.start()
        try:
            yield
        finally:
            finished.set()
            thread.join()


@dataclass(frozen=True, slots=True)
class ServiceSpec:
    """Declaration of a service."""

    type: type[Service]
    handler: Callable[[Any], Any]
    """Called with the request, returns the response, or a future of it; see the module for its exceptions."""
    policy: Policy
    name: str = ""
    """Relative to the namespace, or absolute if it begins with a slash; by default the type in snake case."""
    quick: bool = False
    """Whether the handler never blocks, not even for the simulation."""
    batched: bool = False
    """Whether the handler is called with the requests of all consecutive calls of one client that wait, and returns the
    response or the exception of each.
    """

    def full_name(self, namespace: str) -> str:
        """Returns its absolute name."""
        return _full_name(self.name or snake_case(self.type), namespace)


@dataclass(frozen=True, slots=True)
class ActionSpec:
    """Declaration of an action."""

    type: type[Action]
    handler: Callable[[Any, GoalContext], Any]
    """Called with the goal and its context, returns the result."""
    policy: Policy
    name: str = ""
    """As of a service."""

    def full_name(self, namespace: str) -> str:
        """Returns its absolute name."""
        return _full_name(self.name or snake_case(self.type), namespace)


def _full_name(name: str, namespace: str) -> str:
    return name if name.startswith("/") else "/".join(("", *filter(None, namespace.split("/")), name))


def action_handler(
    name: str, spec: ActionSpec, *, diagnostics: DiagnosticsPublisher, ros: RosVersion, timeout_s: float
) -> Callable[[ServerGoalHandle], GoalResult]:
    """Returns the handler of an action for a node, which decodes and encodes messages and maps errors to results.

    Args:
        name: name of the action.
        spec: its declaration.
        diagnostics: publishes errors.
        ros: version of ROS for the encoded messages.
        timeout_s: largest duration of a goal [s].
    """

    def failure(error: MindstageError, text: str) -> FailureResponseError:
        response = encode(failure_response(spec.type.Result, error, text), ros=ros)
        return FailureResponseError(text, response=response)

    def handle(goal: ServerGoalHandle) -> GoalResult:
        try:
            request = decode_request(spec.type.Goal, goal.args)
        except MindstageError as error:
            raise failure(error, without_paths(str(error))) from error
        context = GoalContext(
            name,
            timeout_s=timeout_s,
            is_cancelled=lambda: goal.cancel_requested,
            send_feedback=lambda feedback: goal.feedback(encode(feedback, ros=ros)),
            wait_for_cancel=goal.wait_for_cancel,
            on_cancel=goal.on_cancel,
        )
        try:
            with as_client(f"ROS: {name}"):
                result = spec.handler(request, context)
        except GoalCanceledError as canceled:
            result = canceled.result if canceled.result is not None else _canceled_result(spec.type.Result)
            return EndedGoal(GoalStatus.CANCELED, encode(result, ros=ros), text=canceled.reason)
        except GoalAbortedError as ended:
            diagnostics.report_failures(name, [("", str(ended))])
            values = values_without_paths(encode(ended.result, ros=ros), given=repr(request))
            text = without_paths(str(ended), given=repr(request))
            return EndedGoal(GoalStatus.ABORTED, values, text=text, rejected=ended.rejected)
        except ResultError as error:
            diagnostics.report_failures(name, [("", str(error))])
            values = encode(spec.type.Result(result=error.result), ros=ros)
            return goal.aborted(values_without_paths(values, given=repr(request)))
        except WorldError as error:
            diagnostics.report_refusal(name, error)
            values = encode(refusal_response(spec.type.Result, error), ros=ros)
            return goal.aborted(values_without_paths(values, given=repr(request)))
        except EngineError as error:
            diagnostics.report_error(name, error)
            raise failure(error, without_paths(error_text(error))) from error
        succeeded = getattr(result, "success", True)
        return (goal.succeeded if succeeded else goal.aborted)(encode(result, ros=ros))

    return handle


def _canceled_result(result: type[Message]) -> Message:
    if not _has_result_code(result):
        return result()
    canceled = simulation_interfaces.Result(
        result=simulation_interfaces.ResultCode.RESULT_OPERATION_FAILED, error_message="it was canceled"
    )
    return result(result=canceled)
