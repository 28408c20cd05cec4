"""RemoteEngine keeps the whole contract: another Mindstage's MuJoCo, driven over a real socket."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing

import pytest

from mindstage.engines import RemoteEngine, connect
from tests.engines.contract import PhysicsContract
from tests.engines.far_side import ServedSimulation
from tests.engines.forms_contract import GeometryContract


class TestRemoteEngine(PhysicsContract, GeometryContract):
    @pytest.fixture
    def engine(self) -> Iterator[RemoteEngine]:
        with ServedSimulation() as far_side, closing(connect(far_side.address)) as engine:
            yield engine
