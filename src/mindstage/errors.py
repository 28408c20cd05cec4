"""Every error Mindstage raises, one class for each condition that a caller can act on.

`MindstageError` makes each of them a dataclass, whose fields are the facts and whose `template` is the message, which
ends with the existing alternatives or with what to try. Errors can be pickled and copied. The exit code of the command
line is 1 for a `WorldError`, 2 for all others.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import InitVar, dataclass, field, fields, is_dataclass
from difflib import get_close_matches
from inspect import get_annotations
from string import Formatter
from typing import Any, ClassVar, dataclass_transform

# -- "did you mean" ----------------------------------------------------------------------------------------------------

_MAX_SHOWN = 80
"""Longer texts of clients are cut in messages."""
_MIN_SUBSTRING = 3
"""Shorter strings are part of nearly every name."""
_SURROGATES = re.compile("[\ud800-\udfff]")
_MAX_LISTED = 40
"""Number of known names in a message."""


def closest_names(name: str, candidates: Iterable[str]) -> tuple[str, ...]:
    """Returns up to three known names that resemble one, ignoring case: similar spellings first, then superstrings."""
    by_lower = {each.lower(): each for each in candidates}
    lower = name.lower()
    similar = get_close_matches(lower, list(by_lower), n=3, cutoff=0.6)
    longer = sorted(
        (each for each in by_lower if len(lower) >= _MIN_SUBSTRING and lower in each),
        key=lambda each: (len(each), each),
    )
    return tuple(by_lower[each] for each in list(dict.fromkeys([*similar, *longer]))[:3])


def suggestion(name: str, known: Iterable[str] = (), *, none: str = "") -> str:
    """The end of a message about an unknown name: the names that resemble it, else those that are known.

    Of many names the first ones are given, and how many more there are.

    Args:
        name: the unknown name.
        known: the names that exist.
        none: the text where no name exists.
    """
    known = tuple(known)
    if near := _near_names(closest_names(name, known)):
        return near
    first, more = known[:_MAX_LISTED], len(known) - _MAX_LISTED
    return f"there is {', '.join(first)}{f' and {more:,} more' if more > 0 else ''}" if known else none


def _near_names(names: Sequence[str]) -> str:
    return f"near: {', '.join(map(repr, names))}" if names else ""


def without_surrogates(text: str) -> str:
    """A text that UTF-8 can encode: Python has the bytes of names of files that are not UTF-8 as surrogates."""
    return text if text.isascii() else _SURROGATES.sub("\N{REPLACEMENT CHARACTER}", text)


# -- the base ----------------------------------------------------------------------------------------------------------


def _restore(cls: type[MindstageError], args: tuple[object, ...], state: dict[str, Any]) -> MindstageError:
    error = cls.__new__(cls, *args)
    error.__dict__.update(state)
    return error


@dataclass_transform(eq_default=False, kw_only_default=True, field_specifiers=(field,))
class MindstageError(Exception):
    """Base class of all errors that Mindstage raises.

    Fields are keyword-only, except for those that are declared otherwise.
    """

    template: ClassVar[str] = ""
    """The message, with attribute names in braces. If empty, the message is the argument."""
    suggestions: tuple[str, ...] = ()
    """Known names that resemble the first field, of classes that are given known names."""

    def __init_subclass__(cls, **options: object) -> None:
        super().__init_subclass__(**options)
        if get_annotations(cls):
            dataclass(eq=False, repr=False, kw_only=True)(cls)

    @property
    def code(self) -> str:
        """The name of the class, by which JSON, ROS messages and Prolog name the error."""
        return type(self).__name__

    def __post_init__(self, known: Iterable[str] | None = None) -> None:
        """Makes tuples of all sequences, and finds the known names that resemble the first field."""
        own = fields(self)  # type: ignore[arg-type]  # each class with a field is a dataclass
        for each in own:
            if each.type in {"Iterable[str]", "Sequence[str]"}:
                setattr(self, each.name, tuple(getattr(self, each.name)))
        names = getattr(self, "known", ()) if known is None else known
        if "{hint}" in self.template and names:
            self.suggestions = closest_names(getattr(self, own[0].name), names)

    def __str__(self) -> str:
        """The message. Bytes of names of files that are not UTF-8 are shown as U+FFFD, so that it can be encoded."""
        if not self.template:
            return without_surrogates(super().__str__())
        names = {name for _, name, _, _ in Formatter().parse(self.template) if name}
        return without_surrogates(self.template.format_map({name: getattr(self, name) for name in names}))

    def __repr__(self) -> str:
        # Here once, since a generated method per class would take a third of the time of the import.
        shown = (f"{each.name}={getattr(self, each.name)!r}" for each in fields(self)) if is_dataclass(self) else ()
        return f"{type(self).__name__}({', '.join(shown)})" if is_dataclass(self) else super().__repr__()

    def __reduce__(self) -> tuple[Any, ...]:
        return _restore, (type(self), self.args, self.__dict__)

    @property
    def hint(self) -> str:
        """The end of the message: the similar names in `suggestions`, else the `remedy` or the known names, if any."""
        known = ", ".join(sorted(getattr(self, "known", ())))
        text = _near_names(self.suggestions) or getattr(self, "remedy", known and f"there is {known}")
        return f"; {text}" if text else ""


# -- world -------------------------------------------------------------------------------------------------------------


class WorldError(MindstageError):
    """A valid request that the world cannot fulfill; the world is unchanged."""


class BodyNotFoundError(WorldError):
    """No body in the world has that id."""

    template = "no body {body!r}{in_world}{hint}"
    body: str = field(kw_only=False)
    known: InitVar[Iterable[str]] = ()
    world: str = ""

    @property
    def in_world(self) -> str:
        """Part of the message: the world's name, if there is one."""
        return f" in {self.world!r}" if self.world else ""


