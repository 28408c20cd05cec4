"""Assets: mesh files that others have modeled, found and made into forms."""

from mindstage.assets.assets import MeshGeometries, MeshLibrary

__all__ = ["MeshGeometries", "MeshLibrary"]
