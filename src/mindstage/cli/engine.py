"""Engine: from the name that was typed to an engine that runs."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from mindstage.errors import EngineUnavailable

if TYPE_CHECKING:
    from mindstage.engines import Engine

__all__ = ["make_engine"]

_HERE = "choose mujoco or null"


def make_engine(name: str) -> Engine:
    """The engine of that name.

    Raises:
        EngineUnavailable: there is no such engine, it comes in a later version, or it cannot be loaded here.
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
        case "godot":
            raise EngineUnavailable(name, cause="it comes in a later version", remedy=_HERE)
        case _ if name.startswith("ros://"):
            raise EngineUnavailable(name, cause="engines behind ROS come in a later version", remedy=_HERE)
        case _:
            raise EngineUnavailable(name, cause="there is no engine of that name", remedy=_HERE)
