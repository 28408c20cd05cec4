"""Names: ids and IRIs for what came over the wire without one."""

from __future__ import annotations

from collections.abc import Container
from itertools import count

from mindstage.world import BodyId, Iri

__all__ = ["free_id", "iri_namespace", "map_iri"]


def map_iri(name: str) -> Iri:
    """The IRI of a map that nobody gave one."""
    return Iri(f"http://mindstage.org/maps/{name}.owl#map")


def iri_namespace(map: str) -> str:
    """What the IRIs of a map's things begin with."""
    return map.rpartition("#")[0] + "#" if "#" in map else f"{map}#"


def free_id(stem: str, taken: Container[str]) -> BodyId:
    """An id that nobody has yet."""
    return next(BodyId(id) for number in count(1) if (id := f"{stem}_{number}") not in taken)
