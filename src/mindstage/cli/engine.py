"""Engine: from the name that was typed to an engine that runs."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from mindstage.cli.outcome import close_at_end
from mindstage.errors import EngineUnavailableError, MindstageError

if TYPE_CHECKING:
    from mindstage.engines import Engine
    from mindstage.stage import Simulation

__all__ = ["exclusive", "godot_program", "is_remote_engine", "make_engine"]


def make_engine(name: str) -> Engine:
    """`mindstage.engines.make_engine` with the Godot that the environment's `GODOT` names; closed when the verb ends.

    Raises:
        EngineUnavailableError: there is no such engine, it cannot be loaded or started here, or reached.
    """
    from mindstage import engines

    # Nothing is drawn with OpenGL here, and looking for it takes longer than all the rest of MuJoCo's loading.
    os.environ.setdefault("MUJOCO_GL", "disable")
    engine = engines.make_engine(name, godot=godot_program())
    close_at_end(engine.close)
    return engine


def godot_program() -> str | None:
    """The Godot program that the environment names."""
    return os.environ.get("GODOT") or None


def is_remote_engine(name: str) -> bool:
    """Whether the name is the address of an engine that runs elsewhere, with a world that outlives the verb."""
    from mindstage.engines import is_remote

    return is_remote(name)


@contextmanager
def exclusive(simulation: Simulation) -> Iterator[None]:
    """Makes sure that a far world is empty to begin with, and leaves it so; any other is so by itself.

    Raises:
        EngineUnavailableError: something stands there already.
    """
    if not is_remote_engine(simulation.engine_name):
        yield
        return
    there = simulation.snapshot()
    if there.bodies or there.lights or there.facts or there.resources:
        cause = f"its world is not empty ({there.name or there.iri}, with {len(there.bodies)} bodies)"
        remedy = "use a stage that has no map yet, as mindstage serve alone starts one"
        raise EngineUnavailableError(simulation.engine_name, cause=cause, remedy=remedy)
    try:
        yield
    except BaseException:
        with suppress(MindstageError):  # what went wrong first is what is told
            simulation.clear()
        raise
    simulation.clear()
