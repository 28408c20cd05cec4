"""NullEngine keeps all of the contract that needs no physics."""

import pytest

from mindstage.engines import NullEngine

from .contract import DescriptionContract


class TestNullEngine(DescriptionContract):
    @pytest.fixture
    def engine(self) -> NullEngine:
        return NullEngine()
