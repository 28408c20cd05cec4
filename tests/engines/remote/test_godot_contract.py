"""GodotEngine fulfills the contract, in single precision.

One Godot process serves all tests and is cleared between them; a test that closes its engine gets its own process.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from mindstage.engines.remote.godot import GodotEngine
from tests.engines.actuator_contract import ActuatorContract
from tests.engines.contract import PhysicsContract
from tests.engines.geometry_contract import GeometryContract


@pytest.fixture(scope="module")
def running(godot: Path) -> Iterator[GodotEngine]:
    with closing(GodotEngine(godot)) as engine:
        yield engine


class TestGodotEngine(PhysicsContract, ActuatorContract, GeometryContract):
    placement_tolerance = 1e-5
    attachment_tolerance = 1e-5
    limit_tolerance_m = 0.002
    limit_tolerance_rad = np.radians(0.5)
    speed_tolerance = 0.03
    has_armature = False
    measures_efforts = False
    grip_tolerance_m = 0.012

    @pytest.fixture
    def engine(self, request: pytest.FixtureRequest, godot: Path) -> Iterator[GodotEngine]:
        if "closing" in request.node.name:
            with closing(GodotEngine(godot)) as engine:
                yield engine
            return
        running: GodotEngine = request.getfixturevalue("running")
        yield running
        running.clear()

    def test_time_advances_by_the_requested_duration(self, engine: GodotEngine) -> None:
        """As in the contract, but time has already passed, since one process serves many tests."""
        before_s = engine.time_s
        for _ in range(300):
            engine.step(1 / 60)
        assert engine.time_s - before_s == pytest.approx(5.0, abs=0.01)
