"""Mechanics of GodotEngine, within the tolerances that are stated here."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from mindstage.engines.remote.godot import GodotEngine
from tests.engines.mechanics_contract import MechanicsContract


@pytest.fixture(scope="module")
def running(godot: Path) -> Iterator[GodotEngine]:
    with closing(GodotEngine(godot)) as engine:
        yield engine


class TestGodotMechanics(MechanicsContract):
    tolerance = 0.05
    carried_tolerance_m = 0.01
    turned_tolerance_m = 0.02
    depth_tolerance_m = 0.005
    line_tolerance_m = 0.1
    commanded_tolerance = 1e-5

    @pytest.mark.parametrize("floor", ["box", pytest.param("hull", marks=pytest.mark.slow)])
    @pytest.mark.parametrize("direction_deg", [0, 217])
    def test_a_ball_rolls_straight_and_gains_no_energy(
        self, engine: GodotEngine, floor: str, direction_deg: int
    ) -> None:
        super().test_a_ball_rolls_straight_and_gains_no_energy(engine, floor, direction_deg)

    @pytest.mark.parametrize("floor", ["box", pytest.param("hull", marks=pytest.mark.slow)])
    @pytest.mark.parametrize("direction_deg", [45])
    def test_a_lying_can_gains_no_energy(self, engine: GodotEngine, floor: str, direction_deg: int) -> None:
        super().test_a_lying_can_gains_no_energy(engine, floor, direction_deg)

    @pytest.fixture
    def engine(self, running: GodotEngine) -> Iterator[GodotEngine]:
        yield running
        running.clear()
