"""Every error Mindstage raises, one class for each thing that a caller can act on.

    MindstageError
    ├── WorldError              the world itself says no (exit code 1)
    │   ├── BodyUnknown         no body of that id
    │   ├── BodyExists          the id is taken
    │   ├── PoseUnreachable     a constraint or attachment forbids the pose
    │   └── AttachmentRefused   it would close a circle, or the child hangs elsewhere
    ├── KnowledgeError          a source cannot be used (exit code 2)
    │   ├── SourceUnreadable    no such file, or not what its format promises
    │   ├── MapMissing          no semantic map where one was asked for
    │   ├── MapAmbiguous        several maps, and nobody said which
    │   ├── MapUnwritable       a world holds what no map file can, or the file cannot be written
    │   ├── NameUnknown         nothing of that kind has the name
    │   ├── NameAmbiguous       several things have the name
    │   ├── QuestionUnknown     no question is called so
    │   ├── ArgumentRefused     a question, or what it is told, has no such form
    │   ├── QueryRefused        it is no SPARQL query
    │   └── QueryTimedOut       a SPARQL query did not end in time
    ├── EngineError             the engine itself broke (exit code 2)
    │   ├── EngineUnavailable   it is not installed, or cannot be reached
    │   ├── EngineClosed        it was closed before the call
    │   └── SimulationUnstable  the physics produced numbers that mean nothing
    ├── StageError              the stage could not take the call (exit code 2)
    │   └── StageTimedOut       the stage's own thread did not answer in time
    └── ViewportUnavailable     the page cannot be served at that address (exit code 2)

Facts are fields, the sentence is made in `__str__`, and it ends with what exists or what to try.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from difflib import get_close_matches

__all__ = [
    "ArgumentRefused",
    "AttachmentRefused",
    "BodyExists",
    "BodyUnknown",
    "EngineClosed",
    "EngineError",
    "EngineUnavailable",
    "KnowledgeError",
    "MapAmbiguous",
    "MapMissing",
    "MapUnwritable",
    "MindstageError",
    "NameAmbiguous",
    "NameUnknown",
    "PoseUnreachable",
    "QueryRefused",
    "QueryTimedOut",
    "QuestionUnknown",
    "SimulationUnstable",
    "SourceUnreadable",
    "StageError",
    "StageTimedOut",
    "ViewportUnavailable",
    "WorldError",
]


class MindstageError(Exception):
    """The root: catch it to catch everything that Mindstage itself raises."""


class WorldError(MindstageError):
    """The call was understood and the world says no; the world is as it was before."""


class BodyUnknown(WorldError):
    """No body of that id stands in the world."""

    def __init__(self, body: str, *, known: Iterable[str] = (), world: str = "") -> None:
        self.body = body
        self.world = world
        self.near = tuple(get_close_matches(body, list(known), n=3, cutoff=0.5))
        super().__init__(body)

    def __str__(self) -> str:
        where = f" in {self.world!r}" if self.world else ""
        return f"no body {self.body!r}{where}{_also(_near_names(self.near))}"


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


class KnowledgeError(MindstageError):
    """A source of knowledge cannot be used."""


class SourceUnreadable(KnowledgeError):
    """A file is not there, or its content is not what its format promises."""

    def __init__(self, source: str, *, cause: str, line: int | None = None) -> None:
        self.source = source
        self.cause = cause
        self.line = line
        super().__init__(source)

    def __str__(self) -> str:
        place = f"{self.source}, line {self.line}" if self.line is not None else self.source
        return f"cannot read {place}: {self.cause}"


class MapMissing(KnowledgeError):
    """No semantic map (of that name) among what was loaded."""

    def __init__(self, *, wanted: str = "", known: Sequence[str] = ()) -> None:
        self.wanted = wanted
        self.known = tuple(known)
        super().__init__(wanted)

    def __str__(self) -> str:
        if self.known:
            return f"no map {self.wanted!r}; there is {', '.join(self.known)}"
        where = f" in {self.wanted}" if self.wanted else ""
        return f"no semantic map{where}: nothing there is a knowrob:SemanticEnvironmentMap"


class MapAmbiguous(KnowledgeError):
    """Several maps are loaded and nobody said which one is meant."""

    def __init__(self, known: Sequence[str]) -> None:
        self.known = tuple(known)
        super().__init__(*known)

    def __str__(self) -> str:
        return f"{len(self.known)} maps are loaded ({', '.join(self.known)}); name one of them"


class MapUnwritable(KnowledgeError):
    """A world cannot become a map file: it holds what the format has no way to write, or the file is in the way."""

    def __init__(self, what: str, *, cause: str, remedy: str = "") -> None:
        self.what = what
        self.cause = cause
        self.remedy = remedy
        super().__init__(what)

    def __str__(self) -> str:
        return f"cannot write {self.what}: {self.cause}{_also(self.remedy)}"


class NameUnknown(KnowledgeError):
    """Nothing of that kind is called so."""

    def __init__(self, name: str, *, kind: str, known: Iterable[str] = ()) -> None:
        self.name = name
        self.kind = kind
        self.near = _near(name.rpartition("#")[2].rpartition(":")[2], known)
        super().__init__(name)

    def __str__(self) -> str:
        return f"no {self.kind} {self.name!r} is known{_also(_near_names(self.near))}"


class NameAmbiguous(KnowledgeError):
    """Several things are called so, or are of the class that stands for its only individual."""

    def __init__(self, name: str, *, kind: str, known: Sequence[str]) -> None:
        self.name = name
        self.kind = kind
        self.known = tuple(known)
        super().__init__(name)

    def __str__(self) -> str:
        shown = ", ".join(self.known[:5]) + (" …" if len(self.known) > 5 else "")
        return f"{self.name!r} may be any of {len(self.known)} {self.kind} names: {shown}; give one of them whole"


class QuestionUnknown(KnowledgeError):
    """There is no question of that name."""

    def __init__(self, question: str, *, known: Iterable[str]) -> None:
        self.question = question
        self.known = tuple(known)
        self.near = _near(question, self.known)
        super().__init__(question)

    def __str__(self) -> str:
        hint = _near_names(self.near) if self.near else f"there is {', '.join(self.known)}"
        return f"no question {self.question!r}; {hint}"


class ArgumentRefused(KnowledgeError):
    """A question has no such argument, or cannot take that value; or what was to be told makes no statement."""

    def __init__(self, what: str, *, cause: str, remedy: str = "") -> None:
        self.what = what
        self.cause = cause
        self.remedy = remedy
        super().__init__(what)

    def __str__(self) -> str:
        return f"{self.what}: {self.cause}{_also(self.remedy)}"


class QueryRefused(KnowledgeError):
    """The text is no SPARQL 1.1 query, or asks for what cannot be had, such as another server's answer."""

    def __init__(self, cause: str, *, remedy: str = "") -> None:
        self.cause = cause
        self.remedy = remedy
        super().__init__(cause)

    def __str__(self) -> str:
        return f"the query cannot be answered: {self.cause}{_also(self.remedy)}"


