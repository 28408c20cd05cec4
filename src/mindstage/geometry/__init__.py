"""Shapes: what bodies are made of where no mesh file says it, built from few parameters to the exact size."""

from mindstage.geometry.fit import FittedGeometry, fit_geometry
from mindstage.geometry.procedural import SHAPE_TEMPLATES
from mindstage.geometry.procedural.build import build_geometry, template_by_name
from mindstage.geometry.procedural.builder import BodySide, Cutout, ShapeTemplate

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
