"""Results: how a call of simulation_interfaces ended, in its own codes."""

from __future__ import annotations

from mindstage.msgs import simulation_interfaces

__all__ = ["OK", "ResultError", "failed", "incorrect_state", "not_found", "unsupported"]

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
