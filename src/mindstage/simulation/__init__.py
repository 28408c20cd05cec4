"""Stage: one knowledge base and one engine, brought together in one loop."""

from mindstage.engines.contract import EngineStats, SpawnNoteKind
from mindstage.stage.company import ClientDirectory, ConnectedClient
from mindstage.stage.editing import UndoHistory, UndoStack
from mindstage.stage.frame import StateSnapshot
from mindstage.stage.joint_motion import JointMotion, SimulationJoint
from mindstage.stage.joints import JointAxisState, JointHandle
from mindstage.stage.lights import HighlightGroup, HighlightResult, UnhighlightedItem
from mindstage.stage.markers import Marker, MarkerType
from mindstage.stage.removal import SpawnRecord
from mindstage.stage.stage import Simulation

__all__ = [
    "ClientDirectory",
    "ConnectedClient",
    "EngineStats",
    "HighlightGroup",
    "HighlightResult",
    "JointAxisState",
    "JointHandle",
    "JointMotion",
    "Marker",
    "MarkerType",
    "Simulation",
    "SimulationJoint",
    "SpawnNoteKind",
    "SpawnRecord",
    "StateSnapshot",
    "UndoHistory",
    "UndoStack",
    "UnhighlightedItem",
]
