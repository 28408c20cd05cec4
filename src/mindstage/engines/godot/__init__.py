"""Godot: a world in a Godot 4 that is started for it, and ends with it."""

from mindstage.engines.godot.engine import GodotEngine
from mindstage.engines.godot.program import GodotExecutable, find_godot

__all__ = ["GodotEngine", "GodotExecutable", "find_godot"]
