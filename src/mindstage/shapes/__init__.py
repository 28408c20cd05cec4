"""Shapes: what bodies are made of where no mesh file says it, built from few parameters to the exact size."""

from mindstage.shapes.building import build, design_of
from mindstage.shapes.design import Design
from mindstage.shapes.fitting import Fitted, forms_for
from mindstage.shapes.kinds import DESIGNS
from mindstage.shapes.sides import Gap, Side

__all__ = ["DESIGNS", "Design", "Fitted", "Gap", "Side", "build", "design_of", "forms_for"]
