"""Remembering: what was answered since anything has changed, for who asks again."""

from __future__ import annotations

from threading import Lock
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mindstage.knowledge.questions import Answers

__all__ = ["AnswerCache"]

CacheKey = tuple[object, ...]


class AnswerCache:
    """The last answers, up to so many rows."""

    def __init__(self, max_rows: int = 50_000) -> None:
        """Remembers nothing yet.

        Args:
            most_rows: how many rows are kept at most; an answer without rows counts as one.
        """
        self._max_rows = max_rows
        self._row_count = 0
        self._lock = Lock()
        self._answers: dict[CacheKey, Answers[Any]] = {}

    def get(self, key: CacheKey) -> Answers[Any] | None:
        """What was answered, if it is still known.

        Raises:
            TypeError: something in the key cannot be remembered, such as a list.
        """
        return self._answers.get(key)

    def put(self, key: CacheKey, answers: Answers[Any]) -> None:
        """Remembers an answer, and forgets the oldest ones if there is no room for it."""
        size = max(1, len(answers))
        with self._lock:
            if size > self._max_rows or key in self._answers:
                return
            while self._row_count + size > self._max_rows:
                self._row_count -= max(1, len(self._answers.pop(next(iter(self._answers)))))
            self._answers[key] = answers
            self._row_count += size
