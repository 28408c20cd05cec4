"""Sizes: what classes say about the extents of their members, inherited by their subclasses."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from mindstage.knowledge.findings import Report, Severity
from mindstage.knowledge.graph import Graph
from mindstage.knowledge.taxonomy import ClassHierarchy
from mindstage.knowledge.vocabulary import EQUIVALENT_CLASS, HAS_VALUE, ON_PROPERTY, SUBCLASS_OF
from mindstage.knowledge.wording.words import SIZE
from mindstage.world import Anonymous, Fact, Iri, Reference, Resource

__all__ = ["Axes", "ClassSizes", "class_sizes_of"]

Axes = tuple[float | None, float | None, float | None]
"""What is known along x, y and z [m]."""


def _superclasses(classes: Iterable[tuple[Iri, Sequence[Fact]]]) -> Iterable[tuple[Iri, Iri]]:
    """Class and superclass, for each pair of named ones that facts tell of."""
    for cls, facts in classes:
        for fact in facts:
            if isinstance(fact.value, Reference):
                if fact.property in (SUBCLASS_OF, EQUIVALENT_CLASS):
                    yield cls, fact.value.iri
                if fact.property == EQUIVALENT_CLASS:
                    yield fact.value.iri, cls


def class_sizes_of(resources: Iterable[Resource]) -> ClassSizes:
    """What the resources of one world say, and nothing else; whoever reads that world's file can find it there."""
    classes = {resource.iri: resource.facts for resource in resources}

    def silent(severity: Severity, individual: str, property: str, what: str, did: str) -> None:
        """Reading reports the same of all that is known."""

    return ClassSizes([classes], ClassHierarchy(_superclasses(classes.items())), silent)


class ClassSizes:
    """Extents by class, from `hasValue` restrictions; what is nearest in the hierarchy counts."""

    def __init__(self, sources: Sequence[Graph], hierarchy: ClassHierarchy, report: Report) -> None:
        """Collects what classes say.

        Args:
            sources: facts by class, first those that come before others; restrictions that several classes of one
                source share stand among them under their label.
            hierarchy: who inherits from whom.
            report: where disagreements go.
        """
        self._hierarchy = hierarchy
        self._report = report
        self._told: dict[Iri, list[float | None]] = {}
        self._known: dict[tuple[Iri, ...], Axes] = {}
        for source in sources:
            for cls, facts in source.items():
                for fact in facts:
                    if fact.property in (SUBCLASS_OF, EQUIVALENT_CLASS):
                        self._learn(cls, fact, source)

    def of(self, classes: tuple[Iri, ...]) -> Axes:
        """The extents of a thing of these classes; each axis is found, or not, by itself."""
        known = self._known.get(classes)
        if known is None:
            levels = self._hierarchy.levels(classes) if self._told else ()
            telling = [told for level in levels if (told := [cls for cls in level if cls in self._told])]
            x, y, z = (self._find(axis, classes, telling) for axis in range(3))
            known = self._known[classes] = (x, y, z)
        return known

    def _learn(self, cls: Iri, fact: Fact, source: Graph) -> None:
        restriction = (
            fact.value.facts
            if isinstance(fact.value, Anonymous)
            else source.get(fact.value.iri, ())
            if isinstance(fact.value, Reference) and fact.value.iri.startswith("_:")
            else ()
        )
        if not restriction:
            return
        for axis, word in enumerate(SIZE):
            if Fact(ON_PROPERTY, Reference(word.property)) not in restriction:
                continue
            for value in (part.value for part in restriction if part.property == HAS_VALUE):
                number = word.understand(value)
                if number is None:
                    self._warn(cls, axis, f"its value is not {word.what}", "it gives no size")
                    continue
                told = self._told.setdefault(cls, [None, None, None])
                if told[axis] is None:
                    told[axis] = number
                elif told[axis] != number:
                    self._warn(cls, axis, f"it is told twice: {told[axis]!r} and {number!r}", "the first counts")

    def _find(self, axis: int, classes: tuple[Iri, ...], levels: Iterable[Sequence[Iri]]) -> float | None:
        for level in levels:
            sizes = {cls: size for cls in level if (size := self._told[cls][axis]) is not None}
            if sizes:
                cls, size = next(iter(sizes.items()))
                if any(other != size for other in sizes.values()):
                    self._warn(classes[0], axis, f"{' and '.join(sizes)} disagree", f"{cls} counts")
                return size
        return None

    def _warn(self, cls: Iri, axis: int, what: str, did: str) -> None:
        self._report(Severity.WARNING, cls, SIZE[axis].property, what, did)
