"""Errors of what is known: sources, names, questions, stores."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from mindstage.errors.hints import also, near, near_names
from mindstage.errors.root import MindstageError

__all__ = [
    "ArgumentRefused",
    "EndpointRefused",
    "EndpointUnreachable",
    "KnowledgeError",
    "MapAmbiguous",
    "MapMissing",
    "MapRefused",
    "MapUnwritable",
    "NameAmbiguous",
    "NameUnknown",
    "QueryRefused",
    "QueryTimedOut",
    "QuestionTimedOut",
    "QuestionUnknown",
    "ReasonerUnavailable",
    "ShapeRefused",
    "ShapeUnknown",
    "SourceUnreadable",
    "StoreUnusable",
    "TooManyQuestions",
]


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


class MapRefused(KnowledgeError):
    """Something was found odd about a map, and whoever loaded it wanted nothing odd."""

    def __init__(self, map: str, *, findings: Sequence[str]) -> None:
        self.map = map
        self.findings = tuple(findings)
        super().__init__(map)

    def __str__(self) -> str:
        number = f"{len(self.findings):,} finding{'' if len(self.findings) == 1 else 's'}"
        first = " | ".join(self.findings[:3]) + (" | …" if len(self.findings) > 3 else "")
        return f"{self.map} is refused for {number}: {first}; mend them, or leave out --strict"


class MapUnwritable(KnowledgeError):
    """A world cannot become a map file: it holds what the format has no way to write, or the file is in the way."""

    def __init__(self, what: str, *, cause: str, remedy: str = "") -> None:
        self.what = what
        self.cause = cause
        self.remedy = remedy
        super().__init__(what)

    def __str__(self) -> str:
        return f"cannot write {self.what}: {self.cause}{also(self.remedy)}"


class NameUnknown(KnowledgeError):
    """Nothing of that kind is called so."""

    def __init__(self, name: str, *, kind: str, known: Iterable[str] = ()) -> None:
        self.name = name
        self.kind = kind
        self.near = near(name.rpartition("#")[2].rpartition(":")[2], known)
        super().__init__(name)

    def __str__(self) -> str:
        return f"no {self.kind} {self.name!r} is known{also(near_names(self.near))}"


class NameAmbiguous(KnowledgeError):
    """Several things are called so, or are of the class that stands for its only individual."""

    def __init__(self, name: str, *, kind: str, known: Sequence[str]) -> None:
        self.name = name
        self.kind = kind
        self.known = tuple(known)
        super().__init__(name)

    def __str__(self) -> str:
        short = [known.rpartition("#")[2].rpartition("/")[2] for known in self.known]
        names, how = (short, "") if len({*short}) == len(short) else (self.known, " whole")
        shown = ", ".join(names[:5]) + (" …" if len(names) > 5 else "")
        return f"{self.name!r} may be any of {len(names)} {self.kind} names: {shown}; give one of them{how}"


class QuestionUnknown(KnowledgeError):
    """There is no question of that name."""

    def __init__(self, question: str, *, known: Iterable[str]) -> None:
        self.question = question
        self.known = tuple(known)
        self.near = near(question, self.known)
        super().__init__(question)

    def __str__(self) -> str:
        hint = near_names(self.near) if self.near else f"there is {', '.join(self.known)}"
        return f"no question {self.question!r}; {hint}"


class QuestionTimedOut(KnowledgeError):
    """An answer did not come in time; the world goes on meanwhile."""

    def __init__(self, question: str, *, timeout_s: float) -> None:
        self.question = question
        self.timeout_s = timeout_s
        super().__init__(question)

    def __str__(self) -> str:
        return f"{self.question} was not answered within {self.timeout_s:g} s; ask about less, or again a little later"


class TooManyQuestions(KnowledgeError):
    """So many are being answered that one more would have to wait too long."""

    def __init__(self, question: str, *, asked: int) -> None:
        self.question = question
        self.asked = asked
        super().__init__(question)

    def __str__(self) -> str:
        return f"{self.question} is not answered now: {self.asked} others come first; ask again in a moment"


class ArgumentRefused(KnowledgeError):
    """A question has no such argument, or cannot take that value; or what was to be told makes no statement."""

    def __init__(self, what: str, *, cause: str, remedy: str = "") -> None:
        self.what = what
        self.cause = cause
        self.remedy = remedy
        super().__init__(what)

    def __str__(self) -> str:
        return f"{self.what}: {self.cause}{also(self.remedy)}"


class QueryRefused(KnowledgeError):
    """The text is no SPARQL 1.1 query, or asks for what cannot be had, such as another server's answer."""

    def __init__(self, cause: str, *, remedy: str = "") -> None:
        self.cause = cause
        self.remedy = remedy
        super().__init__(cause)

    def __str__(self) -> str:
        return f"the query cannot be answered: {self.cause}{also(self.remedy)}"


class QueryTimedOut(KnowledgeError):
    """A SPARQL query did not end in time."""

    def __init__(self, *, timeout_s: float) -> None:
        self.timeout_s = timeout_s
        super().__init__(timeout_s)

    def __str__(self) -> str:
        return f"the query did not end within {self.timeout_s:g} s; ask for less (LIMIT), or give it more time"


class ReasonerUnavailable(KnowledgeError):
    """What applies the rules of OWL 2 RL is not installed."""

    def __init__(self, *, cause: str) -> None:
        self.cause = cause
        super().__init__(cause)

    def __str__(self) -> str:
        return f"nothing can be derived: {self.cause}; install it with: pip install 'mindstage[closure]'"


class StoreUnusable(KnowledgeError):
    """A folder of stored knowledge is not what it should be, or not for this process now."""

    def __init__(self, folder: str, *, cause: str, remedy: str = "") -> None:
        self.folder = folder
        self.cause = cause
        self.remedy = remedy
        super().__init__(folder)

    def __str__(self) -> str:
        return f"the store {self.folder} cannot be used: {self.cause}{also(self.remedy)}"


class EndpointUnreachable(KnowledgeError):
    """Nobody answers at the address of an endpoint, or not in time."""

    def __init__(self, endpoint: str, *, cause: str) -> None:
        self.endpoint = endpoint
        self.cause = cause
        super().__init__(endpoint)

    def __str__(self) -> str:
        return f"the endpoint {self.endpoint} does not answer: {self.cause}; check the address, and that it runs"


class EndpointRefused(KnowledgeError):
    """The endpoint answers with no, or with what is no answer of SPARQL's."""

    def __init__(self, endpoint: str, *, cause: str, remedy: str = "", status: int | None = None) -> None:
        self.endpoint = endpoint
        self.cause = cause
        self.remedy = remedy
        self.status = status
        """The number that HTTP has for it."""
        super().__init__(endpoint)

    def __str__(self) -> str:
        return f"the endpoint {self.endpoint} refuses: {self.cause}{also(self.remedy)}"


class ShapeUnknown(KnowledgeError):
    """No shape is called so."""

    def __init__(self, shape: str, *, known: Iterable[str] = ()) -> None:
        self.shape = shape
        self.known = tuple(sorted(known))
        self.near = near(shape, self.known)
        super().__init__(shape)

    def __str__(self) -> str:
        return f"no shape {self.shape!r}{also(near_names(self.near) or 'there is ' + ', '.join(self.known))}"


class ShapeRefused(KnowledgeError):
    """A shape cannot be made so: a size or a parameter says what cannot be."""

    def __init__(self, shape: str, *, reason: str) -> None:
        self.shape = shape
        self.reason = reason
        super().__init__(shape)

    def __str__(self) -> str:
        return f"the shape {self.shape!r} cannot be made: {self.reason}"
