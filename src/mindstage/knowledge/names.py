"""Names: the ids that individuals have in a world, and the names that their parts get where nobody gave one."""

from __future__ import annotations

import re
from collections.abc import Container, Iterable, Iterator, Mapping
from itertools import count

from mindstage.world import BodyId, Iri

__all__ = ["assign_ids", "is_part_name", "local_name", "namespace_of", "part_name"]

_LAST_SEPARATOR = re.compile(r".*#|.*/|.*:", re.DOTALL)


def namespace_of(iri: str) -> str:
    """All of an IRI before its local name."""
    match = _LAST_SEPARATOR.match(iri)
    return match[0] if match and match.end() < len(iri) else ""


def local_name(iri: str) -> str:
    """What comes after the last "#", or else "/", or else ":"; the whole IRI where nothing comes after it."""
    return iri[len(namespace_of(iri)) :]


def assign_ids(explicit: Mapping[Iri, str], iris: Iterable[Iri]) -> dict[Iri, BodyId]:
    """Ids that differ from one another.

    Args:
        explicit: ids that were told; all different.
        iris: the others, which are called by their local name, with a number behind it from the second on.
    """
    ids = {iri: BodyId(id) for iri, id in explicit.items()}
    taken = set(explicit.values())
    numbers: dict[str, Iterator[int]] = {}
    for iri in iris:
        id = name = local_name(iri)
        if name in taken:
            further = numbers.setdefault(name, count(2))
            id = next(candidate for number in further if (candidate := f"{name}-{number}") not in taken)
        taken.add(id)
        ids[iri] = BodyId(id)
    return ids


def part_name(owner: Iri, suffix: str, used_names: Container[str]) -> Iri:
    """The name of an individual's part, such as "cup-pose"."""
    name = f"{owner}-{suffix}"
    if name not in used_names:
        return Iri(name)
    return next(Iri(other) for number in count(2) if (other := f"{name}-{number}") not in used_names)


def is_part_name(name: str, owner: Iri, suffix: str) -> bool:
    """Whether `part_name` may have given this name."""
    start = f"{owner}-{suffix}"
    return name.startswith(start) and re.fullmatch(r"(-\d+)?", name[len(start) :]) is not None