class BodyExistsError(WorldError):
    """The id of a body to be spawned is in use."""

    template = "the id {body!r} is taken; delete that body first, or choose another id"
    body: str = field(kw_only=False)


class PoseUnreachableError(WorldError):
    """The joints and attachments of the body do not allow that pose."""

    template = "{body!r} cannot take that pose: {reason}"
    body: str = field(kw_only=False)
    reason: str


class AttachmentError(WorldError):
    """The child cannot be attached to that parent."""

    template = "{child!r} cannot be attached to {parent!r}: {reason}"
    parent: str = field(kw_only=False)
    child: str = field(kw_only=False)
    reason: str


class UnreachableError(WorldError):
    """A robot cannot get there."""

    template = "{robot} cannot reach {target}: {reason}"

    robot: str = field(kw_only=False)
    target: str
    """What was to be reached, in words."""
    reason: str
    """Which limit or which obstacle, with numbers."""
    obstacle: str | None = None
    """The id of the body in the way, if it is one."""
    shortfall_m: float | None = None
    """By how much the hand does not get to the target [m], if that is the reason."""


class NoFreePlacementError(WorldError):
    """There is no support surface for the object, or no free space on it."""

    template = "{item} cannot be placed {location}: {reason}"
    item: str = field(kw_only=False)
    location: str = field(kw_only=False)
    reason: str


class SpawnRefusedError(WorldError):
    """A body, joint or attachment of a world cannot be spawned, and nothing of that world was."""

    template = "{id!r} cannot be spawned: {reason}"
    id: str = field(kw_only=False)
    reason: str


class NothingToUndoError(WorldError):
    """There is no edit to undo or, with `redo`, to redo."""

    template = "there is nothing to {action}{because}"
    redo: bool = False
    reason: str = ""
    """Why the history does not begin earlier; empty if nothing was done before."""

    @property
    def action(self) -> str:
        """Part of the message."""
        return "redo" if self.redo else "undo"

    @property
    def because(self) -> str:
        """Part of the message."""
        return f": {self.reason}" if self.reason else ""


class HistoryChangedError(WorldError):
    """A step of the undo history was chosen, and the history has changed since it was read."""

    template = "the history has changed in the meantime; look at it and choose the step again"


# -- knowledge ---------------------------------------------------------------------------------------------------------


class ResourceRefusedError(WorldError):
    """A text from outside names a file that is not granted; whether it exists is not said."""

    template = "{name!r} is not granted: a text from outside names files by relative paths or package://"
    name: str = field(kw_only=False)


class KnowledgeError(MindstageError):
    """A source of knowledge or a query cannot be used."""


class SourceParseError(KnowledgeError):
    """A file does not exist, or its content does not follow its format."""

    template = "cannot read {place}: {cause}"
    source: str = field(kw_only=False)
    cause: str
    line: int | None = None

    @property
    def place(self) -> str:
        """Part of the message: the source and the line."""
        return f"{self.source}, line {self.line}" if self.line is not None else self.source


