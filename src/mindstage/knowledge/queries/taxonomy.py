"""Questions about classes: superclasses, subclasses, siblings, and the restrictions on their members."""

from __future__ import annotations

from collections.abc import Iterator

from mindstage.knowledge.explain import expression_text, restriction_line, subclass_line, subproperty_line
from mindstage.knowledge.owl import Expression, NamedClass
from mindstage.knowledge.questions import (
    AnswerRow,
    ClassName,
    MissingKnowledge,
    PropertyName,
    QuestionContext,
    ValueName,
    question,
)
from mindstage.knowledge.rdf import local_name
from mindstage.knowledge.vocabulary import SUBCLASS_OF, THING
from mindstage.scene import Iri

__all__ = ["ClassRestrictionRow", "SiblingClasses", "SubclassRelation", "class_properties", "siblings", "subclass_of"]


class SubclassRelation(AnswerRow, frozen=True, kw_only=True):
    """A class and one of its superclasses."""

    cls: ClassName
    superclass: ClassName
    steps: int
    """1 for a direct superclass."""


@question(
    sentences=(
        "what are the (superclasses|superclass) of {cls}",
        "what kinds of {superclass} are there",
        "which kinds of {superclass} are there",
        "which kinds of {superclass} exist",
        "what are the subclasses of {superclass}",
        "is (every|each) {cls} a {superclass}",
        "is {cls} a subclass of {superclass}",
        "which classes are above {cls}",
        "which classes are below {superclass}",
    )
)
def subclass_of(
    kb: QuestionContext, cls: ClassName | None = None, superclass: ClassName | None = None
) -> Iterator[SubclassRelation]:
    """The superclasses of a class, the nearest first; or all subclasses of a superclass; never the class itself.

    Examples:
        subclass_of Refrigerator
        subclass_of superclass=Handle
    """
    classes = kb.reasoner.classes
    if cls is None and superclass is not None:
        for below, steps in classes.below(superclass).items():
            if steps:
                yield SubclassRelation(cls=below, superclass=superclass, steps=steps)
        return
    for each in sorted(classes) if cls is None else (cls,):
        for above, steps in classes.above(each).items():
            if steps:
                yield SubclassRelation(cls=each, superclass=above, steps=steps)


@subclass_of.explain
def _explain_subclass(kb: QuestionContext, row: SubclassRelation) -> Iterator[str]:
    yield from subclass_line(kb.reasoner.classes.path(row.cls, row.superclass))


@subclass_of.missing
def _missing_subclass(
    kb: QuestionContext, cls: Iri | None = None, superclass: Iri | None = None
) -> Iterator[MissingKnowledge]:
    if cls and superclass:
        above = ", ".join(local_name(each) for each in kb.reasoner.classes.parents(cls)) or "nothing else"
        yield MissingKnowledge(cls, SUBCLASS_OF, f"{local_name(cls)} is no {local_name(superclass)}: it is {above}")
    elif known := cls or superclass:
        relative = "superclass" if cls else "subclass"
        why = f"{local_name(known)} has no {relative}: there is no subClassOf statement"
        yield MissingKnowledge(known, SUBCLASS_OF, why, is_filler=not cls)


class SiblingClasses(AnswerRow, frozen=True, kw_only=True):
    """Two classes with the same direct superclass."""

    cls: ClassName
    sibling: ClassName
    parent: ClassName


@question(
    sentences=(
        "what classes are like {cls}",
        "what are the siblings of {cls}",
        "which classes are siblings of {cls}",
        "what else is of the kind of {cls}",
    )
)
def siblings(
    kb: QuestionContext, cls: ClassName | None = None, sibling: ClassName | None = None
) -> Iterator[SiblingClasses]:
    """The classes that share a direct superclass with a class.

    Examples:
        siblings Refrigerator
    """
    classes = kb.reasoner.classes
    start = cls or sibling
    for each in sorted(classes) if start is None else (start,):
        for parent in sorted(classes.parents(each)):
            for other in sorted(classes.children(parent)):
                if other != each:
                    one, two = (each, other) if start is None or cls else (other, each)
                    yield SiblingClasses(cls=one, sibling=two, parent=parent)


