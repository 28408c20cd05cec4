"""NullEngine fulfills the part of the contract without physics."""

import pytest

from mindstage.engines import NullEngine
from tests.engines.contract import DescriptionContract
from tests.engines.geometry_contract import GeometryDescriptionContract


class TestNullEngine(DescriptionContract, GeometryDescriptionContract):
    @pytest.fixture
    def engine(self) -> NullEngine:
        return NullEngine()
