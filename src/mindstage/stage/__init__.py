"""Stage: one knowledge base and one engine, brought together in one loop."""

from mindstage.stage.stage import Frame, Stage

__all__ = ["Frame", "Stage"]
