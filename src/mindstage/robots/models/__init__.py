"""Models of robots: reading of URDF, xacro, MJCF and SRDF, and the catalog of installed models."""

from mindstage.robots.models.reading import load_model

__all__ = ["load_model"]
