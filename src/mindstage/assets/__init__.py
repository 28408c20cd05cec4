"""Mesh files and glTF: meshes found for the bodies of a world, and worlds exported as glTF."""

from mindstage.assets.library import MeshLibrary, MeshLibraryResult

__all__ = ["MeshLibrary", "MeshLibraryResult"]

__dir__ = __all__.copy
