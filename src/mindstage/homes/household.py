"""What the bundled ontology states about household classes: sizes, densities, shapes, and what is stored where.

The statements are read from the file, without a knowledge base: a home is generated in less than a second.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import pyoxigraph as ox

from mindstage.maps.io.files import bundled_ontology
from mindstage.scene import Iri, Vector

__all__ = ["KNOWROB", "MS", "Household", "household"]

KNOWROB = "http://knowrob.org/kb/knowrob.owl#"
MS = "http://mindstage.org/ontology#"
_RDFS = "http://www.w3.org/2000/01/rdf-schema#"
_RDF = "http://www.w3.org/1999/02/22-rdf-syntax-ns#"
_OWL = "http://www.w3.org/2002/07/owl#"
_HELD = (f"{KNOWROB}typePrimaryFunction-containerFor", f"{KNOWROB}typePrimaryFunction-StoragePlaceFor")
_FILL_SHARE = 0.3
"""Part of its box that a thing fills with material."""
_DEFAULT_DENSITY_KG_M3 = 500.0


class Household:
    """The classes of the bundled ontology; all lists are sorted, so that equal seeds give equal homes."""

    def __init__(self) -> None:
        """Reads the file."""
        self._objects: dict[str, dict[str, list[ox.NamedNode | ox.BlankNode | ox.Literal]]] = {}
        for quad in ox.parse(path=str(bundled_ontology()), format=ox.RdfFormat.TURTLE):
            of = self._objects.setdefault(_key(quad.subject), {})
            of.setdefault(_key(quad.predicate), []).append(quad.object)
        self._ancestors: dict[str, tuple[str, ...]] = {}
        sized = (cls for cls in self._objects if not cls.startswith("_:") and self._inherited(cls, f"{MS}typicalSize"))
        self.sized = tuple(sorted(sized))
        """Classes that have or inherit a typical size."""

    def ancestors(self, cls: str) -> tuple[str, ...]:
        """The class and its superclasses, nearest first."""
        if cls not in self._ancestors:
            found = {cls: None}
            for each in (queue := [cls]):
                parents = sorted(_key(value) for value in self._values(each, f"{_RDFS}subClassOf"))
                new = [parent for parent in parents if not parent.startswith("_:") and parent not in found]
                found |= dict.fromkeys(new)
                queue += new
            self._ancestors[cls] = tuple(found)
        return self._ancestors[cls]

    def is_a(self, cls: str, ancestor: str) -> bool:
        """Whether a class is another one or a subclass of it."""
        return ancestor in self.ancestors(cls)

    def size(self, cls: str) -> Vector:
        """The typical depth, width and height of a class [m]."""
        depth, width, height = map(float, self._inherited(cls, f"{MS}typicalSize").split())
        return depth, width, height

    def mass(self, cls: str, size: Vector) -> float:
        """The mass of a thing of a class and a size [kg]."""
        density = float(self._inherited(cls, f"{MS}density") or _DEFAULT_DENSITY_KG_M3)
        return max(round(density * size[0] * size[1] * size[2] * _FILL_SHARE, 3), 0.01)

    def rolls(self, cls: str) -> bool:
        """Whether a thing of this class rolls on a level surface."""
        return self._inherited(cls, f"{MS}shapedAs").removeprefix(MS) in {"BallForm"}

    @cache  # noqa: B019 - there is one household
    def stored_in(self, container: str) -> tuple[Iri, ...]:
        """The classes that are stored in containers of a class, which have a size."""
        kinds = {kind for cls in self.ancestors(container) for kind in self._held(cls)}
        return self.leaves(*sorted(kinds))

    def leaves(self, *kinds: str) -> tuple[Iri, ...]:
        """The classes below some kinds that have a size, no subclass, and do not roll."""
        inner = {ancestor for cls in self.sized for ancestor in self.ancestors(cls)[1:]}
        portable = (cls for cls in self.sized if cls not in inner and not self.rolls(cls))
        return tuple(Iri(cls) for cls in portable if any(self.is_a(cls, kind) for kind in kinds))

    def _held(self, cls: str) -> Iterator[str]:
        for restriction in self._values(cls, f"{_RDFS}subClassOf"):
            of = self._objects.get(_key(restriction), {})
            if any(_key(each) in _HELD for each in of.get(f"{_OWL}onProperty", ())):
                for value in of.get(f"{_OWL}someValuesFrom", ()):
                    yield from self._union(_key(value))

    def _union(self, cls: str) -> Iterator[str]:
        lists = self._values(cls, f"{_OWL}unionOf")
        if not lists:
            yield cls
        for node in map(_key, lists):
            while node != f"{_RDF}nil":
                yield _key(self._values(node, f"{_RDF}first")[0])
                node = _key(self._values(node, f"{_RDF}rest")[0])

    def _inherited(self, cls: str, property: str) -> str:
        values = (value for each in self.ancestors(cls) for value in self._values(each, property))
        return next((value.value for value in values), "")

    def _values(self, subject: str, property: str) -> list[ox.NamedNode | ox.BlankNode | ox.Literal]:
        return self._objects.get(subject, {}).get(property, [])


def _key(term: object) -> str:
    return term.value if isinstance(term, ox.NamedNode) else str(term)


@cache
def household() -> Household:
    """The household of the bundled ontology, which is read once."""
    return Household()
