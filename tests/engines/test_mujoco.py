"""MujocoEngine keeps the whole contract, and what only MuJoCo can be asked about."""

import pytest

from mindstage.engines import MujocoEngine

from .contract import PhysicsContract


class TestMujocoEngine(PhysicsContract):
    @pytest.fixture
    def engine(self) -> MujocoEngine:
        return MujocoEngine()