class XacroRefusedError(SourceParseError):
    """A robot description contains xacro, and nobody has asked for its expansion."""


class ReferenceRefusedError(KnowledgeError):
    """A text that came over a port names something that would have to be read for it, such as an import."""

    template = "{source} {reference}; what came over a port is read without anything else{hint}"
    source: str = field(kw_only=False)
    reference: str = field(kw_only=False)
    """The verb and what is named, such as `imports file:///a.owl`."""
    remedy: str = ""


class MapNotFoundError(KnowledgeError):
    """No semantic map, or none of that name, is among the loaded sources."""

    requested: str = ""
    known: Sequence[str] = ()

    def __str__(self) -> str:
        if self.known:
            return f"no map {self.requested!r}; there is {', '.join(self.known)}"
        where = f" in {self.requested}" if self.requested else ""
        return (
            f"no semantic map{where}: nothing there is a knowrob:SemanticEnvironmentMap or has a pose; "
            "if it is an ontology, load it as --ontology FILE (in Python ontologies), together with a map"
        )


class AmbiguousMapError(KnowledgeError):
    """Several maps are loaded and none was selected."""

    known: Sequence[str] = field(kw_only=False)

    def __str__(self) -> str:
        return f"{len(self.known)} maps are loaded ({', '.join(self.known)}); name one of them"


class MapRejectedError(KnowledgeError):
    """A map has findings, and strict mode allows none."""

    map: str = field(kw_only=False)
    findings: Sequence[str]

    def __str__(self) -> str:
        number = f"{len(self.findings):,} finding{'' if len(self.findings) == 1 else 's'}"
        first = " | ".join(self.findings[:3]) + (" | …" if len(self.findings) > 3 else "")
        return f"{self.map} is rejected for {number}: {first}; fix them, or leave out --strict"


class MapWriteError(KnowledgeError):
    """A world cannot be written to a map file: the format cannot express it, or the file cannot be written."""

    template = "cannot write {subject}: {cause}{hint}"
    subject: str = field(kw_only=False)
    cause: str
    remedy: str = ""


class NameNotFoundError(KnowledgeError):
    """No entity of that kind has the name."""

    template = "no {entity_type} {name!r} is known{hint}"
    name: str = field(kw_only=False)
    entity_type: str
    known: InitVar[Iterable[str]] = ()

    def __post_init__(self, known: Iterable[str]) -> None:
        self.suggestions = closest_names(self.name.rpartition("#")[2].rpartition(":")[2], known)


class AmbiguousNameError(KnowledgeError):
    """Several entities have the name, or are instances of the class that was named instead of its only instance."""

    name: str = field(kw_only=False)
    entity_type: str
    candidates: Sequence[str]

    def __str__(self) -> str:
        short = [known.rpartition("#")[2].rpartition("/")[2] for known in self.candidates]
        names, how = (short, "") if len({*short}) == len(short) else (self.candidates, " in full")
        shown = ", ".join(names[:5]) + (" …" if len(names) > 5 else "")
        return f"{self.name!r} may be any of {len(names)} {self.entity_type} names: {shown}; give one of them{how}"


class QuestionNotFoundError(KnowledgeError):
    """No question has that name."""

    template = "no question {question!r}{hint}"
    question: str = field(kw_only=False)
    known: Iterable[str]

    @property
    def remedy(self) -> str:
        """The end of the message where no name is similar."""
        return "`mindstage questions` lists all of them"


class SentenceNotUnderstoodError(KnowledgeError):
    """A plain sentence asks no declared question, or contains a name that is unknown."""

    sentence: str = field(kw_only=False)
    unknown: Sequence[str] = ()
    """The words that are neither a name nor part of a question."""
    cause: str = ""
    """What is wrong, instead of the unknown words."""
    names: Sequence[str] = ()
    """Known names that resemble the unknown words."""
    questions: Sequence[str] = ()
    """The questions that are nearest, as sentences."""

    def __str__(self) -> str:
        shown = self.sentence if len(self.sentence) <= _MAX_SHOWN else f"{self.sentence[: _MAX_SHOWN - 1]}…"
        unknown = f"unknown: {', '.join(map(repr, self.unknown))}" if self.unknown else ""
        cause = self.cause or unknown or "no question is put like this"
        more = [_near_names(self.names), f"can be asked: {' | '.join(self.questions)}" if self.questions else ""]
        return "; ".join([f"{shown!r} is not understood: {cause}", *filter(None, more)])


