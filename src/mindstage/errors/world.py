"""Errors of the world: it was understood, and the answer is no."""

from __future__ import annotations

from collections.abc import Iterable

from mindstage.errors.hints import also, near, near_names
from mindstage.errors.root import MindstageError

__all__ = [
    "AttachmentRefused",
    "BodyExists",
    "BodyUnknown",
    "NothingToUndo",
    "PoseUnreachable",
    "ReturnRefused",
    "SpotMissing",
    "WorldError",
]


class WorldError(MindstageError):
    """The call was understood and the world says no; the world is as it was before."""


class BodyUnknown(WorldError):
    """No body of that id stands in the world."""

    def __init__(self, body: str, *, known: Iterable[str] = (), world: str = "") -> None:
        self.body = body
        self.world = world
        self.near = near(body, known)
        super().__init__(body)

    def __str__(self) -> str:
        where = f" in {self.world!r}" if self.world else ""
        return f"no body {self.body!r}{where}{also(near_names(self.near))}"


class BodyExists(WorldError):
    """The id of a body to be spawned is taken."""

    def __init__(self, body: str) -> None:
        self.body = body
        super().__init__(body)

    def __str__(self) -> str:
        return f"the id {self.body!r} is taken; delete that body first, or choose another id"


class PoseUnreachable(WorldError):
    """What the body hangs on does not let it take that pose."""

    def __init__(self, body: str, *, reason: str) -> None:
        self.body = body
        self.reason = reason
        super().__init__(body)

    def __str__(self) -> str:
        return f"{self.body!r} cannot take that pose: {self.reason}"


class AttachmentRefused(WorldError):
    """The child cannot hang on that parent."""

    def __init__(self, parent: str, child: str, *, reason: str) -> None:
        self.parent = parent
        self.child = child
        self.reason = reason
        super().__init__(child)

    def __str__(self) -> str:
        return f"{self.child!r} cannot be attached to {self.parent!r}: {self.reason}"


class SpotMissing(WorldError):
    """Nothing like that can be put there: there is no place, or none is free."""

    def __init__(self, what: str, where: str, *, reason: str) -> None:
        self.what = what
        self.where = where
        self.reason = reason
        super().__init__(what)

    def __str__(self) -> str:
        return f"{self.what} cannot be put {self.where}: {self.reason}"


class ReturnRefused(WorldError):
    """What was deleted cannot come back."""

    def __init__(self, body: str, *, reason: str) -> None:
        self.body = body
        self.reason = reason
        super().__init__(body)

    def __str__(self) -> str:
        return f"{self.body!r} cannot come back: {self.reason}"


class NothingToUndo(WorldError):
    """No edit is left to be taken back, or to be done again."""

    def __init__(self, *, again: bool = False) -> None:
        self.again = again
        super().__init__(again)

    def __str__(self) -> str:
        return "nothing is left to be done again; edit something" if self.again else "nothing is left to be undone"
