"""Exports: worlds as files of formats that hold what a place looks like, and not all that is known of it."""

from mindstage.exports.gltf import Glb, glb

__all__ = ["Glb", "glb"]
