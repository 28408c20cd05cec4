"""RemoteEngine fulfills the contract with another Mindstage's MuJoCo, over a real socket."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing

import pytest

from mindstage.engines import RemoteEngine, connect
from tests.engines.contract import PhysicsContract
from tests.engines.geometry_contract import GeometryContract
from tests.engines.served_simulation import ServedSimulation


class TestRemoteEngine(PhysicsContract, GeometryContract):
    @pytest.fixture
    def engine(self) -> Iterator[RemoteEngine]:
        with ServedSimulation() as served, closing(connect(served.address)) as engine:
            yield engine