class AmbiguousSentenceError(KnowledgeError):
    """A plain sentence can be understood in several ways."""

    sentence: str = field(kw_only=False)
    candidates: Sequence[str]
    """What it may mean, each as a question with its arguments."""

    def __str__(self) -> str:
        shown = " | ".join(self.candidates[:5]) + (" | …" if len(self.candidates) > 5 else "")
        text = self.sentence if len(self.sentence) <= _MAX_SHOWN else f"{self.sentence[: _MAX_SHOWN - 1]}…"
        return f"{text!r} has {len(self.candidates)} readings: {shown}; give one of them"


class QuestionTimeoutError(KnowledgeError):
    """A question was not answered before its timeout; the simulation continues."""

    template = "{question} was not answered within {timeout_s:g} s; narrow its arguments, or try again later"
    question: str = field(kw_only=False)
    timeout_s: float


class QueryLimitError(KnowledgeError):
    """The limit of concurrent questions is reached."""

    template = "{question} was not answered: {pending} other questions are being answered; try again in a moment"
    question: str = field(kw_only=False)
    pending: int


class QuestionProcessError(KnowledgeError):
    """The process that answered a question has ended, for example since it needed too much memory."""

    template = "{question} was not answered: the process that answered it has ended; another one was started, ask again"
    question: str = field(kw_only=False)


class InvalidArgumentError(KnowledgeError):
    """A function or question has no such argument or does not accept that value, or an assertion is not valid."""

    template = "{subject}: {cause}{hint}"
    subject: str = field(kw_only=False)
    cause: str
    remedy: str = ""


class NumberRefusedError(InvalidArgumentError, ValueError):
    """A number is not finite, or beyond its declared range; `subject` is the parameter, `cause` the range."""


class PoseRefusedError(InvalidArgumentError, ValueError):
    """What was given as a pose is none; `subject` is the parameter, `remedy` what is accepted."""


class SparqlSyntaxError(KnowledgeError):
    """The text is not a SPARQL 1.1 query, or uses what is not supported, such as SERVICE."""

    template = "the query cannot be answered: {cause}{hint}"
    cause: str = field(kw_only=False)
    remedy: str = ""


class SparqlTimeoutError(KnowledgeError):
    """A SPARQL query did not finish before its timeout."""

    template = "the query did not end within {timeout_s:g} s; limit the result (LIMIT), or increase the timeout"
    timeout_s: float


class ReasonerUnavailableError(KnowledgeError):
    """The OWL 2 RL reasoner is not installed."""

    template = "the closure cannot be derived: {cause}; install it with: pip install 'mindstage[closure]'"
    cause: str


class StoreError(KnowledgeError):
    """A store folder has another content or format, or is locked by another process."""

    template = "the store {folder} cannot be used: {cause}{hint}"
    folder: str = field(kw_only=False)
    cause: str
    remedy: str = ""


class EndpointUnreachableError(KnowledgeError):
    """A SPARQL endpoint does not respond, or not in time."""

    template = "the endpoint {endpoint} does not answer: {cause}; check the address, and that the server is running"
    endpoint: str = field(kw_only=False)
    cause: str


class EndpointError(KnowledgeError):
    """A SPARQL endpoint returned an error, or a reply that is not a SPARQL result."""

    template = "the endpoint {endpoint} returned an error: {cause}{hint}"
    endpoint: str = field(kw_only=False)
    cause: str
    remedy: str = ""
    status: int | None = None
    """HTTP status code."""


class ShapeNotFoundError(KnowledgeError):
    """No shape has that name."""

    template = "no shape {shape!r}{hint}"
    shape: str = field(kw_only=False)
    known: Iterable[str] = ()


class TextureNotFoundError(KnowledgeError):
    """No texture has that name."""

    template = "no texture {texture!r}{hint}"
    texture: str = field(kw_only=False)
    known: Iterable[str] = ()


class InvalidShapeError(KnowledgeError):
    """A shape cannot be built: a size or a parameter is invalid."""

    template = "the shape {shape!r} cannot be made: {reason}"
    shape: str = field(kw_only=False)
    reason: str


# -- engine and simulation ---------------------------------------------------------------------------------------------


