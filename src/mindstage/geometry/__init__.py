"""Geometry of bodies without a mesh file: shape templates with parameters, built to the exact size of a body."""

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

__dir__ = __all__.copy
