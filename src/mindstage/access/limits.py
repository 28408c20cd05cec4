"""The limits of everything that can be reached from outside, in one table with reasons.

Servers and handlers refer to the limits of this table and define none of their own.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import msgspec

from mindstage.ranges import Count, Index, Positive, Range, check_fields, check_number

__all__ = [
    "LIMITS",
    "BridgeLimits",
    "Deadline",
    "Duration",
    "Excess",
    "Lifetime",
    "Limit",
    "MotionTimeout",
    "PositiveDuration",
    "Rate",
    "RpcLimits",
    "Samples",
    "Speed",
    "Timeout",
    "VisitorLimits",
]

_MIB = 1 << 20


class Excess(StrEnum):
    """What happens to a request beyond a limit."""

    REFUSED = "refused"
    """It is refused with the name of the limit and its range; nothing was done."""
    SLOWED = "slowed"
    """It is processed later; nothing is lost."""
    CUT = "cut"
    """A part of the result is left out, and the result says so."""


class Limit(msgspec.Struct, frozen=True, kw_only=True):
    """A range of a number that comes from outside."""

    name: str
    """The name, as errors and the documentation show it."""
    maximum: float
    """The largest allowed value."""
    minimum: float = 0.0
    """The smallest allowed value."""
    unit: str = ""
    """The unit; empty for counts and ratios."""
    excess: Excess = Excess.REFUSED
    """What happens beyond the range."""
    reason: str
    """Why the limit exists and why it has this value."""

    @property
    def count(self) -> int:
        """The largest allowed value of a limit that counts."""
        return int(self.maximum)

    def check(self, value: float) -> float:
        """Returns a value that is in the range.

        Raises:
            NumberRefusedError: it is not a number, not finite, or out of the range.
        """
        check_number(value, Range.of(self.meta), self.name)
        return value

    @property
    def meta(self) -> msgspec.Meta:
        """The range, for the type of a parameter: `Annotated[float, SPEED]`."""
        return msgspec.Meta(ge=self.minimum, le=self.maximum, extra={"unit": self.unit} if self.unit else None)


LIMITS: dict[str, Limit] = {}
"""All limits by name."""


def _limit(name: str, maximum: float, reason: str, **fields: object) -> Limit:
    limit = LIMITS[name] = msgspec.convert(
        {"name": name, "maximum": maximum, "reason": reason, **fields}, Limit, strict=False
    )
    return limit


SPEED = _limit(
    "speed",
    1000.0,
    "a multiple of real time that no engine reaches; larger numbers could only overflow",
)
CONTROLLER_PERIOD = _limit(
    "controller period",
    3600.0,
    "each update is a call of Python between two time steps; more than ten for a time step have no effect",
    minimum=1e-4,
    unit="s",
)
OBSERVER_INTERVAL = _limit(
    "observer interval",
    3600.0,
    "each state that an observer gets costs a reading of all poses; a thousand for each second is a frame of a time "
    "step or two",
    minimum=1e-3,
    unit="s",
)
CALL_TIMEOUT = _limit(
    "timeout",
    86400.0,
    "how long a call of the simulation waits; a whole day is longer than any, and clocks overflow at far more",
    unit="s",
)
MARKER_LIFETIME = _limit(
    "lifetime of a marker",
    86400.0 * 366,
    "a year; a marker without a lifetime stays until it is removed",
    unit="s",
)
MOTION_TIMEOUT = _limit(
    "timeout of a motion",
    3600.0,
    "simulated time for which a joint is pulled if it does not arrive",
    unit="s",
)
PUBLISH_RATE = _limit(
    "publish rate",
    1000.0,
    "messages of a topic for each second of real time; 0 disables it, and more than this takes all of a core",
    unit="Hz",
)
STEP_DURATION = _limit(
    "step duration",
    3600.0,
    "simulated time of one call; longer runs are divided, so that they can be observed and canceled",
    unit="s",
)
XACRO_STEPS = _limit(
    "steps of a xacro expansion",
    5_000_000,
    "about ten seconds; the largest descriptions of robots take some hundred thousand",
)
XACRO_EXPRESSION_LENGTH = _limit(
    "length of a xacro expression",
    10_000,
    "the longest in descriptions of robots have some hundred; longer ones could only exhaust the parser",
    unit="characters",
)
XACRO_VALUE_SIZE = _limit(
    "size of a xacro value",
    1_000_000,
    "a value is held in memory and printed; strings that double in each property would fill it",
    unit="characters and elements",
)
XACRO_INTEGER_BITS = _limit(
    "integer in a xacro expression",
    4096,
    "far beyond the range of floating point numbers; powers of integers could fill the memory",
    unit="bits",
)
XACRO_FORMAT_WIDTH = _limit(
    "width of a formatted xacro number",
    1000,
    "no number has more digits; the width is allocated before it is filled",
    unit="characters",
)
QUERY_CHARACTERS = _limit(
    "characters of a query",
    20_000,
    "longer than any query that a person writes; parsers need time that grows with the text",
)
QUERY_TIME = _limit(
    "time of a query over a port",
    30.0,
    "a query occupies a processor; a longer one belongs on the command line",
    unit="s",
    excess=Excess.CUT,
)
QUERY_DEFAULT_TIME = _limit(
    "time of a query without a time of its own", 20.0, "what a person waits for an answer", unit="s"
)
PROLOG_TIME = _limit("time of a Prolog query of the page", 10.0, "queries in Prolog wait for one another", unit="s")
SOLUTIONS = _limit("solutions of a Prolog query", 10_000, "all of them are in one message", excess=Excess.CUT)
DEFAULT_SOLUTIONS = _limit(
    "solutions of a Prolog query without a number of its own", 500, "what a terminal shows", excess=Excess.CUT
)
ROWS = _limit("rows of an answer on the page", 500, "more are not read; the total is shown", excess=Excess.CUT)
KEPT_ANSWERS = _limit(
    "answers that are kept for a page",
    8,
    "for explanations and highlights of the latest questions; older ones are forgotten",
    excess=Excess.CUT,
)
COMPLETIONS = _limit("completions of a name", 50, "a list to choose from", excess=Excess.CUT)
LABEL_CHARACTERS = _limit("characters of a label of highlights", 60, "the label is one line", excess=Excess.CUT)
SKILL_REPLACEMENT = _limit(
    "time for a skill to end when another one replaces it",
    5.0,
    "a skill ends within one step of the simulation",
    unit="s",
)
STATUS_ENTRIES = _limit(
    "goals in a status message of actionlib",
    64,
    "the status is published several times a second; ended goals are left out",
    excess=Excess.CUT,
)
ACTIONLIB_GOALS = _limit("active goals of an action of actionlib", 16, "each has a thread")
NODE_GOALS = _limit("active goals of a node", 32, "each has a thread")
PLAN_SAMPLES = _limit("samples of a plan", 1_000_000, "a result is kept of each")
PARAMETERS = _limit("parameters of rosapi", 10_000, "they are kept in memory")
PARAMETER_CHARACTERS = _limit("characters of a parameter of rosapi", 1 << 20, "large enough for a robot description")
TESTED_PLACES = _limit(
    "places that are tested on a surface for a named pose",
    64,
    "each costs a collision test; they are spread over the surface",
    excess=Excess.CUT,
)
LISTED_FILES = _limit("files that are listed of a granted folder", 1000, "the list is one message", excess=Excess.CUT)
PATTERN_CHARACTERS = _limit("characters of a pattern of names", 4096, "a compiled pattern is larger than its text")
PATTERN_BYTES = _limit("memory of a compiled pattern", 1 << 20, "RE2 needs time that grows with it", unit="B")
MARKERS = _limit("markers", 10_000, "each is drawn by every page")
MASTER_TIME = _limit("time for a master of ROS 1 to set a parameter", 10.0, "nothing waits for it", unit="s")
CHECKPOINTS = _limit("saved states", 64, "each has a whole world")
STEPS_TIME = _limit(
    "time of the service step_simulation", 300.0, "longer runs are goals, which can be observed and canceled", unit="s"
)
FEEDBACK_STEPS = _limit(
    "steps of a goal with a feedback for each",
    1000,
    "500 messages in each simulated second would displace others; longer goals send feedback periodically",
    excess=Excess.CUT,
)
NAMES_TIME = _limit(
    "time for another rosbridge to list its services", 3.0, "an idle world is published once a second", unit="s"
)
HELD_MESSAGES = _limit(
    "messages on one topic that wait for its advertisement at a rosbridge of ROS",
    16,
    "it accepts a topic within seconds; the oldest are dropped",
    excess=Excess.CUT,
)
UNSENT_MESSAGES = _limit(
    "published messages that wait for the event loop", 256, "the publisher waits", excess=Excess.SLOWED
)
UNHANDLED_MESSAGES = _limit(
    "messages of a topic that wait for a slow handler",
    1024,
    "the oldest are dropped, since the newest count",
    excess=Excess.CUT,
)
QUEUE_LENGTH = _limit("queue length of a subscription", 1000, "the oldest messages are dropped", excess=Excess.CUT)
WORKERS = _limit("threads that call handlers of a node", 16, "further calls wait", excess=Excess.SLOWED)
LOOP_TIME = _limit(
    "time for the event loop to respond", 10.0, "nothing on it blocks; a loop that takes longer is stuck", unit="s"
)
CLOCK_SKEW = _limit("age of a hash of rosauth", 5.0, "as in rosauth", unit="s")
CONGESTION = _limit(
    "send queue of a peer that is not congested",
    256 * 1024,
    "throttled topics wait beyond it",
    unit="B",
    excess=Excess.SLOWED,
)
CLOSE_TIME = _limit("time of the closing handshake", 5.0, "the connection is cut then", unit="s")
READ_SLICE = _limit(
    "time for which messages of one peer are handled before others",
    0.002,
    "so that one peer does not delay all others",
    unit="s",
    excess=Excess.SLOWED,
)
UNAUTHENTICATED_BYTES = _limit("message of a client without a token", 16 * 1024, "enough for a token", unit="B")
SIZE = _limit("extent of a collision shape", 1e6, "larger numbers overflow in the physics", unit="m")
UNSENT_EVENTS = _limit("unsent messages to a page", 1000, "a page that is so slow is disconnected, and connects again")
PORT_TRIES = _limit("consecutive ports that are tried, if none was given", 200, "beyond them something else is wrong")
WINDOW = _limit(
    "messages of the 3D view that are sent together",
    16,
    "a page shows none of them before all have arrived",
    excess=Excess.SLOWED,
)
VIEW_NUMBER = _limit(
    "number in a message of the 3D view",
    1e9,
    "positions [m], pixels and angles [rad] are far smaller; larger ones overflow in what is computed from them",
)
COOKIE_AGE = _limit("age of the cookie of a page", 30 * 24 * 3600, "a token is entered again once a month", unit="s")
MAP_CHARACTERS = _limit("characters of a map that the page loads", 20_000_000, "ten times the largest known map")
NEW_BODY_TIME = _limit(
    "time that details wait for a body that was just added",
    5.0,
    "the drawing thread publishes several times a second",
    unit="s",
)
STORAGE_PLACES = _limit("storage places in the details of a body", 12, "a short list", excess=Excess.CUT)
PASTE_CHARACTERS = _limit("characters of bodies that are pasted", 5_000_000, "2,000 bodies")
PLAN_CHARACTERS = _limit("characters of a plan", 200_000, "a thousand times a usual plan")
FACTS = _limit("facts in the details of a body", 200, "more are not read", excess=Excess.CUT)
REPORT_ENTRIES = _limit("entries of the report of the page", 5000, "the total is shown", excess=Excess.CUT)
UNSEEN_BODIES = _limit(
    "bodies that a page is asked to frame", 500, "a highlight of more fills the view", excess=Excess.CUT
)
LABELS = _limit(
    "labels that a page receives", 1000, "the largest bodies; a page draws those that have space", excess=Excess.CUT
)
SURFACES = _limit(
    "support surfaces near the pointer that are tried", 6, "the farther ones are not meant", excess=Excess.CUT
)
SKILL_TIME = _limit("simulated time of a skill of the page", 600.0, "a robot that is stuck would never end", unit="s")
FOUND_CLASSES = _limit("classes that a search of the page finds", 120, "a list to choose from", excess=Excess.CUT)
TRAIL_POINTS = _limit("points of the trail of a body", 2_000, "more are not told apart", excess=Excess.CUT)
TRAIL_GHOSTS = _limit("copies along the trail of a body", 12, "more cover one another", excess=Excess.CUT)
GHOSTS = _limit("end poses that are drawn for a body of a plan", 200, "more cover one another", excess=Excess.CUT)
COPIED_BODIES = _limit(
    "bodies that are drawn for an open copy", 300, "only those that differ are drawn", excess=Excess.CUT
)
ANSWER_PARTS = _limit("terms in the solutions of a goal", 20_000_000, "their conversion needs memory")
REQUEST_PARTS = _limit("terms in the arguments of a predicate", 200_000, "their conversion needs memory")
TERM_DEPTH = _limit("nesting of a term", 100, "deeper terms are cyclic, or exhaust the stack")
OBSERVATIONS = _limit(
    "observed states that are kept for questions about earlier times",
    256,
    "each has a whole world; the oldest are forgotten",
    excess=Excess.CUT,
)
PROLOG_SKILL_TIME = _limit(
    "simulated time of a skill in Prolog", 300.0, "a robot that is stuck would never end", unit="s"
)
PLAIN_BYTES = _limit("request that names things", 1 << 20, "names of some thousand bodies", unit="B")
CONTROL_BYTES = _limit("operation without a payload", 64 << 10, "names and options only", unit="B")
EDIT_BYTES = _limit("request that edits", 8 << 20, "some thousand poses or markers", unit="B")
FILE_BYTES = _limit("request with a map", 32 << 20, "the largest message of the rosbridge", unit="B")
MESSAGE_BYTES = _limit("message of the rosbridge", 32 << 20, "its payload has limits of its own", unit="B")
FILE_TIME = _limit(
    "time of a request with a map or a long run",
    300.0,
    "the largest known map needs a minute",
    unit="s",
)
QUESTION_PROCESSES = _limit(
    "processes that answer the questions of ports",
    2,
    "each takes a core; they have the statements in common, so that their memory does not double",
    excess=Excess.SLOWED,
)
QUESTION_TIME = _limit(
    "time of a question in its process", 30.0, "the process is ended then, and others wait for it", unit="s"
)
QUESTION_WAIT = _limit(
    "time that a question waits for a process",
    20.0,
    "clients take turns; a question that waits longer would be answered after its client has given up",
    unit="s",
)
CLIENT_QUESTIONS = _limit(
    "waiting questions of a client", 256, "as many as a client of the rosbridge may have calls that are pending"
)
QUESTIONS = _limit("waiting questions", 4096, "each is kept in memory; they are refused before they wait too long")
QUESTION_STATEMENTS = _limit(
    "statements of which processes have a copy",
    500_000,
    "the copy takes memory, and seconds of a lock; questions about more are answered one after the other by the server",
    excess=Excess.SLOWED,
)
QUESTION_CACHE = _limit(
    "answers that are kept until the state changes",
    32 * _MIB,
    "many clients ask the same; the oldest are forgotten",
    unit="B",
    excess=Excess.CUT,
)
QUERY_SERVICE_TIME = _limit(
    "time of a question or a query",
    60.0,
    "the query itself, and its place in the queue",
    unit="s",
)
GOAL_TIME = _limit("time of a goal", 3600.0, "goals can be observed and canceled", unit="s")
VISITORS = _limit("addresses that are remembered", 4096, "those that used least are forgotten first", excess=Excess.CUT)
HANDSHAKE = _limit("time of the TLS handshake", 10.0, "a client that does not complete it occupies a socket", unit="s")


Speed = Annotated[float, SPEED.meta]
Duration = Annotated[float, STEP_DURATION.meta]
Timeout = Annotated[float, CALL_TIMEOUT.meta]
MotionTimeout = Annotated[float, MOTION_TIMEOUT.meta]
Rate = Annotated[float, PUBLISH_RATE.meta]
Lifetime = Annotated[float, MARKER_LIFETIME.meta]
PositiveDuration = Annotated[float, msgspec.Meta(gt=0.0, le=STEP_DURATION.maximum, extra={"unit": "s"})]
Deadline = Annotated[float, msgspec.Meta(gt=0.0, le=1e9, extra={"unit": "s"})]
Samples = Annotated[int, msgspec.Meta(ge=1, le=PLAN_SAMPLES.count)]
"""Types of parameters, see `ranges`."""


class VisitorLimits(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Limits of one address at a server; the defaults are far above what robots and their tools need.

    Of rates, bursts of several seconds are allowed. A visitor that sends too fast is read more slowly, so that no
    message is lost.
    """

    connections: Count = 64
    """Open connections of an address that is not this machine."""
    messages_per_second: Positive = 5000.0
    """Messages from an address that is not this machine [1/s]."""
    bytes_per_second: Positive = 64.0 * 1024**2
    """Bytes from an address that is not this machine [B/s]."""
    queries_per_second: Positive = 10.0
    """Queries, questions, files and other expensive requests of any port, from an address that is not this machine."""
    failed_tokens_per_minute: Positive = 20.0
    """Wrong tokens from any address; beyond it, no token from that address is checked for a while."""

    def __post_init__(self) -> None:
        check_fields(self)


