"""Tests of `mindstage.robots.skills`."""
