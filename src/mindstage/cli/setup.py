"""Sources: from what was typed to a knowledge base."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mindstage.api import load_knowledge
from mindstage.cli.numbers import DEFAULT_CONVENTIONS, ConventionOptions
from mindstage.cli.outcome import close_at_end
from mindstage.errors import InvalidArgumentError, MapRejectedError

if TYPE_CHECKING:
    from mindstage.knowledge import Finding, KnowledgeBase, SparqlEndpoint
    from mindstage.world import World

__all__ = ["findings_about", "knowledge_base"]


def knowledge_base(
    maps: Sequence[str],
    *,
    ontologies: Sequence[str] | None,
    bundled: bool,
    store: Path | None = None,
    endpoint: str | SparqlEndpoint | None = None,
    conventions: ConventionOptions = DEFAULT_CONVENTIONS,
    robots: Sequence[str] | None = None,
    closure: bool = False,
) -> KnowledgeBase:
    """`mindstage.api.load_knowledge` for a verb's options, with the environment's ROS packages; closed when it ends.

    Raises:
        SourceParseError: one of them cannot be read.
        StoreError: the folder cannot be used.
        InvalidArgumentError: the endpoint's address is none, or both were given; or there are no such units, or no such map.
        ReasonerUnavailableError: the extra that derives is not installed.
    """
    if closure and store:
        cause = "what it derives would be written into what others use"
        raise InvalidArgumentError("--closure", cause=cause, remedy="load the files themselves, without --store")
    knowledge = load_knowledge(
        maps,
        ontologies=[*(ontologies or ()), *_ros_packages()],
        bundled_ontology=bundled,
        robots=robots or (),
        conventions=conventions.by_map(maps),
        store=store,
        endpoint=endpoint,
        closure=closure,
    )
    close_at_end(knowledge.close)
    return knowledge


def findings_about(world: World, knowledge: KnowledgeBase, *, strict: bool = False) -> tuple[Finding, ...]:
    """Everything odd, an empty world among it: more likely a map that was not understood than an empty place.

    Raises:
        MapRejectedError: there is something, and nothing was to be.
    """
    from mindstage.knowledge import Finding, Severity

    findings = knowledge.findings()
    if not world.bodies:
        what = "nothing in it could be read as a body; is it a map?"
        findings = (*findings, Finding(Severity.WARNING, world.iri, "", what, "the world is empty"))
    if strict and findings:
        raise MapRejectedError(world.iri, findings=[str(finding) for finding in findings])
    return findings


def _ros_packages() -> list[str]:
    # ROS itself says nothing about folders of that list which do not exist.
    folders = os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)
    return [folder for folder in folders if folder and Path(folder).is_dir()]
