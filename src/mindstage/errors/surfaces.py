"""Errors of the surfaces: the page, the Prolog console, what people type there."""

from __future__ import annotations

from collections.abc import Iterable

from mindstage.errors.hints import also, near, near_names
from mindstage.errors.root import MindstageError

__all__ = [
    "BrowserBroken",
    "BrowserError",
    "BrowserUnavailable",
    "ColourUnknown",
    "GoalRefused",
    "GoalTimedOut",
    "PrologError",
    "PrologUnavailable",
    "RequestRefused",
    "ViewportUnavailable",
]


class ColourUnknown(MindstageError):
    """It is neither the name of a colour nor three numbers."""

    def __init__(self, colour: str, *, known: Iterable[str]) -> None:
        self.colour = colour
        self.known = tuple(known)
        self.near = near(colour, self.known)
        super().__init__(colour)

    def __str__(self) -> str:
        hint = near_names(self.near) or f"there is {', '.join(self.known)}, #rrggbb, or r,g,b from 0 to 1"
        return f"no colour {self.colour!r}; {hint}"


class PrologError(MindstageError):
    """A Prolog console cannot do what it was asked to."""


class PrologUnavailable(PrologError):
    """SWI-Prolog or its bridge to Python is not installed, or somebody else has it."""

    def __init__(self, cause: str, *, remedy: str = "") -> None:
        self.cause = cause
        self.remedy = remedy or (
            "it takes SWI-Prolog 9 (Debian: apt-get install swi-prolog-nox) and the extra: "
            "pip install 'mindstage[prolog]'"
        )
        super().__init__(cause)

    def __str__(self) -> str:
        return f"Prolog is not available: {self.cause}{also(self.remedy)}"


class GoalRefused(PrologError):
    """A goal is no Prolog, or threw an error; the kind is Mindstage's own, or `prolog`."""

    def __init__(self, goal: str, *, kind: str, cause: str) -> None:
        self.goal = goal
        self.kind = kind
        self.cause = cause
        super().__init__(goal)

    def __str__(self) -> str:
        return f"the goal {self.goal!r} cannot be answered: {self.cause}"


class GoalTimedOut(PrologError):
    """A goal did not end in time."""

    def __init__(self, goal: str, *, timeout_s: float) -> None:
        self.goal = goal
        self.timeout_s = timeout_s
        super().__init__(goal)

    def __str__(self) -> str:
        return f"the goal {self.goal!r} did not end within {self.timeout_s:g} s; give it more time, or ask for less"


class ViewportUnavailable(MindstageError):
    """Nothing can be served at the address that was asked for."""

    def __init__(self, host: str, port: int, *, cause: str) -> None:
        self.host = host
        self.port = port
        self.cause = cause
        super().__init__(host, port)

    def __str__(self) -> str:
        where = f"{self.host}, port {self.port}"
        return f"the page cannot be served at {where}: {self.cause}; try 127.0.0.1 or another port"


class BrowserError(MindstageError):
    """The browser that takes pictures of the page cannot do it."""


class BrowserUnavailable(BrowserError):
    """No browser is installed that could take pictures, or it does not start."""

    def __init__(self, cause: str, *, known: Iterable[str] = ()) -> None:
        self.cause = cause
        self.known = tuple(known)
        super().__init__(cause)

    def __str__(self) -> str:
        names = [name for name in self.known if "/" not in name]
        remedy = f"install Chromium or Chrome, or name another with --browser; looked for {', '.join(names)}"
        return f"a browser is needed to take pictures: {self.cause}{also(remedy if names else '')}"


class BrowserBroken(BrowserError):
    """A browser that took a picture ended, refused, or did not answer in time."""

    def __init__(self, cause: str) -> None:
        self.cause = cause
        super().__init__(cause)

    def __str__(self) -> str:
        return f"the browser that takes the picture broke: {self.cause}; try again, or give it more time"


class RequestRefused(MindstageError):
    """What a page sent is nothing that can be done, or not in that form."""

    def __init__(self, what: str, *, cause: str, known: Iterable[str] = ()) -> None:
        self.what = what
        self.cause = cause
        self.near = near(what, known)
        super().__init__(what)

    def __str__(self) -> str:
        return f"{self.what} is no request: {self.cause}{also(near_names(self.near) or 'load the page again')}"
