"""Consoles to ask: one kitchen that nobody changes, and fresh ones."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from mindstage.engines import NullEngine
from mindstage.knowledge import KnowledgeBase, bundled_kitchen
from mindstage.prolog import PrologConsole
from mindstage.simulation import Simulation


@pytest.fixture(scope="session")
def prolog(swipl: Path) -> Path:
    """SWI-Prolog, and what joins it to Python."""
    if importlib.util.find_spec("pyswip") is None:
        reason = "pyswip is not installed (the extra prolog)"
        if os.environ.get("CI"):
            pytest.fail(reason)
        pytest.skip(reason)
    return swipl


@pytest.fixture(scope="session")
def kitchen_knowledge() -> KnowledgeBase:
    """What the bundled kitchen tells."""
    knowledge = KnowledgeBase()
    knowledge.load(bundled_kitchen())
    return knowledge


@pytest.fixture(scope="session")
def kitchen_simulation(kitchen_knowledge: KnowledgeBase) -> Iterator[Simulation]:
    """A simulation on which nobody spawns anything."""
    with Simulation(kitchen_knowledge, NullEngine()) as simulation:
        yield simulation


@pytest.fixture
def kitchen(prolog: Path, kitchen_simulation: Simulation) -> Iterator[PrologConsole]:
    """A console to ask about the bundled kitchen; it is not to be changed."""
    with PrologConsole(kitchen_simulation) as console:
        yield console


@pytest.fixture
def simulation() -> Iterator[Simulation]:
    """A kitchen to be changed."""
    knowledge = KnowledgeBase()
    knowledge.load(bundled_kitchen())
    with Simulation(knowledge, NullEngine()) as simulation:
        yield simulation


@pytest.fixture
def console(prolog: Path, simulation: Simulation) -> Iterator[PrologConsole]:
    """A console whose knowledge and world may be changed."""
    with PrologConsole(simulation) as console:
        yield console
