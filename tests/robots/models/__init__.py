"""Tests of `mindstage.robots.models` and of robots in worlds."""
