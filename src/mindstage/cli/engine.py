"""Engine: from the name that was typed to an engine that runs."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from mindstage.cli.outcome import at_end
from mindstage.errors import EngineUnavailable, MindstageError

if TYPE_CHECKING:
    from mindstage.engines import Engine, GodotEngine
    from mindstage.stage import Stage

__all__ = ["alone_in", "godot_engine", "is_far", "make_engine"]

_FAR = "ros://"
_KNOWN = f"choose mujoco, godot, godot:window, null, or {_FAR}HOST:PORT/NAMESPACE"


def make_engine(name: str) -> Engine:
    """The engine of that name; one that is far away is let go of when the verb ends, a Godot of our own is ended.

    Raises:
        EngineUnavailable: there is no such engine, it cannot be loaded or started here, or reached.
    """
    from mindstage import engines

    match name:
        case "null":
            return engines.NullEngine()
        case "mujoco":
            # Nothing is drawn with OpenGL here, and looking for it takes longer than all the rest of MuJoCo's loading.
            os.environ.setdefault("MUJOCO_GL", "disable")
            try:
                return engines.MujocoEngine()
            except ImportError as error:
                raise EngineUnavailable(name, cause=str(error), remedy="reinstall mindstage, or use null") from error
        case "godot" | "godot:window":
            return godot_engine(window=name != "godot")
        case _ if is_far(name):
            far = engines.RemoteEngine.connect(name)
            at_end(far.close)
            return far
        case _:
            raise EngineUnavailable(name, cause="there is no engine of that name", remedy=_KNOWN)


def godot_engine(*, window: bool = False) -> GodotEngine:
    """A Godot of our own, ended with the verb; the environment's `GODOT` says which.

    Raises:
        EngineUnavailable: there is none, it is too old, or it does not start.
    """
    from mindstage import engines

    godot = engines.GodotEngine(os.environ.get("GODOT") or None, window=window)
    at_end(godot.close)
    return godot


def is_far(name: str) -> bool:
    """Whether the name is the address of an engine that runs elsewhere, with a world that outlives the verb."""
    return name.startswith(_FAR)


@contextmanager
def alone_in(stage: Stage) -> Iterator[None]:
    """Makes sure that a far world is empty to begin with, and leaves it so; any other is so by itself.

    Raises:
        EngineUnavailable: something stands there already.
    """
    if not is_far(stage.engine_name):
        yield
        return
    there = stage.log()
    if there.bodies or there.lights or there.facts or there.resources:
        cause = f"its world is not empty ({there.name or there.iri}, with {len(there.bodies)} bodies)"
        remedy = "use a stage that has no map yet, as mindstage serve alone starts one"
        raise EngineUnavailable(stage.engine_name, cause=cause, remedy=remedy)
    try:
        yield
    except BaseException:
        with suppress(MindstageError):  # what went wrong first is what is told
            stage.clear()
        raise
    stage.clear()