class EngineError(MindstageError):
    """A failure of the engine, independent of the world that it simulates."""


class EngineUnavailableError(EngineError):
    """The engine is not installed or cannot be reached."""

    template = "the engine {engine!r} is not available: {cause}{hint}"
    engine: str = field(kw_only=False)
    cause: str
    remedy: str = ""


class EngineTimeoutError(EngineError):
    """The engine did not reply in time; the command may or may not have been executed."""

    template = (
        "the engine {engine!r} did not answer {call} within {timeout_s:g} s; "
        "it may have been executed all the same: check the poses, or increase the timeout"
    )
    engine: str = field(kw_only=False)
    call: str
    timeout_s: float


class UnsupportedByEngineError(EngineError):
    """The engine does not have the capability."""

    template = "the engine {engine!r} cannot {what}{hint}"
    engine: str = field(kw_only=False)
    what: str
    remedy: str = ""


class EngineClosedError(EngineError):
    """The engine was called after `close`."""

    template = "the engine {engine!r} is closed; make a new one"
    engine: str = field(kw_only=False)


class EngineMemoryError(EngineError):
    """The bodies or contacts of a world need more memory than the engine may have."""

    template = (
        "{what} need {needed_mb:,.1f} MB, more than the {cap_mb:,.1f} MB that the engine may have; simulate fewer"
    )
    what: str
    needed_mb: float
    """What is needed at least [MB]."""
    cap_mb: float
    """The most that the engine may have [MB]."""


class SimulationDivergedError(EngineError):
    """The simulation diverged: positions, velocities or accelerations are not finite."""

    template = "the simulation became unstable at {time_s:.3f} s: {what}"
    time_s: float
    what: str


class ImaginationError(MindstageError):
    """A plan, or a copy of a simulation, that cannot be used."""


class PlanError(ImaginationError):
    """A plan that cannot be read, or that names what the world does not have."""

    template = "{place}: {cause}"

    place: str = field(kw_only=False)
    """Where: the file, with its line, or the step."""
    cause: str


class CommitError(ImaginationError):
    """The edits of a copy of a simulation cannot be made in the original."""

    template = "the edits cannot be made in the original: {reason}"

    reason: str


class EpisodeError(MindstageError):
    """An episode cannot be recorded, read or asked."""


class EpisodeFileError(EpisodeError):
    """A file that is no episode, that is damaged, or that cannot be written."""

    template = "{path}: {cause}{hint}"

    path: str = field(kw_only=False)
    cause: str
    remedy: str = ""


class EpisodeTimeError(EpisodeError):
    """A time at which the episode has no state."""

    template = "{episode} has no state at {time_s:g} s; it lasts from {begin_s:g} to {end_s:g} s"

    episode: str = field(kw_only=False)
    time_s: float
    begin_s: float
    end_s: float


class RobotError(MindstageError):
    """A robot cannot be read or commanded."""


class RobotModelError(RobotError):
    """A description of a robot that cannot be read."""

    template = "{source}: {cause}; {remedy}"

    source: str = field(kw_only=False)
    """The file, with its line or element if that is known."""
    cause: str
    remedy: str


class RobotNotFoundError(RobotError):
    """No robot of the simulation, or no known model, has that name."""

    template = "no robot {name!r}; {remedy}"

    name: str = field(kw_only=False)
    remedy: str
    """What exists, or how a model is installed."""


class RobotLibraryError(RobotError):
    """A library for inverse kinematics or motion planning is not installed."""

    template = "{library} is not installed; install it with: pip install 'mindstage[{extra}]'"

    library: str = field(kw_only=False)
    extra: str = field(default="robots", kw_only=False)


class CommandRefusedError(RobotError):
    """A command that is beyond a limit, or that the robot cannot execute; nothing was moved."""

    template = "{robot} refuses {command}: {cause}; {remedy}"

    robot: str = field(kw_only=False)
    command: str
    """The command in words, such as the name of a joint and its position."""
    cause: str
    remedy: str


class SkillFailedError(RobotError):
    """A skill, or a part of one, failed; `start_skill` returns it as a result."""

    template = "{robot}: {reason}; {suggestion}"

    robot: str = field(kw_only=False)
    reason: str
    suggestion: str
    """What to try."""
    is_known: bool = True
    """Whether it certainly failed; otherwise its effect is unknown."""


class SimulationError(MindstageError):
    """The simulation thread could not execute the call."""


