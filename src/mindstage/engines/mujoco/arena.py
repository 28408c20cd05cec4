"""Arenas: the memory that MuJoCo has for contacts, constraints and its stack, sized by need.

MuJoCo allocates the arena of a model once. Its default size grows with the square of the degrees of freedom, 11 GB of
address space for 20 kitchens, of which a simulation uses a few parts in a thousand. Here it begins small and grows when
it is exhausted.

An arena that is exhausted shows itself in two ways. If the stack does not fit, MuJoCo raises `mujoco.FatalError`. If
contacts or constraints do not fit, it only counts a warning and continues without them: the step is wrong, and has to
be repeated from the state before it.
"""

from __future__ import annotations

import ctypes
from typing import Any

import mujoco

from mindstage.errors import EngineError, EngineMemoryError

__all__ = [
    "ARENA_CAP_BYTES",
    "check_arena",
    "copy_state",
    "first_arena_size",
    "is_exhausted",
    "larger_model",
    "new_data",
    "run_mujoco",
]

ARENA_CAP_BYTES = 4 * 2**30
"""The largest arena: enough for about a million contacts, or 30,000 bodies that can move."""
_BASE_BYTES = 2**20
_BYTES_PER_BODY = 35_000
"""For 8 contacts of 4.4 kB with their constraints, as measured in a dense pile; in stacks a contact needs 1.7 kB."""
_BYTES_PER_PAIR = 4
"""For each pair of bodies on the stack, as measured for 500 to 5,000 awake bodies."""
_FULL = (int(mujoco.mjtWarning.mjWARN_CONTACTFULL), int(mujoco.mjtWarning.mjWARN_CNSTRFULL))
_HEADER_WORDS = 128
"""The sizes stand at the beginning of MuJoCo's structures, which are much longer."""


def first_arena_size(bodies: int, *, used_bytes: int, cap_bytes: int) -> int:
    """The size of the arena of a new model.

    Args:
        bodies: the number of MuJoCo's bodies.
        used_bytes: how much of its arena the model before it has used; 0 for a first model.
        cap_bytes: the largest size.
    """
    return min(cap_bytes, max(_smallest_size(bodies) + _BYTES_PER_BODY * bodies, 2 * used_bytes))


def check_arena(bodies: int, *, cap_bytes: int) -> None:
    """Checks that bodies can be simulated at all, before they are added.

    Raises:
        EngineMemoryError: they need more memory than an arena may have, even without contacts.
    """
    if (needed := _smallest_size(bodies)) > cap_bytes:
        raise _memory_error(f"{bodies:,} bodies that can move", needed, cap_bytes)


def _smallest_size(bodies: int) -> int:
    return _BASE_BYTES + _BYTES_PER_PAIR * bodies**2


def _memory_error(what: str, needed_bytes: int, cap_bytes: int) -> EngineMemoryError:
    return EngineMemoryError(what=what, needed_mb=needed_bytes / 2**20, cap_mb=cap_bytes / 2**20)


def run_mujoco(function: Any, *arguments: Any, **options: Any) -> bool:
    """Calls a function of MuJoCo; returns False if the stack did not fit into the arena, and the data are invalid.

    Raises:
        EngineError: MuJoCo failed for another reason.
    """
    try:
        function(*arguments, **options)
    except mujoco.FatalError as error:
        if "stack overflow" not in str(error):
            raise EngineError(f"MuJoCo failed: {error}") from error
        return False
    return True


def is_exhausted(data: Any) -> bool:
    """Whether contacts or constraints were left out since the warnings of `data` were cleared."""
    counts = data.warning.number.tolist()
    return any(counts[kind] for kind in _FULL)


def larger_model(model: Any, data: Any, *, cap_bytes: int) -> Any:
    """A copy of a model with an arena of twice the size.

    Args:
        model: the model, which is not changed.
        data: its data, whose numbers are part of the error.
        cap_bytes: the largest size.

    Raises:
        EngineMemoryError: the arena has the largest size already.
    """
    if model.narena >= cap_bytes:
        raise _memory_error(f"{model.nbody:,} bodies with {data.ncon:,} or more contacts", 2 * model.narena, cap_bytes)
    result = model.__copy__()
    _set_arena_size(result, min(2 * model.narena, cap_bytes))
    return result


def new_data(model: Any) -> Any:
    """New data of a model.

    Raises:
        EngineError: the system has not enough memory.
    """
    try:
        return mujoco.MjData(model)
    except mujoco.FatalError as error:
        size_mb = (model.narena + model.nbuffer) // 2**20
        raise EngineError(f"MuJoCo gets no {size_mb} MB of memory for {model.nbody} bodies: {error}") from error


def copy_state(model: Any, data: Any) -> Any:
    """New data of a model, in the state of the data of a model that differs in the size of its arena only."""
    result = new_data(model)
    size = result.narena
    _set_arena_size(result, data.narena)  # MuJoCo copies between arenas of the same size only
    mujoco.mj_copyData(result, model, data)
    _set_arena_size(result, size)
    return result


def _set_arena_size(structure: Any, size: int) -> None:
    """Writes the field `narena` of MuJoCo's structure, which its Python binding only reads."""
    words = (ctypes.c_int64 * _HEADER_WORDS).from_address(structure._address)
    before = structure.narena
    for place, word in enumerate(words):
        if word == before:
            words[place] = size
            if structure.narena == size:
                return
            words[place] = before
    raise EngineError(f"the layout of MuJoCo {mujoco.__version__} is unknown: its arena cannot grow")
