"""Sources: from what was typed to a knowledge base."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mindstage.knowledge import Finding, KnowledgeBase
    from mindstage.world import World

__all__ = ["BUNDLED_KITCHEN", "findings_about", "knowledge_base"]

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


def findings_about(world: World, knowledge: KnowledgeBase) -> tuple[Finding, ...]:
    """Everything odd, an empty world among it: more likely a map that was not understood than an empty place."""
    from mindstage.knowledge import Finding, Severity

    if world.bodies:
        return knowledge.findings()
    what = "nothing in it could be read as a body; maps of some dialects cannot be read yet"
    return (*knowledge.findings(), Finding(Severity.WARNING, world.iri, "", what, "the world is empty"))


def _ros_packages() -> list[str]:
    # ROS itself says nothing about folders of that list which do not exist.
    folders = os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)
    return [folder for folder in folders if folder and Path(folder).is_dir()]
