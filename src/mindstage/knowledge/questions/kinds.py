"""Questions about classes: what is above, below and beside them, and what they say of their members."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from mindstage.knowledge.questions.question import ClassName, PropertyName, Row, question
from mindstage.knowledge.questions.words import expression_text, implies_line, is_line, restriction_line
from mindstage.world import Iri

if TYPE_CHECKING:
    from mindstage.knowledge.base import KnowledgeBase

__all__ = ["ClassProperty", "Sibling", "Subclass", "class_properties", "siblings", "subclass_of"]


class Subclass(Row, frozen=True, kw_only=True):
    """One class below another."""

    cls: ClassName
    superclass: ClassName
    steps: int
    """1 where it is told directly."""


@question
def subclass_of(
    kb: KnowledgeBase, cls: ClassName | None = None, superclass: ClassName | None = None
) -> Iterator[Subclass]:
    """The superclasses of a class, the nearest first, or the subclasses of a superclass; no class is its own.

    Examples:
        subclass_of Refrigerator
        subclass_of superclass=Handle
    """
    classes = kb.index.classes
    if cls is None and superclass is not None:
        for below, steps in classes.below(superclass).items():
            if steps:
                yield Subclass(cls=below, superclass=superclass, steps=steps)
        return
    for each in sorted(classes) if cls is None else (cls,):
        for above, steps in classes.above(each).items():
            if steps:
                yield Subclass(cls=each, superclass=above, steps=steps)


@subclass_of.because
def _path(kb: KnowledgeBase, row: Subclass) -> Iterator[str]:
    yield from is_line(kb.index.classes.path(row.cls, row.superclass))


class Sibling(Row, frozen=True, kw_only=True):
    """Two classes directly below a third one."""

    cls: ClassName
    sibling: ClassName
    parent: ClassName


@question
def siblings(kb: KnowledgeBase, cls: ClassName | None = None, sibling: ClassName | None = None) -> Iterator[Sibling]:
    """Which classes share a direct superclass.

    Examples:
        siblings Refrigerator
    """
    classes = kb.index.classes
    start = cls or sibling
    for each in sorted(classes) if start is None else (start,):
        for parent in sorted(classes.parents(each)):
            for other in sorted(classes.children(parent)):
                if other != each:
                    one, two = (each, other) if start is None or cls else (other, each)
                    yield Sibling(cls=one, sibling=two, parent=parent)


@siblings.because
def _parent(kb: KnowledgeBase, row: Sibling) -> Iterator[str]:
    yield from is_line((row.cls, row.parent))
    yield from is_line((row.sibling, row.parent))


class ClassProperty(Row, frozen=True, kw_only=True):
    """What a class says of all its members."""

    cls: ClassName
    property: PropertyName
    kind: str
    """OWL's word: someValuesFrom, allValuesFrom, hasValue, a cardinality."""
    count: int | None
    value: str
    """A class, value or expression, in short names."""
    told_by: ClassName
    """The class that it is inherited from, or itself."""


@question
def class_properties(
    kb: KnowledgeBase, cls: ClassName | None = None, property: PropertyName | None = None
) -> Iterator[ClassProperty]:
    """The properties of a class, and which class above it says so; the nearest first.

    A property also finds those that imply it.

    Examples:
        class_properties Refrigerator
        class_properties Dishwasher typePrimaryFunction-containerFor
    """
    index = kb.index
    owners: dict[Iri, None] = dict.fromkeys([cls] if cls else ())
    if cls is None:
        owners = dict.fromkeys(sorted({below for owner in index.restricting() for below in index.classes.below(owner)}))
    for each in owners:
        for owned in index.restrictions(each):
            told = owned.restriction
            if property is None or property in kb.index.properties.implied(told.property):
                yield ClassProperty(
                    cls=each,
                    property=property or told.property,
                    kind=told.kind.value,
                    count=told.count,
                    value=expression_text(told.filler),
                    told_by=owned.cls,
                )


@class_properties.because
def _inherited(kb: KnowledgeBase, row: ClassProperty) -> Iterator[str]:
    yield from is_line(kb.index.classes.path(row.cls, row.told_by))
    for owned in kb.index.restrictions(row.told_by):
        told = owned.restriction
        if (
            owned.cls == row.told_by
            and (told.kind.value, told.count, expression_text(told.filler)) == (row.kind, row.count, row.value)
            and row.property in kb.index.properties.implied(told.property)
        ):
            yield restriction_line(owned.cls, told)
            yield from implies_line(kb.index.properties.path(told.property, row.property))
