"""Exports: worlds as files of formats that hold what a place looks like, and not all that is known of it."""

from mindstage.exports.gltf import GlbExport, geometry_to_glb, world_to_glb
from mindstage.exports.shelf import cache_geometry_glb, geometry_cache_dir

__all__ = ["GlbExport", "cache_geometry_glb", "geometry_cache_dir", "geometry_to_glb", "world_to_glb"]
