"""Questions about classes: superclasses, subclasses, siblings, and the restrictions on their members."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from mindstage.knowledge.claims import Claim, ClaimKind
from mindstage.knowledge.explain import expression_text, restriction_line, subclass_line, subproperty_line
from mindstage.knowledge.owl import Expression, NamedClass, named_classes
from mindstage.knowledge.questions import (
    AnswerRow,
    AskedArguments,
    ClassName,
    MissingKnowledge,
    PropertyName,
    QuestionContext,
    ValueName,
    question,
)
from mindstage.knowledge.reasoner import Reasoner
from mindstage.rdf.graphs import local_name
from mindstage.rdf.vocabulary import SUBCLASS_OF, THING
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
def _missing_subclass(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    if asked.cls and asked.superclass:
        above = ", ".join(local_name(each) for each in kb.reasoner.classes.parents(asked.cls)) or "nothing else"
        reason = f"{local_name(asked.cls)} is no {local_name(asked.superclass)}: it is {above}"
        if asked.cls == asked.superclass:
            reason = f"{local_name(asked.cls)} is the class itself, and only other superclasses are answers"
        claim = Claim(kind=ClaimKind.NOT_SUBCLASS, subject=asked.cls, object=asked.superclass)
        yield MissingKnowledge(asked.cls, SUBCLASS_OF, reason, claims=(claim,))
    elif known := asked.cls or asked.superclass:
        relative = "superclass" if asked.cls else "subclass"
        why = f"{local_name(known)} has no {relative}: no subClassOf statement or definition names one"
        claim = Claim(kind=ClaimKind.NOT_SUBCLASS, subject=asked.cls, object=asked.superclass)
        yield MissingKnowledge(known, SUBCLASS_OF, why, is_filler=not asked.cls, claims=(claim,))


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
    start = cls or sibling
    for each in sorted(kb.reasoner.classes) if start is None else (start,):
        for parent, other in _siblings_of(kb.reasoner, each):
            one, two = (each, other) if start is None or cls else (other, each)
            yield SiblingClasses(cls=one, sibling=two, parent=parent)


def _siblings_of(reasoner: Reasoner, cls: Iri) -> Iterator[tuple[Iri, Iri]]:
    """Common parents and siblings of a class. What is below an equivalent class is below the class itself."""
    same = {*reasoner.equivalents(cls)}
    for parent in sorted({above for each in same for above in reasoner.classes.parents(each)} - same):
        below = {other for child in reasoner.classes.children(parent) for other in reasoner.equivalents(child)}
        yield from ((parent, other) for other in sorted(below - same - {*reasoner.equivalents(parent)}))


@siblings.explain
def _explain_sibling(kb: QuestionContext, row: SiblingClasses) -> Iterator[str]:
    yield from subclass_line(kb.reasoner.classes.path(row.cls, row.parent))
    yield from subclass_line(kb.reasoner.classes.path(row.sibling, row.parent))


@siblings.missing
def _missing_siblings(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    if not (known := asked.cls or asked.sibling):
        return
    same = {*kb.reasoner.equivalents(known)}
    above = {parent for each in same for parent in kb.reasoner.classes.parents(each)} - same
    parents = ", ".join(local_name(each) for each in sorted(above))
    if asked.cls and asked.sibling == asked.cls:
        why = f"{local_name(asked.cls)} is no sibling of itself"
    elif not parents:
        why = f"{local_name(known)} has no sibling: it has no direct superclass"
    elif asked.cls and asked.sibling:
        why = (
            f"{local_name(asked.sibling)} is no sibling of {local_name(asked.cls)}: it is not directly below {parents}"
        )
    else:
        why = f"{local_name(known)} has no sibling: no other class is directly below {parents}"
    claim = Claim(kind=ClaimKind.NOT_SIBLING, subject=known, object=asked.sibling if asked.cls else None)
    yield MissingKnowledge(known, SUBCLASS_OF, why, claims=(claim,))


class ClassRestrictionRow(AnswerRow, frozen=True, kw_only=True):
    """A restriction that holds for all members of a class."""

    cls: ClassName
    property: PropertyName
    kind: str
    """The OWL term: someValuesFrom, allValuesFrom, hasValue, or a cardinality."""
    count: int | None
    value: ValueName
    """A class or an individual; a literal or an expression as text with local names."""
    source: ClassName
    """The superclass that the restriction is inherited from, or the class itself."""
    inverse: bool
    """Whether it is on the inverse of the property: a member is the value, and `value` describes its subjects."""


@question(
    sentences=(
        "what are the properties of {cls}",
        "which properties does the class {cls} have",
        "what are the restrictions on {cls}",
        "what is the {property} of the class {cls} {inverse=false}",
        "which classes have {value} as {property} {inverse=false}",
        "what does every {cls} have {inverse=false}",
        "(what|which things) (has|have) every {cls} as {property} {inverse=true}",
        "of what is every {cls} the {property} {inverse=true}",
        "what are the inverse restrictions on {cls} {inverse=true}",
    )
)
def class_properties(
    kb: QuestionContext,
    cls: ClassName | None = None,
    property: PropertyName | None = None,
    value: ValueName | None = None,
    inverse: bool | None = None,
) -> Iterator[ClassRestrictionRow]:
    """The restrictions on the members of a class, with the class that each is inherited from; the nearest first.

    A property also finds its subproperties. A restriction on the inverse of a property is about what has a member as
    its value: by one on the inverse of `hasPart`, each member is a part of something.

    Examples:
        class_properties Refrigerator
        class_properties Dishwasher typePrimaryFunction-containerFor
        class_properties property=typePrimaryFunction-containerFor value=Perishable
    """
    yield from _restriction_rows(kb, cls, property, value, inverse)


def _restriction_rows(
    kb: QuestionContext, cls: Iri | None, property: Iri | None, value: str | None, inverse: bool | None
) -> Iterator[ClassRestrictionRow]:
    same = frozenset() if value is None else frozenset(kb.reasoner.equivalents(Iri(value)))
    for each in _classes_with_value(kb, same) if cls is None else (cls,):
        for owned in kb.reasoner.restrictions(each):
            restriction = owned.restriction
            filler = _filler_text(restriction.filler)
            if inverse is not None and inverse is not restriction.inverse:
                continue
            if property is None or property in kb.reasoner.properties.super_properties(restriction.property):
                yield ClassRestrictionRow(
                    cls=each,
                    property=property or restriction.property,
                    kind=restriction.restriction_type.value,
                    count=restriction.cardinality,
                    value=value if value and filler in same else filler,
                    source=owned.cls,
                    inverse=restriction.inverse,
                )


def _classes_with_value(kb: QuestionContext, values: Collection[str]) -> Iterator[Iri]:
    """The classes that have or inherit a restriction with one of these fillers, or with any if there are none."""
    axioms, classes = kb.reasoner.axioms, kb.reasoner.classes
    owners = (
        owner
        for owner in axioms.restricted_classes()
        if not values or any(_filler_text(own.filler) in values for own in axioms.own_restrictions(owner))
    )
    yield from sorted({below for owner in owners for below in classes.below(owner)})


def _filler_text(filler: Expression | None) -> str:
    return filler.iri if isinstance(filler, NamedClass) else expression_text(filler)


@class_properties.explain
def _explain_property(kb: QuestionContext, row: ClassRestrictionRow) -> Iterator[str]:
    yield from subclass_line(kb.reasoner.classes.path(row.cls, row.source))
    same = frozenset(kb.reasoner.equivalents(Iri(row.value)))
    for restriction in kb.reasoner.axioms.own_restrictions(row.source):
        described = restriction.restriction_type.value, restriction.cardinality, restriction.inverse
        if described == (row.kind, row.count, row.inverse) and _filler_text(restriction.filler) in same:
            path = kb.reasoner.properties.implication_path(restriction.property, row.property)
            if path:
                yield restriction_line(row.source, restriction)
                yield from subproperty_line(path)


@class_properties.missing
def _missing_property(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    value, inverse = asked.plain("value", str), asked.plain("inverse", bool)
    owner = f"neither {local_name(asked.cls)} nor an ancestor of it" if asked.cls else "no class"
    what = "a restriction on its members"
    if asked.property or value:
        what = f"{local_name(asked.property) if asked.property else '…'} {local_name(value) if value else '…'}"
    described = f"inverse of {what}" if inverse else what
    within = _expression_with(kb, asked.cls, asked.property, value, inverse) if value else None
    hint = f"; {within} names it in an expression" if within else ""
    if inverse is not None:
        others = _restriction_rows(kb, asked.cls, asked.property, value, not inverse)
        if (other := next(iter(others), None)) is not None:
            of = "inverse of " if other.inverse else ""
            hint += f"; {local_name(other.source)} has a restriction on {of}{local_name(other.property)}"
    detail = None if inverse is None else "inverse" if inverse else "forward"
    claim = Claim(
        kind=ClaimKind.NO_STATED_RESTRICTION, subject=asked.cls, property=asked.property, object=value, detail=detail
    )
    yield MissingKnowledge(
        asked.cls or THING, asked.property or SUBCLASS_OF, f"{owner} has {described}{hint}", claims=(claim,)
    )


def _expression_with(
    kb: QuestionContext, cls: Iri | None, property: Iri | None, value: str, inverse: bool | None
) -> str | None:
    """A restriction whose filler is an expression that names a class; None if there is none."""
    axioms, properties = kb.reasoner.axioms, kb.reasoner.properties
    for owner in axioms.restricted_classes() if cls is None else kb.reasoner.classes.above(cls):
        for own in axioms.own_restrictions(owner):
            is_on_property = property is None or property in properties.super_properties(own.property)
            is_on_property &= inverse in (None, own.inverse)
            if is_on_property and Iri(value) in {*named_classes(own.filler)}:
                return restriction_line(owner, own)
    return None
