"""Reading: what a map was taken to mean, for people and for programs; a wrong guess is seen here first."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from mindstage.cli.output import print_line, print_table

if TYPE_CHECKING:
    from mindstage.knowledge import Assumption, KnowledgeBase
    from mindstage.world import World

__all__ = ["assumptions_json", "import_summary", "print_import_summary"]


def assumptions_json(knowledge: KnowledgeBase, about: World | None = None) -> list[dict[str, object]]:
    """The assumptions as they stand in JSON; about one map, or about all."""
    import msgspec

    return [msgspec.to_builtins(each) for each in knowledge.assumptions() if about is None or each.map == about.iri]


def import_summary(world: World, knowledge: KnowledgeBase) -> dict[str, object]:
    """What was assumed about a map, and how large the world is that came of it."""
    import msgspec

    from mindstage.world.extent import world_bounds

    extent = world_bounds(world)
    told = None if extent is None else {"size": extent.size} | msgspec.to_builtins(extent)
    return {"assumptions": assumptions_json(knowledge, world), "extent": told}


def print_import_summary(world: World, knowledge: KnowledgeBase, *, verbose: bool = False) -> None:
    """The same as a line, and a table where anything but the usual was assumed."""
    from mindstage.world.extent import world_bounds

    extent = world_bounds(world)
    if extent is not None:
        size = " x ".join(f"{length:.3g}" for length in extent.size)
        name = extent.tallest_class.replace("/", "#").rpartition("#")[2]
        print_line(f"Extent: {size} m; the tallest is {name} {extent.tallest!r}, {extent.height_m:.3g} m high.")
    assumptions = [each for each in knowledge.assumptions() if each.map == world.iri]
    _print_assumptions(each for each in assumptions if verbose or not _is_default(each))


def _is_default(assumption: Assumption) -> bool:
    """Whether it is how a world itself has it, without anybody having said so."""
    from mindstage.knowledge.reading.conventions import SI

    usual = getattr(SI, assumption.topic, None)
    return usual is not None and usual.value == assumption.value and not assumption.overridden


def _print_assumptions(assumptions: Iterable[Assumption]) -> None:
    rows = [
        (assumption.topic, assumption.value, "told" if assumption.overridden else "assumed", assumption.evidence)
        for assumption in assumptions
    ]
    if rows:
        print_table("How the map was taken", ("about", "value", "how", "evidence"), rows)
