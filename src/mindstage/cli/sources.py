"""Sources: from what was typed to a knowledge base."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mindstage.knowledge import KnowledgeBase

__all__ = ["BUNDLED_KITCHEN", "knowledge_base"]

BUNDLED_KITCHEN = "bundled:kitchen"
"""Names the map that comes with Mindstage, wherever it is installed."""


def knowledge_base(maps: Sequence[str], *, ontologies: Sequence[str] | None, bundled: bool) -> KnowledgeBase:
    """A knowledge base that has loaded the maps.

    Raises:
        SourceUnreadable: one of them cannot be read.
    """
    from mindstage.knowledge import KnowledgeBase, bundled_kitchen

    knowledge = KnowledgeBase(bundled_ontology=bundled)
    paths = [bundled_kitchen() if name == BUNDLED_KITCHEN else Path(name) for name in maps]
    knowledge.load(paths, ontologies=[*(ontologies or ()), *_ros_packages()])
    return knowledge


def _ros_packages() -> list[str]:
    # ROS itself says nothing about folders of that list which do not exist.
    folders = os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)
    return [folder for folder in folders if folder and Path(folder).is_dir()]
