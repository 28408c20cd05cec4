"""MujocoEngine agrees with mechanics on paper."""

from __future__ import annotations

import pytest

from mindstage.engines.mujoco import MujocoEngine
from tests.engines.mechanics_contract import MechanicsContract


class TestMujocoMechanics(MechanicsContract):
    turned_tolerance_m = 0.008
    """The velocity of a contact's constraint follows from J q' without the derivative of J: on what turns at w, a body
    creeps outwards by w² r times half of the time constant of contacts, 10 ms."""

    @pytest.fixture
    def engine(self) -> MujocoEngine:
        return MujocoEngine()
