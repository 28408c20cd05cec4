"""Models of robots: reading of URDF, xacro, MJCF and SRDF, and the catalog of installed models."""

from mindstage.robots.models.catalog import find_model, list_models
from mindstage.robots.models.reading import load_model

__all__ = ["find_model", "list_models", "load_model"]

__dir__ = __all__.copy
