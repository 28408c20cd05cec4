"""Sources: from what was typed to a knowledge base."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mindstage.cli.numbers import AS_THE_MAP_HAS_THEM, Numbers
from mindstage.cli.outcome import at_end
from mindstage.errors import ArgumentRefused, MapRefused

if TYPE_CHECKING:
    from mindstage.knowledge import Endpoint, Finding, KnowledgeBase
    from mindstage.world import World

__all__ = ["BUNDLED_KITCHEN", "findings_about", "knowledge_base"]

BUNDLED_KITCHEN = "bundled:kitchen"
"""Names the map that comes with Mindstage, wherever it is installed."""


def knowledge_base(
    maps: Sequence[str],
    *,
    ontologies: Sequence[str] | None,
    bundled: bool,
    store: Path | None = None,
    endpoint: str | Endpoint | None = None,
    numbers: Numbers = AS_THE_MAP_HAS_THEM,
    robots: Sequence[str] | None = None,
    closure: bool = False,
) -> KnowledgeBase:
    """A knowledge base that has loaded the maps, and derived what follows if asked to; closed when the verb ends.

    Raises:
        SourceUnreadable: one of them cannot be read.
        StoreUnusable: the folder cannot be used.
        ArgumentRefused: the endpoint's address is none, or both were given; or there are no such units, or no such map.
        ReasonerUnavailable: the extra that derives is not installed.
    """
    from mindstage.knowledge import KnowledgeBase

    if closure and store:
        cause = "what it derives would be written into what others use"
        raise ArgumentRefused("--closure", cause=cause, remedy="load the files themselves, without --store")
    knowledge = KnowledgeBase(bundled_ontology=bundled, store=store, endpoint=endpoint)
    at_end(knowledge.close)
    _load(knowledge, maps, [*(ontologies or ()), *_ros_packages()], numbers, robots or ())
    if closure:
        knowledge.derive()
    return knowledge


def _load(
    knowledge: KnowledgeBase, maps: Sequence[str], ontologies: Sequence[str], numbers: Numbers, robots: Sequence[str]
) -> None:
    from mindstage.knowledge import Conventions, bundled_kitchen

    paths = [bundled_kitchen() if name == BUNDLED_KITCHEN else Path(name) for name in maps]
    told = numbers.by_map(maps)
    if len(set(told)) <= 1:
        conventions = told[0] if told else Conventions()
        knowledge.load(paths, ontologies=ontologies, conventions=conventions, robots=robots)
        return
    for path, conventions in zip(paths, told, strict=True):
        knowledge.load(path, ontologies=ontologies, conventions=conventions, robots=robots)


def findings_about(world: World, knowledge: KnowledgeBase, *, strict: bool = False) -> tuple[Finding, ...]:
    """Everything odd, an empty world among it: more likely a map that was not understood than an empty place.

    Raises:
        MapRefused: there is something, and nothing was to be.
    """
    from mindstage.knowledge import Finding, Severity

    findings = knowledge.findings()
    if not world.bodies:
        what = "nothing in it could be read as a body; is it a map?"
        findings = (*findings, Finding(Severity.WARNING, world.iri, "", what, "the world is empty"))
    if strict and findings:
        raise MapRefused(world.iri, findings=[str(finding) for finding in findings])
    return findings


def _ros_packages() -> list[str]:
    # ROS itself says nothing about folders of that list which do not exist.
    folders = os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)
    return [folder for folder in folders if folder and Path(folder).is_dir()]
