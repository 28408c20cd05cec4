"""Remembering: what was answered since anything has changed, for who asks again."""

from __future__ import annotations

from threading import Lock
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mindstage.knowledge.questions import Answers

__all__ = ["Remembered"]

Key = tuple[object, ...]


class Remembered:
    """The last answers, up to so many rows."""

    def __init__(self, most_rows: int = 50_000) -> None:
        """Remembers nothing yet.

        Args:
            most_rows: how many rows are kept at most; an answer without rows counts as one.
        """
        self._most = most_rows
        self._rows = 0
        self._keeping = Lock()
        self._answers: dict[Key, Answers[Any]] = {}

    def get(self, key: Key) -> Answers[Any] | None:
        """What was answered, if it is still known.

        Raises:
            TypeError: something in the key cannot be remembered, such as a list.
        """
        return self._answers.get(key)

    def keep(self, key: Key, answers: Answers[Any]) -> None:
        """Remembers an answer, and forgets the oldest ones if there is no room for it."""
        size = max(1, len(answers))
        with self._keeping:
            if size > self._most or key in self._answers:
                return
            while self._rows + size > self._most:
                self._rows -= max(1, len(self._answers.pop(next(iter(self._answers)))))
            self._answers[key] = answers
            self._rows += size
