"""Reaching: the handler of an action, for both of the ways in which goals come."""

from __future__ import annotations

from collections.abc import Callable

from mindstage.bridge import GoalOutcome, ServedGoal
from mindstage.errors import EngineError, MindstageError, WorldError
from mindstage.msgs import Message, RosVersion, decode_arguments, encode, simulation_interfaces
from mindstage.ros.diagnostics import Diagnostics
from mindstage.ros.job import GoalGivenUp, Job
from mindstage.ros.offer import ActionOffer
from mindstage.ros.outcomes import engine_text, refused
from mindstage.ros.results import ResultError

__all__ = ["reaching"]


def reaching(
    name: str, offer: ActionOffer, *, diagnostics: Diagnostics, ros: RosVersion, timeout_s: float
) -> Callable[[ServedGoal], GoalOutcome]:
    """The handler: messages in and out, and every end told as it has to be.

    Args:
        name: the action's.
        offer: what it is.
        diagnostics: told what was refused.
        ros: whose words to use.
        timeout_s: how long a goal may take [s].
    """

    def handle(goal: ServedGoal) -> GoalOutcome:
        wanted = decode_arguments(offer.type.Goal, goal.args)
        job = Job(
            name,
            timeout_s=timeout_s,
            is_cancelled=lambda: goal.cancel_requested,
            tell=lambda feedback: goal.feedback(encode(feedback, ros=ros)),
        )
        try:
            result = offer.reach(wanted, job)
        except GoalGivenUp:
            return goal.canceled(encode(_given_up(offer.type.Result), ros=ros))
        except ResultError as error:
            diagnostics.failed(name, [("", str(error))])
            return goal.aborted(encode(offer.type.Result(result=error.result), ros=ros))
        except WorldError as error:
            diagnostics.refused(name, error)
            return goal.aborted(encode(refused(offer.type.Result, error), ros=ros))
        except EngineError as error:
            diagnostics.broke(name, error)
            raise MindstageError(engine_text(error)) from error
        succeeded = getattr(result, "success", True)
        return (goal.succeeded if succeeded else goal.aborted)(encode(result, ros=ros))

    return handle


def _given_up(result: type[Message]) -> Message:
    if "result" not in result.__struct_fields__:
        return result()
    told = simulation_interfaces.Result(
        result=simulation_interfaces.ResultCode.RESULT_OPERATION_FAILED, error_message="it was cancelled"
    )
    return result(result=told)
