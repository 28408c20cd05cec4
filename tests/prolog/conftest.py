"""Fixtures: Prolog consoles of a shared, unchanged kitchen and of fresh ones."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from mindstage.engines import NullEngine
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import bundled_kitchen
from mindstage.prolog import PrologConsole
from mindstage.simulation import Simulation


@pytest.fixture(scope="session")
def prolog(swipl: Path) -> Path:
    """SWI-Prolog and pyswip."""
    if importlib.util.find_spec("pyswip") is None:
        reason = "pyswip is not installed (the extra prolog)"
        if os.environ.get("CI"):
            pytest.fail(reason)
        pytest.skip(reason)
    return swipl


@pytest.fixture(scope="session")
def kitchen_knowledge() -> KnowledgeBase:
    """The knowledge base of the bundled kitchen."""
    knowledge = KnowledgeBase()
    knowledge.load(bundled_kitchen())
    return knowledge


@pytest.fixture(scope="session")
def kitchen_simulation(kitchen_knowledge: KnowledgeBase) -> Iterator[Simulation]:
    """An empty simulation that tests do not change."""
    with Simulation(kitchen_knowledge, NullEngine()) as simulation:
        yield simulation


@pytest.fixture
def kitchen(prolog: Path, kitchen_simulation: Simulation) -> Iterator[PrologConsole]:
    """A console of the bundled kitchen, which tests do not change."""
    with PrologConsole(kitchen_simulation) as console:
        yield console


@pytest.fixture
def simulation() -> Iterator[Simulation]:
    """A simulation of the kitchen that tests may change."""
    knowledge = KnowledgeBase()
    knowledge.load(bundled_kitchen())
    with Simulation(knowledge, NullEngine()) as simulation:
        yield simulation


@pytest.fixture
def console(prolog: Path, simulation: Simulation) -> Iterator[PrologConsole]:
    """A console whose knowledge base and world tests may change."""
    with PrologConsole(simulation) as console:
        yield console
