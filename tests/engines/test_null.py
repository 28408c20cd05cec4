"""NullEngine fulfills the part of the contract without physics."""

import pytest

from mindstage.engines import NullEngine
from mindstage.errors import BodyNotFoundError
from mindstage.scene import BodyId
from mindstage.scene.edits import Spawn
from tests.engines.actuator_contract import ActuatorContract
from tests.engines.contract import DescriptionContract
from tests.engines.geometry_contract import GeometryDescriptionContract
from tests.engines.scenes import room


class TestNullEngine(DescriptionContract, ActuatorContract, GeometryDescriptionContract):
    @pytest.fixture
    def engine(self) -> NullEngine:
        return NullEngine()

    def test_a_force_has_no_effect_and_needs_an_existing_body(self, engine: NullEngine) -> None:
        engine.apply(Spawn(room()))
        engine.apply_force(BodyId("mug"), (1.0, 0.0, 0.0))
        engine.step(1.0)
        assert engine.snapshot().body("mug").pose == room().body("mug").pose
        with pytest.raises(BodyNotFoundError, match="near: 'mug'"):
            engine.apply_force(BodyId("mugg"), (1.0, 0.0, 0.0))
