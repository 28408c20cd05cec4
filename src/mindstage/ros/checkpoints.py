"""Checkpoints: whole states of the engine under names, a bounded number of them."""

from __future__ import annotations

from itertools import count

from mindstage.engines import Ability, State
from mindstage.errors import EngineError, MessageRefused
from mindstage.stage import Stage

__all__ = ["Checkpoints"]

_MOST = 64
"""So many states are kept: each holds a whole world."""


class Checkpoints:
    """Keeps states; any thread may call it."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        self._states: dict[str, State] = {}
        self._numbers = count(1)

    def obey(self, command: str, name: str) -> str:
        """Does what a word says; gives the reason if the world cannot.

        Raises:
            MessageRefused: there is no such word.
            EngineError: the engine cannot keep states, or there are too many.
        """
        match command:
            case "save":
                self.save(name)
            case "restore":
                return self.restore(name)
            case "forget":
                self.forget(name)
            case _:
                cause = f"no command {command!r}"
                raise MessageRefused("Checkpoint", path="command", cause=cause, remedy="there is save, restore, forget")
        return ""

    def save(self, name: str = "") -> str:
        """Keeps the state as it is now; gives its name, which is made if none is given."""
        name = name or f"state_{next(self._numbers)}"
        self._require_ability()
        if len(self._states) >= _MOST and name not in self._states:
            raise EngineError(f"{_MOST} states are kept already; forget one first")
        self._states[name] = self._stage.call(lambda engine: engine.save(), what="save")
        return name

    def restore(self, name: str) -> str:
        """Brings a state back; gives the reason if there is none of that name."""
        self._require_ability()
        state = self._states.get(name)
        if state is None:
            return f"no state {name!r} is kept; there is {', '.join(sorted(self._states)) or 'none'}"
        self._stage.call(lambda engine: engine.restore(state), what="restore", edits=True)
        return ""

    def forget(self, name: str) -> None:
        """Throws a state away; nothing happens if there is none."""
        self._states.pop(name, None)

    def _require_ability(self) -> None:
        if Ability.SAVE not in self._stage.abilities:
            raise EngineError(f"the engine {self._stage.engine_name!r} cannot keep its state")
