"""Tests of `mindstage.engines.remote`: engines of other processes, and Godot."""