class SimulationTimeoutError(SimulationError):
    """The thread that owns the engine did not finish the call in time.

    A call that has not begun is withdrawn and never executed; one that has begun (`begun`) is not interrupted.
    """

    template = "{call} did not finish within {timeout_s:g} s{outcome}; the simulation {activity}"
    call: str = field(kw_only=False)
    timeout_s: float
    begun: bool = False
    busy_with: str = ""
    """What the thread is doing, such as the controller that does not return; empty if that is not known."""
    expected_rebuild_s: float = 0.0
    """How long the engine is expected to rebuild its model before it can continue [s]; 0 if no rebuild is due."""

    @property
    def outcome(self) -> str:
        """What happens to the call, for the message."""
        return ", but it has begun: it is not interrupted, and its end is reported" if self.begun else ""

    @property
    def activity(self) -> str:
        """What the simulation is doing, for the message."""
        rebuild = f" (a rebuild of its model takes about {self.expected_rebuild_s:.2g} s)"
        busy = f"is busy with {self.busy_with}" if self.busy_with else "may be busy or stopped"
        return f"{busy}{rebuild if self.expected_rebuild_s else ''}"


class SimulationFaultError(SimulationError):
    """A controller, an observer or the engine raised an exception, which is the cause of this one.

    The simulation was paused. Where that happened while it played, the next call from Python raises this error once,
    and executes nothing; after that the simulation can be used again.
    """

    template = "{source} raised {cause}; {remedy}"
    source: str = field(kw_only=False)
    """What raised, such as "the controller 'arm'"."""
    cause: str
    remedy: str
    """What was done about it: a controller or an observer that raised was removed."""


class SimulationThreadError(SimulationError):
    """The thread that owns the engine has ended, so that no call can be executed anymore."""

    template = "{call} was not executed: the thread of the simulation has ended; make a new simulation"
    call: str = field(kw_only=False)


# -- bridge ------------------------------------------------------------------------------------------------------------


class BridgeError(MindstageError):
    """A failure of a bridge, of its peer or of the connection."""


class BridgeUnavailableError(BridgeError):
    """The rosbridge server cannot listen at that address."""

    template = "the bridge cannot be served at {host}, port {port}: {cause}; try 127.0.0.1 or another port"
    host: str = field(kw_only=False)
    port: int = field(kw_only=False)
    cause: str


class Ros2Error(BridgeError):
    """ROS 2 is not installed, message packages cannot be built, or the process of the ROS 2 node has ended."""

    template = "ROS 2: {cause}; {remedy}"
    cause: str = field(kw_only=False)
    remedy: str = "see `mindstage ros2 doctor`"


class AuthenticationError(BridgeError):
    """A token is required, and none or an invalid one was sent."""

    template = "no access to {address}: {cause}"
    address: str = field(kw_only=False)
    cause: str


class CertificateError(BridgeError):
    """A file with a certificate, a private key or authorities for TLS cannot be used."""

    template = "the TLS file {path} cannot be used: {cause}; {remedy}"
    path: str = field(kw_only=False)
    cause: str
    remedy: str


class ConnectionLostError(BridgeError):
    """No connection, or a closed one; a pending request may or may not have been executed."""

    template = "no connection to {address}: {cause}"
    address: str = field(kw_only=False)
    cause: str


class ServiceNotFoundError(BridgeError):
    """No service or action of that name is advertised."""

    template = "Service {service} does not exist{hint}"  # rosbridge's wording, which its clients match
    service: str = field(kw_only=False)
    known: InitVar[Iterable[str]] = ()


class ServiceTimeoutError(BridgeError):
    """A service or an action did not return in time."""

    template = (
        "{service} did not answer within {timeout_s:g} s; increase the timeout, or check that its server is running"
    )
    service: str = field(kw_only=False)
    timeout_s: float


class ServiceCallError(BridgeError):
    """A service or an action failed for a reason other than the state of the world."""

    template = "{service} failed: {cause}"
    service: str = field(kw_only=False)
    cause: str


class FailureResponseError(BridgeError):
    """A service failed, and its type can express that; the handler of a service raises it."""

    template = "{cause}"
    cause: str = field(kw_only=False)
    response: object
    """The response message, for callers at a rosbridge that only transmits messages of the type."""


class AdvertiseError(BridgeError):
    """A service, action or topic cannot be advertised under that name."""

    template = "{name!r} cannot be advertised: {cause}"
    name: str = field(kw_only=False)
    cause: str


