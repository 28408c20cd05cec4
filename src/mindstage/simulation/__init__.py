"""Simulation of the worlds of a knowledge base in a physics engine, with highlights, placement and undo."""

from mindstage.engines.base import EngineStats, SpawnNoteKind
from mindstage.simulation.engine_thread import EngineAccess
from mindstage.simulation.highlights import (
    HighlightGroup,
    HighlightResult,
    Marker,
    MarkerStore,
    MarkerType,
    UnhighlightedItem,
)
from mindstage.simulation.image import SimulationImage
from mindstage.simulation.imagined import ForkOrigin
from mindstage.simulation.interaction import JointAxisState, JointHandle, SpawnRecord
from mindstage.simulation.joint_motion import JointMotion, SimulationJoint
from mindstage.simulation.observation import ClientDirectory, ConnectedClient
from mindstage.simulation.simulation import Simulation
from mindstage.simulation.state import SimulationBody, StateSnapshot
from mindstage.simulation.undo import Edits, UndoHistory

__all__ = [
    "ClientDirectory",
    "ConnectedClient",
    "Edits",
    "EngineAccess",
    "EngineStats",
    "ForkOrigin",
    "HighlightGroup",
    "HighlightResult",
    "JointAxisState",
    "JointHandle",
    "JointMotion",
    "Marker",
    "MarkerStore",
    "MarkerType",
    "Simulation",
    "SimulationBody",
    "SimulationImage",
    "SimulationJoint",
    "SpawnNoteKind",
    "SpawnRecord",
    "StateSnapshot",
    "UndoHistory",
    "UnhighlightedItem",
]

__dir__ = __all__.copy
