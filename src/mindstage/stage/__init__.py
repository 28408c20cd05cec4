"""Stage: one knowledge base and one engine, brought together in one loop."""

from mindstage.engines.contract import NoteKind
from mindstage.stage.frame import Frame
from mindstage.stage.lights import Lit, NotLit, Shown
from mindstage.stage.markers import Marker, MarkerForm
from mindstage.stage.stage import Stage

__all__ = ["Frame", "Lit", "Marker", "MarkerForm", "NotLit", "NoteKind", "Shown", "Stage"]
