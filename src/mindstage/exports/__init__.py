"""Exports: worlds as files of formats that hold what a place looks like, and not all that is known of it."""

from mindstage.exports.gltf import Glb, form_glb, glb
from mindstage.exports.shelf import shelf_folder, shelve

__all__ = ["Glb", "form_glb", "glb", "shelf_folder", "shelve"]
