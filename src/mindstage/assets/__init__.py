"""Assets: mesh files that others have modeled, found and made into forms."""

from mindstage.assets.library import MeshGeometries, MeshLibrary

__all__ = ["MeshGeometries", "MeshLibrary"]
