"""Every error Mindstage raises, one class for each thing that a caller can act on.

    MindstageError
    ├── WorldError              the world itself says no (exit code 1)
    │   ├── BodyUnknown         no body of that id
    │   ├── BodyExists          the id is taken
    │   ├── PoseUnreachable     a constraint or attachment forbids the pose
    │   ├── SpotMissing         nothing like that can be put there
    │   ├── ReturnRefused       what was deleted cannot come back
    │   ├── NothingToUndo       no edit is left to be taken back
    │   └── AttachmentRefused   it would close a circle, or the child hangs elsewhere
    ├── KnowledgeError          a source cannot be used (exit code 2)
    │   ├── SourceUnreadable    no such file, or not what its format promises
    │   ├── MapMissing          no semantic map where one was asked for
    │   ├── MapAmbiguous        several maps, and nobody said which
    │   ├── MapRefused          something is odd about a map, and nothing odd was to be allowed
    │   ├── MapUnwritable       a world holds what no map file can, or the file cannot be written
    │   ├── NameUnknown         nothing of that kind has the name
    │   ├── NameAmbiguous       several things have the name
    │   ├── QuestionUnknown     no question is called so
    │   ├── QuestionTimedOut    its answer did not come in time
    │   ├── TooManyQuestions    so many are being answered that one more has no turn
    │   ├── ArgumentRefused     a question, or what it is told, has no such form
    │   ├── QueryRefused        it is no SPARQL query
    │   ├── QueryTimedOut       a SPARQL query did not end in time
    │   ├── ReasonerUnavailable OWL 2 RL's rules need a library that is not installed
    │   ├── StoreUnusable       a folder of stored knowledge cannot be opened, or not written
    │   ├── ShapeUnknown        no shape is called so
    │   ├── ShapeRefused        a shape's size or parameter says what cannot be
    │   ├── EndpointUnreachable nobody answers at the endpoint, or not in time
    │   └── EndpointRefused     the endpoint answers with no, or with what is no answer
    ├── EngineError             the engine itself broke (exit code 2)
    │   ├── EngineUnavailable   it is not installed, or cannot be reached
    │   ├── EngineTimedOut      it did not answer in time; whether it did it, nobody knows
    │   ├── EngineUnable        it has no means to do that
    │   ├── EngineClosed        it was closed before the call
    │   └── SimulationUnstable  the physics produced numbers that mean nothing
    ├── StageError              the stage could not take the call (exit code 2)
    │   └── StageTimedOut       the stage's own thread did not answer in time
    ├── BridgeError             whoever is at the other end of a bridge (exit code 2)
    │   ├── BridgeUnavailable   nothing can be served at that address
    │   ├── AccessRefused       a token is missing, or it is the wrong one
    │   ├── ConnectionLost      nobody is there, or nobody any more
    │   ├── ServiceUnknown      nobody offers a service or action of that name
    │   ├── ServiceTimedOut     its answer did not come in time
    │   ├── ServiceFailed       the answer is the text of an error
    │   ├── OfferRefused        that name is taken by somebody else
    │   ├── MessageRefused      a message has not the form of its type, or is too large
    │   └── TypeUnknown         no ROS message, service or action of that name is known
    ├── ColourUnknown           no colour is called or written so (exit code 2)
    ├── PrologError             a Prolog console cannot do it (exit code 2)
    │   ├── PrologUnavailable   SWI-Prolog or pyswip is not installed, or taken
    │   ├── GoalRefused         it is no Prolog, or it threw an error
    │   └── GoalTimedOut        a goal did not end in time
    ├── BrowserError            the browser that takes pictures cannot do it (exit code 2)
    │   ├── BrowserUnavailable  none is installed, or it does not start
    │   └── BrowserBroken       it ended, refused, or did not answer in time
    ├── RequestRefused          what a page sent is nothing that can be done (exit code 2)
    └── ViewportUnavailable     the page cannot be served at that address (exit code 2)

Facts are fields, the sentence is made in `__str__`, and it ends with what exists or what to try.
"""

from mindstage.errors.bridge import (
    AccessRefused,
    BridgeError,
    BridgeUnavailable,
    ConnectionLost,
    MessageRefused,
    OfferRefused,
    ServiceFailed,
    ServiceTimedOut,
    ServiceUnknown,
    TypeUnknown,
)
from mindstage.errors.engine import (
    EngineClosed,
    EngineError,
    EngineTimedOut,
    EngineUnable,
    EngineUnavailable,
    SimulationUnstable,
    StageError,
    StageTimedOut,
)
from mindstage.errors.knowledge import (
    ArgumentRefused,
    EndpointRefused,
    EndpointUnreachable,
    KnowledgeError,
    MapAmbiguous,
    MapMissing,
    MapRefused,
    MapUnwritable,
    NameAmbiguous,
    NameUnknown,
    QueryRefused,
    QueryTimedOut,
    QuestionTimedOut,
    QuestionUnknown,
    ReasonerUnavailable,
    ShapeRefused,
    ShapeUnknown,
    SourceUnreadable,
    StoreUnusable,
    TooManyQuestions,
)
from mindstage.errors.root import (
    MindstageError,
)
from mindstage.errors.surfaces import (
    BrowserBroken,
    BrowserError,
    BrowserUnavailable,
    ColourUnknown,
    GoalRefused,
    GoalTimedOut,
    PrologError,
    PrologUnavailable,
    RequestRefused,
    ViewportUnavailable,
)
from mindstage.errors.world import (
    AttachmentRefused,
    BodyExists,
    BodyUnknown,
    NothingToUndo,
    PoseUnreachable,
    ReturnRefused,
    SpotMissing,
    WorldError,
)

__all__ = [
    "AccessRefused",
    "ArgumentRefused",
    "AttachmentRefused",
    "BodyExists",
    "BodyUnknown",
    "BridgeError",
    "BridgeUnavailable",
    "BrowserBroken",
    "BrowserError",
    "BrowserUnavailable",
    "ColourUnknown",
    "ConnectionLost",
    "EndpointRefused",
    "EndpointUnreachable",
    "EngineClosed",
    "EngineError",
    "EngineTimedOut",
    "EngineUnable",
    "EngineUnavailable",
    "GoalRefused",
    "GoalTimedOut",
    "KnowledgeError",
    "MapAmbiguous",
    "MapMissing",
    "MapRefused",
    "MapUnwritable",
    "MessageRefused",
    "MindstageError",
    "NameAmbiguous",
    "NameUnknown",
    "NothingToUndo",
    "OfferRefused",
    "PoseUnreachable",
    "PrologError",
    "PrologUnavailable",
    "QueryRefused",
    "QueryTimedOut",
    "QuestionTimedOut",
    "QuestionUnknown",
    "ReasonerUnavailable",
    "RequestRefused",
    "ReturnRefused",
    "ServiceFailed",
    "ServiceTimedOut",
    "ServiceUnknown",
    "ShapeRefused",
    "ShapeUnknown",
    "SimulationUnstable",
    "SourceUnreadable",
    "SpotMissing",
    "StageError",
    "StageTimedOut",
    "StoreUnusable",
    "TooManyQuestions",
    "TypeUnknown",
    "ViewportUnavailable",
    "WorldError",
]
