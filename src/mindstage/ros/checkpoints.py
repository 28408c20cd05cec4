"""Checkpoints: whole states of the engine under names, a bounded number of them."""

from __future__ import annotations

from itertools import count

from mindstage.engines import Capability, SavedState
from mindstage.errors import EngineError, MessageValidationError
from mindstage.stage import Simulation

__all__ = ["CheckpointServices"]

_MAX_CHECKPOINTS = 64
"""So many states are kept: each holds a whole world."""


class CheckpointServices:
    """Keeps states; any thread may call it."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._states: dict[str, SavedState] = {}
        self._next_number = count(1)

    def execute(self, command: str, name: str) -> str:
        """Does what a word says; gives the reason if the world cannot.

        Raises:
            MessageValidationError: there is no such word.
            EngineError: the engine cannot keep states, or there are too many.
        """
        match command:
            case "save":
                self.save(name)
            case "restore":
                return self.restore(name)
            case "forget":
                self.discard(name)
            case _:
                cause = f"no command {command!r}"
                raise MessageValidationError(
                    "Checkpoint", path="command", cause=cause, remedy="there is save, restore, forget"
                )
        return ""

    def save(self, name: str = "") -> str:
        """Keeps the state as it is now; gives its name, which is made if none is given."""
        name = name or f"state_{next(self._next_number)}"
        self._require_save_support()
        if len(self._states) >= _MAX_CHECKPOINTS and name not in self._states:
            raise EngineError(f"{_MAX_CHECKPOINTS} states are kept already; forget one first")
        self._states[name] = self._simulation.run_on_engine(lambda engine: engine.save_state(), label="save")
        return name

    def restore(self, name: str) -> str:
        """Brings a state back; gives the reason if there is none of that name."""
        self._require_save_support()
        state = self._states.get(name)
        if state is None:
            return f"no state {name!r} is kept; there is {', '.join(sorted(self._states)) or 'none'}"
        self._simulation.run_on_engine(lambda engine: engine.restore_state(state), label="restore", edits=True)
        return ""

    def discard(self, name: str) -> None:
        """Throws a state away; nothing happens if there is none."""
        self._states.pop(name, None)

    def _require_save_support(self) -> None:
        if Capability.SAVE not in self._simulation.capabilities:
            raise EngineError(f"the engine {self._simulation.engine_name!r} cannot keep its state")
