"""Staging: a stage as a verb's options want it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from mindstage.errors import SourceUnreadable

if TYPE_CHECKING:
    from mindstage.assets import Assets
    from mindstage.engines import Engine
    from mindstage.knowledge import KnowledgeBase
    from mindstage.stage import Stage

__all__ = ["assets_in", "stage_for"]


def stage_for(
    knowledge: KnowledgeBase, engine: Engine, *, assets: list[Path] | None = None, plain_boxes: bool = False
) -> Stage:
    """A stage whose bodies have the meshes that are at hand, and else the shapes that knowledge gives them.

    Args:
        knowledge: what is known.
        engine: who runs it.
        assets: folders of meshes, besides what the map itself names.
        plain_boxes: whether every body shall be the box, ball or cylinder that the map says, and nothing better.

    Raises:
        SourceUnreadable: one of the folders is none.
    """
    from mindstage.stage import Stage

    if plain_boxes:
        return Stage(knowledge, engine, shapes=False)
    return Stage(knowledge, engine, meshes=assets_in(assets, knowledge))


def assets_in(folders: list[Path] | None, knowledge: KnowledgeBase) -> Assets:
    """The meshes in some folders, and those that maps name.

    Raises:
        SourceUnreadable: one of the folders is none.
    """
    from mindstage.assets import Assets

    for folder in folders or ():
        if not folder.is_dir():
            raise SourceUnreadable(str(folder), cause="there is no such folder; --assets takes folders of mesh files")
    return Assets(folders or (), find_file=knowledge.find_file)
