"""Stage: one knowledge base and one engine, brought together in one loop."""

from mindstage.engines.contract import NoteKind, Statistics
from mindstage.stage.company import Company, Guest
from mindstage.stage.editing import Editing, History
from mindstage.stage.frame import Frame
from mindstage.stage.joint_motion import JointMotion, SimulationJoint
from mindstage.stage.joints import Joint, JointAxis
from mindstage.stage.lights import Lit, NotLit, Shown
from mindstage.stage.markers import Marker, MarkerForm
from mindstage.stage.removal import Spawned
from mindstage.stage.stage import Stage

__all__ = [
    "Company",
    "Editing",
    "Frame",
    "Guest",
    "History",
    "Joint",
    "JointAxis",
    "JointMotion",
    "Lit",
    "Marker",
    "MarkerForm",
    "NotLit",
    "NoteKind",
    "Shown",
    "SimulationJoint",
    "Spawned",
    "Stage",
    "Statistics",
]
