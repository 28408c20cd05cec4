"""Sizes: what classes say about the extents of their members, inherited by their subclasses."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from mindstage.knowledge.findings import FindingSink, Severity
from mindstage.knowledge.graph import Graph
from mindstage.knowledge.taxonomy import ClassHierarchy
from mindstage.knowledge.vocabulary import EQUIVALENT_CLASS, HAS_VALUE, ON_PROPERTY, SUBCLASS_OF
from mindstage.knowledge.wording.words import SIZE
from mindstage.world import BlankNode, Iri, IriRef, NamedResource, PropertyAssertion

__all__ = ["ClassSizes", "PartialSize", "map_class_sizes"]

PartialSize = tuple[float | None, float | None, float | None]
"""What is known along x, y and z [m]."""


def _superclasses(classes: Iterable[tuple[Iri, Sequence[PropertyAssertion]]]) -> Iterable[tuple[Iri, Iri]]:
    """Class and superclass, for each pair of named ones that facts tell of."""
    for cls, facts in classes:
        for fact in facts:
            if isinstance(fact.value, IriRef):
                if fact.property in (SUBCLASS_OF, EQUIVALENT_CLASS):
                    yield cls, fact.value.iri
                if fact.property == EQUIVALENT_CLASS:
                    yield fact.value.iri, cls


def map_class_sizes(resources: Iterable[NamedResource]) -> ClassSizes:
    """What the resources of one world say, and nothing else; whoever reads that world's file can find it there."""
    classes = {resource.iri: resource.facts for resource in resources}

    def silent(severity: Severity, individual: str, property: str, problem: str, action: str) -> None:
        """Reading reports the same of all that is known."""

    return ClassSizes([classes], ClassHierarchy(_superclasses(classes.items())), silent)


class ClassSizes:
    """Extents by class, from `hasValue` restrictions; what is nearest in the hierarchy counts."""

    def __init__(self, sources: Sequence[Graph], hierarchy: ClassHierarchy, report: FindingSink) -> None:
        """Collects what classes say.

        Args:
            sources: facts by class, first those that come before others; restrictions that several classes of one
                source share stand among them under their label.
            hierarchy: who inherits from whom.
            report: where disagreements go.
        """
        self._hierarchy = hierarchy
        self._report = report
        self._sizes_by_class: dict[Iri, list[float | None]] = {}
        self._cache: dict[tuple[Iri, ...], PartialSize] = {}
        for source in sources:
            for cls, facts in source.items():
                for fact in facts:
                    if fact.property in (SUBCLASS_OF, EQUIVALENT_CLASS):
                        self._add_restriction(cls, fact, source)

    def get(self, classes: tuple[Iri, ...]) -> PartialSize:
        """The extents of a thing of these classes; each axis is found, or not, by itself."""
        known = self._cache.get(classes)
        if known is None:
            levels = self._hierarchy.levels(classes) if self._sizes_by_class else ()
            telling = [told for level in levels if (told := [cls for cls in level if cls in self._sizes_by_class])]
            x, y, z = (self._find_extent(axis, classes, telling) for axis in range(3))
            known = self._cache[classes] = (x, y, z)
        return known

    def _add_restriction(self, cls: Iri, fact: PropertyAssertion, source: Graph) -> None:
        restriction = (
            fact.value.facts
            if isinstance(fact.value, BlankNode)
            else source.get(fact.value.iri, ())
            if isinstance(fact.value, IriRef) and fact.value.iri.startswith("_:")
            else ()
        )
        if not restriction:
            return
        for axis, word in enumerate(SIZE):
            if PropertyAssertion(ON_PROPERTY, IriRef(word.property)) not in restriction:
                continue
            for value in (part.value for part in restriction if part.property == HAS_VALUE):
                number = word.decode(value)
                if number is None:
                    self._warn(cls, axis, f"its value is not {word.expected}", "it gives no size")
                    continue
                told = self._sizes_by_class.setdefault(cls, [None, None, None])
                if told[axis] is None:
                    told[axis] = number
                elif told[axis] != number:
                    self._warn(cls, axis, f"it is told twice: {told[axis]!r} and {number!r}", "the first counts")

    def _find_extent(self, axis: int, classes: tuple[Iri, ...], levels: Iterable[Sequence[Iri]]) -> float | None:
        for level in levels:
            sizes = {cls: size for cls in level if (size := self._sizes_by_class[cls][axis]) is not None}
            if sizes:
                cls, size = next(iter(sizes.items()))
                if any(other != size for other in sizes.values()):
                    self._warn(classes[0], axis, f"{' and '.join(sizes)} disagree", f"{cls} counts")
                return size
        return None

    def _warn(self, cls: Iri, axis: int, problem: str, action: str) -> None:
        self._report(Severity.WARNING, cls, SIZE[axis].property, problem, action)