DEFAULT_VISITOR_LIMITS = VisitorLimits()
"""Limits that are used unless others are given."""


class RpcLimits(msgspec.Struct, frozen=True, kw_only=True):
    """Limits of the channel of the page."""

    max_sessions: Count = 64
    """Open pages."""
    message_bytes: Count = 24 * _MIB
    """Size of a message; maps are uploaded in one message [B]."""
    max_pending: Count = 64
    """Unanswered requests of a page."""
    max_requests_per_second: Positive = 120.0
    """Sustained rate of a page; bursts of twice as many are allowed [1/s]."""

    def __post_init__(self) -> None:
        check_fields(self)


class BridgeLimits(msgspec.Struct, frozen=True, kw_only=True):
    """Limits of a connection, a server and a broker.

    The defaults are generous for a robot and its tools, and small compared with the memory of a machine.
    """

    message_bytes: Count = 32 * _MIB
    """Size of one message after fragments were joined and compression was removed."""
    png_bytes: Count = 1 * _MIB
    """Size of the pixels of one PNG message."""
    cbor_bytes: Count = 8 * _MIB
    """Size of one binary frame; its typed arrays become several times larger when they are decoded."""
    depth: Count = 64
    """Nesting depth of arrays and objects."""
    fragments: Count = 4096
    """Fragments of one message, in both directions."""
    fragmented_messages: Index = 16
    """Incomplete messages of one connection."""
    fragment_timeout_s: Deadline = 30.0
    """Time between two fragments of a message, after which the message is discarded [s]."""
    connections: Count = 256
    """Connections of one server."""
    calls: Index = 256
    """Pending service calls of one client."""
    goals: Index = 64
    """Active action goals of one client."""
    orphaned_goal_timeout_s: Deadline = 60.0
    """Time for the result of a goal that was canceled because its client disconnected [s]."""
    advertisements: Index = 1024
    """Services, actions and topics that one client advertises."""
    subscriptions: Index = 1024
    """Subscriptions of one client."""
    waiting_messages: Count = 16384
    """Queued frames to one peer; a peer that reads so slowly that the limit is exceeded is disconnected."""
    waiting_bytes: Count = 64 * _MIB
    """Total size of the queued frames to one peer."""
    call_timeout_s: Deadline = 10.0
    """Timeout of a service call that has none of its own [s]."""
    max_call_timeout_s: Deadline = 3600.0
    """Longest timeout that a service call can request [s]."""
    auth_timeout_s: Deadline = 10.0
    """Time for a client to authenticate, if a token is required [s]."""

    def __post_init__(self) -> None:
        check_fields(self)


DEFAULT_BRIDGE_LIMITS = BridgeLimits()
"""Limits that are used unless others are given."""
