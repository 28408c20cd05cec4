"""Godot: a world in a Godot 4 that is started for it, and ends with it."""

from mindstage.engines.godot.engine import GodotEngine
from mindstage.engines.godot.program import Godot, find_godot

__all__ = ["Godot", "GodotEngine", "find_godot"]
