"""Outcomes: the three ends of a call on the wire.

It succeeds; the world says no (`success: false`, or a result code of simulation_interfaces), and why is told on the
diagnostics too; or it breaks for a reason outside of the world, and whoever called hears a text (`result: false`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mindstage.bridge.description import error_text, error_to_message
from mindstage.errors import BodyNotFoundError, EngineError, MindstageError, WorldError
from mindstage.msgs import Message, RosVersion, Service, decode_arguments, encode, simulation_interfaces
from mindstage.ros.diagnostics import DiagnosticsPublisher
from mindstage.ros.results import ResultError

__all__ = ["engine_error_text", "refusal_response", "service_handler"]


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
