"""Reaching: the handler of an action, for both of the ways in which goals come."""

from __future__ import annotations

from collections.abc import Callable

from mindstage.bridge import GoalResult, ServerGoalHandle
from mindstage.errors import EngineError, MindstageError, WorldError
from mindstage.msgs import Message, RosVersion, decode_arguments, encode, simulation_interfaces
from mindstage.ros.diagnostics import DiagnosticsPublisher
from mindstage.ros.job import GoalCanceled, GoalContext
from mindstage.ros.offer import ActionSpec
from mindstage.ros.outcomes import engine_error_text, refusal_response
from mindstage.ros.results import ResultError

__all__ = ["action_handler"]


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
