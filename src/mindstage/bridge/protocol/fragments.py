"""Fragments: a text cut into pieces for one who cannot take it whole, and put together again.

The pieces of several messages may come in any order and mixed; each message is held until it is complete, too large
or too old.
"""

from __future__ import annotations

from collections.abc import Hashable

from mindstage.bridge.protocol.limits import BridgeLimits
from mindstage.errors import MessageValidationError

__all__ = ["FragmentBuffer", "split_fragments"]


def split_fragments(text: str, size: int, *, max_fragments: int) -> list[str]:
    """Pieces of that many characters; of more, if there would be more than `most` of them."""
    size = max(size, -(-len(text) // max_fragments), 1)
    return [text[start : start + size] for start in range(0, len(text), size)] or [""]


class _PartialMessage:
    def __init__(self, total: int, now_s: float) -> None:
        self.total = total
        self.pieces: dict[int, str] = {}
        self.length = 0
        self.last_update_s = now_s


class FragmentBuffer:
    """What has come of messages whose other pieces are still on their way."""

    def __init__(self, limits: BridgeLimits) -> None:
        self._limits = limits
        self._partial: dict[Hashable, _PartialMessage] = {}

    def __len__(self) -> int:
        return len(self._partial)

    def add(self, key: Hashable, num: int, total: int, data: str, now_s: float) -> str | None:
        """Takes a piece; gives the whole text with the last one.

        Args:
            key: which message it belongs to.
            num: which piece it is, from 0.
            total: of how many.
            data: the piece.
            now_s: the present moment, on any clock that only goes forward [s].

        Raises:
            MessageValidationError: it fits no message or exceeds a limit; the message is forgotten.
        """
        message = self._partial.get(key)
        try:
            if message is None:
                message = self._begin(key, total, now_s)
            self._add_fragment(message, num, total, data)
        except MessageValidationError:
            self._partial.pop(key, None)
            raise
        message.last_update_s = now_s
        if len(message.pieces) < message.total:
            return None
        del self._partial[key]
        return "".join(message.pieces[number] for number in range(message.total))

    def expire(self, now_s: float) -> list[Hashable]:
        """Forgets messages whose next piece did not come in time, and says which."""
        old = [
            key for key, each in self._partial.items() if now_s - each.last_update_s > self._limits.fragment_timeout_s
        ]
        for key in old:
            del self._partial[key]
        return old

    def _begin(self, key: Hashable, total: int, now_s: float) -> _PartialMessage:
        if total > self._limits.fragments:
            raise _fragment_error(f"{total} pieces are too many", f"at most {self._limits.fragments}")
        if len(self._partial) >= self._limits.fragmented_messages:
            raise _fragment_error(f"{len(self._partial)} messages are incomplete already", "finish one of them first")
        self._partial[key] = message = _PartialMessage(total, now_s)
        return message

    def _add_fragment(self, message: _PartialMessage, num: int, total: int, data: str) -> None:
        if total != message.total:
            raise _fragment_error(
                f"a piece of {total}, where the others are of {message.total}", "begin the message again"
            )
        if num >= total:
            raise _fragment_error(f"there is no piece {num} of {total}", "pieces are counted from 0")
        if message.pieces.get(num, data) != data:
            raise _fragment_error(f"piece {num} came twice, and differs", "begin the message again")
        if num not in message.pieces:
            message.pieces[num] = data
            message.length += len(data)
        held = sum(each.length for each in self._partial.values())
        if held > self._limits.message_bytes:
            raise _fragment_error(f"{held} bytes in pieces are too many", f"at most {self._limits.message_bytes}")


def _fragment_error(cause: str, remedy: str) -> MessageValidationError:
    return MessageValidationError("fragment", cause=cause, remedy=remedy)