@siblings.explain
def _explain_sibling(kb: QuestionContext, row: SiblingClasses) -> Iterator[str]:
    yield from subclass_line((row.cls, row.parent))
    yield from subclass_line((row.sibling, row.parent))


@siblings.missing
def _missing_siblings(
    kb: QuestionContext, cls: Iri | None = None, sibling: Iri | None = None
) -> Iterator[MissingKnowledge]:
    if known := cls or sibling:
        parents = ", ".join(local_name(each) for each in sorted(kb.reasoner.classes.parents(known)))
        why = f"that class is not directly below {parents}" if parents else "it has no subClassOf statement"
        yield MissingKnowledge(known, SUBCLASS_OF, f"{local_name(known)} has no such sibling: {why}")


class ClassRestrictionRow(AnswerRow, frozen=True, kw_only=True):
    """A restriction that holds for all members of a class."""

    cls: ClassName
    property: PropertyName
    kind: str
    """The OWL term: someValuesFrom, allValuesFrom, hasValue, or a cardinality."""
    count: int | None
    value: ValueName
    """A class or an individual; a literal or an expression as text with local names."""
    told_by: ClassName
    """The superclass that the restriction is inherited from, or the class itself."""


@question(
    sentences=(
        "what are the properties of {cls}",
        "which properties does the class {cls} have",
        "what are the restrictions on {cls}",
        "what is the {property} of the class {cls}",
        "which classes have {value} as {property}",
        "what does every {cls} have",
    )
)
def class_properties(
    kb: QuestionContext,
    cls: ClassName | None = None,
    property: PropertyName | None = None,
    value: ValueName | None = None,
) -> Iterator[ClassRestrictionRow]:
    """The restrictions on the members of a class, with the class that each is inherited from; the nearest first.

    A property also finds its subproperties.

    Examples:
        class_properties Refrigerator
        class_properties Dishwasher typePrimaryFunction-containerFor
        class_properties property=typePrimaryFunction-containerFor value=Perishable
    """
    for each in _classes_with_value(kb, value) if cls is None else (cls,):
        for owned in kb.reasoner.restrictions(each):
            restriction = owned.restriction
            if property is None or property in kb.reasoner.properties.super_properties(restriction.property):
                yield ClassRestrictionRow(
                    cls=each,
                    property=property or restriction.property,
                    kind=restriction.restriction_type.value,
                    count=restriction.cardinality,
                    value=_filler_text(restriction.filler),
                    told_by=owned.cls,
                )


def _classes_with_value(kb: QuestionContext, value: str | None) -> Iterator[Iri]:
    """The classes that have or inherit a restriction with this filler."""
    axioms, classes = kb.reasoner.axioms, kb.reasoner.classes
    owners = (
        owner
        for owner in axioms.restricted_classes()
        if value is None or any(_filler_text(own.filler) == value for own in axioms.own_restrictions(owner))
    )
    yield from sorted({below for owner in owners for below in classes.below(owner)})


def _filler_text(filler: Expression | None) -> str:
    return filler.iri if isinstance(filler, NamedClass) else expression_text(filler)


@class_properties.explain
def _explain_property(kb: QuestionContext, row: ClassRestrictionRow) -> Iterator[str]:
    yield from subclass_line(kb.reasoner.classes.path(row.cls, row.told_by))
    for restriction in kb.reasoner.axioms.own_restrictions(row.told_by):
        described = restriction.restriction_type.value, restriction.cardinality, _filler_text(restriction.filler)
        if described == (row.kind, row.count, row.value):
            path = kb.reasoner.properties.implication_path(restriction.property, row.property)
            if path:
                yield restriction_line(row.told_by, restriction)
                yield from subproperty_line(path)


@class_properties.missing
def _missing_property(
    kb: QuestionContext, cls: Iri | None = None, property: Iri | None = None, value: str | None = None
) -> Iterator[MissingKnowledge]:
    owner = f"neither {local_name(cls)} nor an ancestor of it" if cls else "no class"
    what = "a restriction on its members"
    if property or value:
        what = f"{local_name(property) if property else '…'} {local_name(value) if value else '…'}"
    yield MissingKnowledge(cls or THING, property or SUBCLASS_OF, f"{owner} has {what}")