class MessageValidationError(BridgeError):
    """A message does not match its type."""

    template = "{subject}: {at_path}{cause}{hint}"
    subject: str = field(kw_only=False)
    path: str = ""
    """The place in the message, such as `models[3].pose.position.x`."""
    cause: str
    remedy: str = ""
    id: str | int | None = None
    """The message's own id on the wire, where it could be read."""
    answer: object = None
    """The operation that answers the message, if it is a call or a goal whose id could be read."""

    @property
    def at_path(self) -> str:
        """Part of the message: the path, if there is one."""
        return f"{self.path}: " if self.path else ""


class TypeNotFoundError(BridgeError):
    """No message, service or action type has that name."""

    template = "no {interface_type} type {name!r} is known{hint}"
    name: str = field(kw_only=False)
    interface_type: str
    known: InitVar[Iterable[str]] = ()


# -- user interfaces ---------------------------------------------------------------------------------------------------


class InvalidColorError(MindstageError):
    """Neither a color name nor a color value."""

    template = "no color {color!r}{hint}"
    color: str = field(kw_only=False)
    known: Iterable[str]

    @property
    def remedy(self) -> str:
        """The end of the message where no name is similar."""
        return f"there is {', '.join(self.known)}, #rrggbb, or r,g,b from 0 to 1"


class PrologError(MindstageError):
    """A failure of the Prolog console."""


class PrologUnavailableError(PrologError):
    """SWI-Prolog or pyswip is not installed, or already in use."""

    template = "Prolog is not available: {cause}{hint}"
    cause: str = field(kw_only=False)
    remedy: str = (
        "it takes SWI-Prolog 9 (Debian: apt-get install swi-prolog-nox) and the extra: pip install 'mindstage[prolog]'"
    )


class PrologGoalError(PrologError):
    """A goal has a syntax error or threw an exception; the kind is a Mindstage error class, or `prolog`."""

    template = "the goal {goal!r} cannot be answered: {cause}"
    goal: str = field(kw_only=False)
    error_type: str
    cause: str


class PrologTimeoutError(PrologError):
    """A goal did not finish in time."""

    template = "the goal {goal!r} did not end within {timeout_s:g} s; increase the timeout, or limit the goal"
    goal: str = field(kw_only=False)
    timeout_s: float


class UnsavedEditsError(MindstageError):
    """A file would replace the world, and edits of it are not saved."""

    template = "{edits} not saved, the last one: {last}; save the map first, or discard them"
    edits: str = field(kw_only=False)
    last: str


class ViewerUnavailableError(MindstageError):
    """The page's server cannot listen at that address."""

    template = "the page cannot be served at {host}, port {port}: {cause}; try 127.0.0.1 or another port"
    host: str = field(kw_only=False)
    port: int = field(kw_only=False)
    cause: str


class RendererUnavailableError(MindstageError):
    """A library that a renderer of pictures needs is not installed, or does not work here."""

    template = "pictures cannot be rendered with {renderer}: {cause}{hint}"
    renderer: str = field(kw_only=False)
    cause: str
    remedy: str = ""


class CacheError(MindstageError):
    """The cache directory cannot be written."""

    template = "the cache {folder} cannot be written: {cause}; free space, or set MINDSTAGE_CACHE to another folder"
    folder: str = field(kw_only=False)
    cause: str


class ExtensionError(MindstageError):
    """What a package adds by an entry point cannot be loaded."""

    template = "{name}, an entry point {group} of {package}, cannot be loaded: {cause}"
    name: str = field(kw_only=False)
    group: str
    package: str
    cause: str


class RequestLimitError(MindstageError):
    """A request of a client is too large, or one too many."""

    template = "{subject}: {cause}"
    subject: str = field(kw_only=False)
    cause: str


class InvalidRequestError(MindstageError):
    """A request from the page is unknown, or its arguments are invalid."""

    template = "{subject} is not a valid request: {cause}{hint}"
    remedy: ClassVar[str] = "reload the page"
    subject: str = field(kw_only=False)
    cause: str
    known: InitVar[Iterable[str]] = ()


__all__ = ["closest_names", "suggestion", "without_surrogates"]
__all__ += [name for name, each in vars().items() if isinstance(each, type) and issubclass(each, MindstageError)]
__dir__ = __all__.copy
