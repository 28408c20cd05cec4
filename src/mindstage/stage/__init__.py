"""Stage: one knowledge base and one engine, brought together in one loop."""

from mindstage.engines.contract import NoteKind
from mindstage.stage.stage import Frame, Stage

__all__ = ["Frame", "NoteKind", "Stage"]
