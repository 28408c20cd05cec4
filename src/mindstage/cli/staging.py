"""Staging: a simulation as a verb's options want it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from mindstage.api import make_simulation
from mindstage.errors import SourceParseError

if TYPE_CHECKING:
    from mindstage.engines import Engine
    from mindstage.knowledge import KnowledgeBase
    from mindstage.stage import Simulation

__all__ = ["asset_folders", "simulation_from_options"]


def simulation_from_options(
    knowledge: KnowledgeBase, engine: Engine, *, assets: list[Path] | None = None, plain_boxes: bool = False
) -> Simulation:
    """`mindstage.api.simulation_from_options` for a verb's options.

    Args:
        knowledge: what is known.
        engine: who runs it.
        assets: folders of meshes, besides what the map itself names.
        plain_boxes: whether every body is the primitive shape that the map says, and nothing better.

    Raises:
        SourceParseError: one of the folders is none.
    """
    folders = () if plain_boxes else asset_folders(assets)
    return make_simulation(knowledge, engine, assets=folders, plain_shapes=plain_boxes)


def asset_folders(folders: list[Path] | None) -> list[Path]:
    """The folders of `--assets`.

    Raises:
        SourceParseError: one of them does not exist.
    """
    for folder in folders or ():
        if not folder.is_dir():
            raise SourceParseError(str(folder), cause="there is no such folder; --assets takes folders of mesh files")
    return folders or []
