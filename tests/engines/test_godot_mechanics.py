"""GodotEngine agrees with mechanics on paper, within the tolerances of its solver."""

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
    @pytest.fixture
    def engine(self, running: GodotEngine) -> Iterator[GodotEngine]:
        yield running
        running.clear()
