"""Shapes: what bodies are made of where no mesh file says it, built from few parameters to the exact size."""

from mindstage.shapes.building import build_geometry, template_by_name
from mindstage.shapes.design import ShapeTemplate
from mindstage.shapes.fitting import FittedGeometry, fit_geometry
from mindstage.shapes.kinds import SHAPE_TEMPLATES
from mindstage.shapes.sides import BodySide, Cutout

__all__ = [
    "SHAPE_TEMPLATES",
    "BodySide",
    "Cutout",
    "FittedGeometry",
    "ShapeTemplate",
    "build_geometry",
    "fit_geometry",
    "template_by_name",
]