class QueryTimedOut(KnowledgeError):
    """A SPARQL query did not end in time."""

    def __init__(self, *, timeout_s: float) -> None:
        self.timeout_s = timeout_s
        super().__init__(timeout_s)

    def __str__(self) -> str:
        return f"the query did not end within {self.timeout_s:g} s; ask for less (LIMIT), or give it more time"


class EngineError(MindstageError):
    """The reason lies in the engine, not in the world it runs."""


class EngineUnavailable(EngineError):
    """The engine is not installed or does not answer."""

    def __init__(self, engine: str, *, cause: str, remedy: str = "") -> None:
        self.engine = engine
        self.cause = cause
        self.remedy = remedy
        super().__init__(engine)

    def __str__(self) -> str:
        return f"the engine {self.engine!r} is not available: {self.cause}{_also(self.remedy)}"


class EngineClosed(EngineError):
    """A call came after `close`."""

    def __init__(self, engine: str) -> None:
        self.engine = engine
        super().__init__(engine)

    def __str__(self) -> str:
        return f"the engine {self.engine!r} is closed; make a new one"


class SimulationUnstable(EngineError):
    """The physics diverged: positions, velocities or accelerations stopped being numbers."""

    def __init__(self, *, time_s: float, what: str) -> None:
        self.time_s = time_s
        self.what = what
        super().__init__(what)

    def __str__(self) -> str:
        return f"the simulation became unstable at {self.time_s:.3f} s: {self.what}"


class StageError(MindstageError):
    """The stage could not take the call."""


class StageTimedOut(StageError):
    """The thread that owns the engine did not finish the call in time."""

    def __init__(self, call: str, *, timeout_s: float) -> None:
        self.call = call
        self.timeout_s = timeout_s
        super().__init__(call)

    def __str__(self) -> str:
        return f"{self.call} did not finish within {self.timeout_s:g} s; the stage may be busy or stopped"


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


def _near(name: str, known: Iterable[str]) -> tuple[str, ...]:
    by_small = {each.lower(): each for each in known}
    return tuple(by_small[small] for small in get_close_matches(name.lower(), list(by_small), n=3, cutoff=0.6))


def _near_names(near: Sequence[str]) -> str:
    return f"near: {', '.join(map(repr, near))}" if near else ""


def _also(hint: str) -> str:
    """The end of a sentence that says what exists or what to try, where there is something to say."""
    return f"; {hint}" if hint else ""
