"""Statements: the triples under the questions, as users of SWI-Prolog's semweb library and of KnowRob know them.

Requests: what Prolog asks of Python, and the ends that each of them can have.

Prolog gets `told(Answer)`; `not_found_error(Name, Sentence)` where nobody knows a name, which is a no; `refused(Kind,
Sentence)` where the world, the engine or a source_xml is the cause; or `interrupted`. Whatever is raised here, Prolog
lives on.

Asking: every declared question as a predicate, without a list of them anywhere.

Place: the running world, as Prolog spawns it, hangs things on one another and lights them up.
"""

from __future__ import annotations

import re
import traceback
from collections.abc import Callable, Collection, Container, Iterator, Mapping, Sequence
from enum import Enum
from typing import Any

import msgspec

from mindstage.engines import SpawnReport
from mindstage.errors import InvalidArgumentError, MindstageError, NameNotFoundError
from mindstage.knowledge import KnowledgeBase, RdfTerm
from mindstage.knowledge.assertion_file import Triple, TripleStoreView
from mindstage.knowledge.names import PREFIXES, EntityType
from mindstage.knowledge.owl import Expression, IntersectionOf, NamedClass, Restriction, RestrictionType, UnionOf
from mindstage.knowledge.owl import LiteralValue as Constant
from mindstage.knowledge.queries import AnswerRow, Answers, Question, get_question, list_questions
from mindstage.knowledge.rdf import local_name, namespace_of
from mindstage.knowledge.vocabulary import OWL, RDF, RDFS, TYPE, XSD
from mindstage.prolog.swipl import FREE, Atom, Compound, Unbound, Value
from mindstage.scene import Attachment, BodyId, Color, Iri, IriRef, Joint, Literal, World
from mindstage.scene.colors import parse_color
from mindstage.simulation import Simulation

__all__ = [
    "Handler",
    "QuestionPredicates",
    "RdfPredicates",
    "WorldPredicates",
    "answer",
    "error_kind",
    "literal_term",
    "term_of",
]


Handler = Callable[..., Value]


def answer(handlers: Mapping[str, Handler], request: Value) -> Compound:
    """Answers one request; never raises."""
    name, arguments = (request.name, request.arguments) if isinstance(request, Compound) else (str(request), ())
    if name not in handlers:
        return _error_term("prolog_unavailable", f"nobody answers {name}: the console was closed")
    try:
        return Compound("answer", (handlers[name](*arguments),))
    except NameNotFoundError as error:
        return Compound("unknown_name", (Atom(error.name), str(error)))
    except MindstageError as error:
        return _error_term(error_kind(error), str(error))
    except KeyboardInterrupt:
        return Compound("interrupted", ())
    except Exception as error:  # a defect of ours must not take Prolog down with it
        place = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{place.filename}, line {place.lineno}"
        return _error_term(
            "defect", f"{type(error).__name__}: {error} ({where}); please report this defect in Mindstage"
        )


def error_kind(error: MindstageError) -> str:
    """How Prolog calls an error: `body_unknown` for BodyUnknown, since a capital would begin a variable."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", error.code).lower()


def _error_term(error_name: str, message: str) -> Compound:
    return Compound("error_reply", (Atom(error_name), message))


class QuestionPredicates:
    """What a stage is asked."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self.handlers: dict[str, Handler] = {
            "predicates": self.predicates,
            "rows": self.rows,
            "reasons": self.reasons,
            "missing": self.missing,
            "prefixes": self.prefixes,
        }

    def predicates(self) -> Value:
        """Each question's name, the names of its columns in their order here, how many of them are arguments, text.

        There is a predicate with the arguments and, where the answers tell more than that, one with all columns.
        """
        return [
            Compound(
                "predicate",
                (Atom(each.name), [Atom(name) for name in _columns(each)], len(each.arguments), _first_line(each.text)),
            )
            for each in list_questions()
        ]

    def rows(self, name: Value, args: Sequence[Value]) -> Value:
        """The answers, each a list as long as what is given; what was asked about is left free in them."""
        answers, bound = self._ask(name, args)
        return [list(row) for row in dict.fromkeys(_row_values(row, answers, bound, len(args)) for row in answers)]

    def reasons(self, name: Value, args: Sequence[Value]) -> Value:
        """The same rows, each with the lines that explain it."""
        answers, bound = self._ask(name, args)
        why = self._simulation.knowledge.explain
        return [
            [list(_row_values(row, answers, bound, len(args))), [Atom(line) for line in why(answers.question, row)]]
            for row in answers
        ]

    def missing(self, name: Value, args: Sequence[Value]) -> Value:
        """What nobody has told, one sentence each; nothing where there is an answer."""
        answers, _ = self._ask(name, args)
        return [Atom(lack.reason) for lack in answers.missing]

    def prefixes(self) -> Value:
        """The prefixes of names; each map brings one for its own, where that is free."""
        found = dict(PREFIXES)
        for map in self._simulation.knowledge.maps():
            namespace = namespace_of(map)
            prefix = re.sub(r"\.\w+$", "", re.split(r"[/:]", namespace.rstrip("#/:"))[-1]).lower()
            if prefix and namespace not in found.values():
                found.setdefault(prefix, namespace)
        return [Compound("-", (Atom(prefix), Atom(namespace))) for prefix, namespace in found.items()]

    def _ask(self, name: Value, args: Sequence[Value]) -> tuple[Answers[Any], Container[str]]:
        """The answers, and the columns that were given as arguments."""
        question = get_question(str(name))
        arguments = {argument.name for argument in question.arguments}
        columns = _columns(question)
        if len(args) > len(columns):
            cause = f"it has no more than {len(columns)} arguments here: {', '.join(columns)}"
            raise InvalidArgumentError(question.name, cause=cause)
        pairs = zip(columns, args, strict=False)
        bound = {column: value for column, value in pairs if column in arguments and value is not FREE}
        return self._simulation.ask(question, **bound), bound


def _row_values(row: AnswerRow, answers: Answers[Any], bound: Container[str], width: int) -> tuple[Value, ...]:
    """A row as Prolog has it; what no row tells, such as a tolerance, is what it was by default."""
    defaults = {argument.name: argument.default for argument in answers.question.arguments}
    return tuple(
        FREE if column in bound else term_of(getattr(row, column, defaults.get(column)))
        for column in _columns(answers.question)[:width]
    )


_FUNCTORS = {
    "JointSummary": "joint",
    "PropertyAssertion": "fact",
    "BlankNode": "anonymous",
    "LinearLimits": "linearmotion",
    "AngularLimits": "angularmotion",
    "SoftLimit": "soft",
    "BodyPhysics": "physics",
    "PrimitiveShape": "shape",
}
"""The functors of records whose class has another name; all others have the class's name in lower case."""


def term_of(value: object) -> Value:  # noqa: PLR0911 (one a kind)
    """A field of an answer: texts as atoms, a struct as a term that is called like it, `none` for what is not told."""
    match value:
        case bool() | int() | float() | None | Compound() | Unbound():
            return value
        case Enum():  # before str, which enumerations of words are too
            return term_of(value.value)
        case str():
            return Atom(value)
        case IriRef(iri):
            return Atom(iri)
        case Literal():
            return literal_term(value.text, value.datatype, value.language)
        case tuple() | list():
            return tuple(term_of(each) for each in value)
        case msgspec.Struct():
            fields = (term_of(getattr(value, name)) for name in value.__struct_fields__)
            name = type(value).__name__
            return Compound(_FUNCTORS.get(name, name.lower()), tuple(fields))
        case _:
            return Atom(str(value))


def literal_term(text: str, datatype: str | None, language: str | None) -> Compound:
    """A literal as SWI-Prolog's semweb library writes it; texts without a type are strings, as RDF 1.1 says."""
    if language:
        return Compound("literal", (Compound("lang", (Atom(language), Atom(text))),))
    type = datatype or PREFIXES["xsd"] + "string"
    return Compound("literal", (Compound("type", (Atom(type), Atom(text))),))


def _columns(question: Question[Any]) -> list[str]:
    """All that a predicate can have, in its order: the map first, as the community has it, then the other arguments."""
    arguments = [argument.name for argument in question.arguments]
    arguments.sort(key=lambda name: name != "map")
    return [*arguments, *(column for column in question.columns if column not in arguments)]


def _first_line(text: str) -> str:
    return text.partition("\n")[0]


class WorldPredicates:
    """What a stage is told to do."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._failed: tuple[Value, ...] = ()
        self.handlers: dict[str, Handler] = {
            "contents": self.contents,
            "spawn": self.spawn,
            "spawn_models": self.spawn_models,
            "spawn_constraints": self.spawn_constraints,
            "spawn_relations": self.spawn_relations,
            "failed_items": self.failed_items,
            "attach": self.attach,
            "highlight": self.highlight,
            "unhighlight": self.unhighlight,
        }

    # -- spawning ------------------------------------------------------------------------------------------------------

    def contents(self, map: Value) -> Value:
        """What can be spawned of a map: its bodies, its constraints, and who hangs on whom as two lists."""
        world = self._world(map)
        iris = {body.id: Atom(body.iri) for body in world.bodies}
        constraints = [Atom(each.iri) for each in world.joints]
        parents = [iris[each.parent] for each in world.attachments]
        children = [iris[each.child] for each in world.attachments]
        return Compound("contents", (list(iris.values()), constraints, parents, children))

    def spawn(self, map: Value) -> Value:
        """Spawns all of a map; whether nothing failed."""
        return self._spawn(self._world(map))

    def spawn_models(self, map: Value, models: Sequence[Value]) -> Value:
        """Spawns some bodies of a map; whether nothing failed."""
        world = self._world(map)
        there = {body.iri: body for body in world.bodies}
        chosen = tuple(there[iri] for iri in self._select(models, there, "bodies", world))
        return self._spawn(msgspec.structs.replace(world, bodies=chosen, joints=(), attachments=()))

    def spawn_constraints(self, map: Value, constraints: Sequence[Value]) -> Value:
        """Joins bodies that stand there already; whether nothing failed."""
        world = self._world(map)
        there: dict[Iri, Joint] = {each.iri: each for each in world.joints}
        chosen = tuple(there[iri] for iri in self._select(constraints, there, "constraints", world))
        return self._spawn(World(iri=world.iri, name=world.name, joints=chosen))

    def spawn_relations(self, map: Value, parents: Sequence[Value], children: Sequence[Value]) -> Value:
        """Hangs each child on the parent that stands at its place of the other list; whether nothing failed."""
        if len(parents) != len(children):
            cause = f"{len(parents)} parents and {len(children)} children are no pairs"
            raise InvalidArgumentError("spawn_relations", cause=cause, remedy="give each child its parent")
        world = self._world(map)
        ids = {body.iri: body.id for body in world.bodies}
        above = [ids[iri] for iri in self._select(parents, ids, "bodies", world)]
        below = [ids[iri] for iri in self._select(children, ids, "bodies", world)]
        pairs = tuple(Attachment(parent=one, child=other) for one, other in zip(above, below, strict=True))
        return self._spawn(World(iri=world.iri, name=world.name, attachments=pairs))

    def failed_items(self) -> Value:
        """What could not be spawned the last time, as failed(Kind, Id, Reason)."""
        return self._failed

    def _world(self, map: Value) -> World:
        knowledge = self._simulation.knowledge
        return knowledge.world(knowledge.names.find(_name(map, "map"), EntityType.MAP))

    def _spawn(self, world: World) -> bool:
        report = self._simulation.spawn(world)
        self._failed = tuple(_failures(report))
        return report.ok

    def _select(self, names: Sequence[Value], candidates: Collection[Iri], type_name: str, world: World) -> list[Iri]:
        find = self._simulation.knowledge.names.find
        iris = [find(_name(name, "individual"), EntityType.INDIVIDUAL) for name in names]
        for iri in iris:
            if iri not in candidates:
                raise InvalidArgumentError(local_name(iri), cause=f"it is none of the {type_name} of {world.name}")
        return iris

    # -- what stands there ---------------------------------------------------------------------------------------------

    def attach(self, parent: Value, child: Value) -> Value:
        """Hangs a body on another one, where it is."""
        above, below = self._body(parent), self._body(child)
        self._simulation.run_on_engine(lambda engine: engine.attach(above, below), label="attach", edits=True)
        return True

    def highlight(self, individuals: Sequence[Value], color: Value, reason: Value) -> Value:
        """Lights bodies up, or puts them out; how many they were, and what has no body, each as dark(Name, Reason)."""
        names = [self._body_or_name(each) for each in individuals]
        shown = self._simulation.highlight(names, _color(color), label=str(reason), missing_ok=True)
        dark = [Compound("not_highlighted", (Atom(each.id), each.reason)) for each in shown.unhighlighted]
        return Compound("highlighted", (len(shown.highlighted), dark))

    def unhighlight(self) -> Value:
        """Puts all lights out."""
        self._simulation.clear_highlights()
        return True

    def _body_or_name(self, individual: Value) -> str:
        """The id of a body, where it is one, or else the whole name."""
        name = _name(individual, "individual")
        return (
            name
            if name in self._simulation.state.ids
            else self._simulation.knowledge.names.find(name, EntityType.INDIVIDUAL)
        )

    def _body(self, individual: Value) -> BodyId:
        """Its id in the running world, or else its local name, so that the engine can say that it is not there."""
        name = self._body_or_name(individual)
        bodies = (body for world in self._simulation.worlds for body in world.bodies)
        return next((body.id for body in bodies if body.iri == name), BodyId(local_name(name)))


def _failures(report: SpawnReport) -> Iterator[Value]:
    for kind, failures in (
        ("body", report.failed_bodies),
        ("constraint", report.failed_joints),
        ("attachment", report.failed_attachments),
    ):
        for failure in failures:
            yield Compound("failed", (Atom(kind), Atom(failure.id), failure.reason))


def _name(value: Value, description: str) -> str:
    if isinstance(value, str):
        return str(value)
    raise InvalidArgumentError(f"the {description}", cause=f"{value!r} is no name")


def _color(value: Value) -> Color | None:
    match value:
        case Compound("rgb", parts):
            return parse_color(",".join(map(str, parts)))
        case _:
            return parse_color(str(value))


_VOCABULARY_NAMESPACES = (OWL, RDFS, RDF)
"""The namespaces of what ontologies are made of, which no individual of the index is of."""


class RdfPredicates:
    """What a knowledge base is asked and told, triple by triple."""

    def __init__(self, knowledge: KnowledgeBase) -> None:
        self._knowledge = knowledge
        handlers: dict[str, Handler] = {
            "rdf": self.asserted,
            "rdf_has": self.inferred,
            "rdf_assert": self.assert_triple,
            "rdf_retractall": self.retract_triples,
            "rdfs_individual_of": self.individuals,
            "rdfs_subclass_of": self.subclasses,
            "owl_class_properties": self.class_properties,
            "owl_parse": self.load_source,
        }
        self.handlers = {name: self._locked(handler) for name, handler in handlers.items()}

    def _locked(self, handler: Handler) -> Handler:
        """Nothing changes while somebody looks."""

        def handle(*arguments: Value) -> Value:
            with self._knowledge.lock:
                return handler(*arguments)

        return handle

    # -- triples -------------------------------------------------------------------------------------------------------

    def asserted(self, subject: Value, property: Value, value: Value) -> Value:
        """Triples as they were told."""
        return self._rows(TripleStoreView(self._knowledge).find, subject, property, value)

    def inferred(self, subject: Value, property: Value, value: Value) -> Value:
        """Triples of a property, and of those that imply it or its inverse."""
        return self._rows(TripleStoreView(self._knowledge).find_entailed, subject, property, value)

    def assert_triple(self, subject: Value, property: Value, value: Value) -> Value:
        """Tells one."""
        about, link = _text(subject, "subject"), _text(property, "property")
        TripleStoreView(self._knowledge).add(about, link, _to_rdf_term(value))
        return True

    def retract_triples(self, subject: Value, property: Value, value: Value) -> Value:
        """Takes back all that fit, and says how many."""
        triples, wanted = TripleStoreView(self._knowledge), _value_pattern(value)
        about, link = _resource_name(subject, "subject"), _resource_name(property, "property")
        if value is FREE or wanted.exact_term:
            return triples.remove(about, link, wanted.exact_term)
        found = [each for each in triples.find(about, link) if wanted.matches(each.value)]
        return sum(triples.remove(each.subject, each.property, each.value) for each in found)

    def load_source(self, source: Value) -> Value:
        """Loads a file, a folder of packages or `package://…`, and all that it imports."""
        self._knowledge.load((), ontologies=_text(source, "source"))
        return True

    def _rows(
        self,
        search: Callable[[str | None, str | None, RdfTerm | None], Iterator[Triple]],
        subject: Value,
        property: Value,
        value: Value,
    ) -> list[Value]:
        about, link, wanted = (
            _resource_name(subject, "subject"),
            _resource_name(property, "property"),
            _value_pattern(value),
        )
        return [
            [
                Atom(each.subject) if about is None else FREE,
                Atom(each.property) if link is None else FREE,
                FREE if wanted.is_exact else _value_term(each.value),
            ]
            for each in search(about, link, wanted.exact_term)
            if wanted.matches(each.value)
        ]

    # -- what follows --------------------------------------------------------------------------------------------------

    def individuals(self, individual: Value, cls: Value) -> Value:
        """Individuals and their classes, told or above those; of maps and of none."""
        index = self._knowledge.reasoner
        one, kind = self._name(individual, EntityType.INDIVIDUAL), self._name(cls, EntityType.CLASS)
        if kind and kind.startswith(_VOCABULARY_NAMESPACES):
            return [
                [FREE if one else Atom(each.subject), FREE]
                for each in TripleStoreView(self._knowledge).find(one, TYPE, RdfTerm("iri", kind))
            ]
        if one and kind:
            return [[FREE, FREE]] if index.is_member(one, kind) else []
        if kind:
            return [[Atom(each), FREE] for each in index.members(kind)]
        return [
            [FREE if one else Atom(each), Atom(above)]
            for each in ([one] if one else sorted(index.types))
            for above in dict.fromkeys(up for told in index.types.get(each, ()) for up in index.classes.above(told))
        ]

    def subclasses(self, cls: Value, superclass: Value) -> Value:
        """Classes and what is above them, themselves first."""
        classes = self._knowledge.reasoner.classes
        lower, upper = self._name(cls, EntityType.CLASS), self._name(superclass, EntityType.CLASS)
        if lower and upper:
            return [[FREE, FREE]] if upper in classes.above(lower) else []
        if upper:
            return [[Atom(each), FREE] for each in classes.below(upper)]
        every = [lower] if lower else sorted(set(self._knowledge.reasoner.declared_classes()))
        return [[FREE if lower else Atom(each), Atom(above)] for each in every for above in classes.above(each)]

    def class_properties(self, cls: Value, property: Value) -> Value:
        """What every member of a class has by a property, inherited or not; the nearest first."""
        index = self._knowledge.reasoner
        one, link = self._name(cls, EntityType.CLASS), self._name(property, EntityType.PROPERTY)
        below = {lower for owner in index.restricted_classes() for lower in index.classes.below(owner)}
        rows: dict[tuple[Iri, Iri, Expression], None] = {}
        for each in [one] if one else sorted(below):
            for owned in index.restrictions(each):
                told = owned.restriction
                promised = told.restriction_type is RestrictionType.HAS_VALUE or told.implies_existence()
                if promised and told.filler and (not link or link in index.properties.super_properties(told.property)):
                    rows[each, told.property, told.filler] = None
        return [
            [FREE if one else Atom(owner), FREE if link else Atom(has), _expression_term(filler)]
            for owner, has, filler in rows
        ]

    def _name(self, value: Value, kind: EntityType) -> Iri | None:
        """A name written out; a whole one is taken as it is, since nobody has to know it to ask about it."""
        if value is FREE:
            return None
        name = _text(value, kind.value)
        return Iri(name) if ":" in name else self._knowledge.names.find(name, kind)


_VALUE_HINT = "give an atom, or literal(Text), literal(type(Type, Text)), literal(lang(Language, Text))"


def _resource_name(value: Value, role: str) -> str | None:
    return None if value is FREE else _text(value, role)


def _text(value: Value, role: str) -> str:
    if isinstance(value, str):
        return str(value)
    raise InvalidArgumentError(f"the {role}", cause=f"{value!r} is no name")


class _ValuePattern(msgspec.Struct, frozen=True):
    """What the value of a statement shall be; what stays open in it, Prolog compares."""

    exact_term: RdfTerm | None = None
    """The one resource or literal that is meant."""
    is_literal: bool = False
    text: str | None = None
    """The text of a literal, whatever its type."""

    @property
    def is_exact(self) -> bool:
        return bool(self.exact_term or self.text is not None)

    def matches(self, term: RdfTerm) -> bool:
        if self.exact_term or not self.is_literal:
            return True
        return term.kind == "literal" and self.text in {None, term.value}


def _value_pattern(value: Value) -> _ValuePattern:
    """What is asked for.

    Raises:
        InvalidArgumentError: it is neither a resource nor a literal.
    """
    match value:
        case Unbound():
            return _ValuePattern()
        case Atom():
            return _ValuePattern(RdfTerm("blank", value[2:]) if value.startswith("_:") else RdfTerm("iri", str(value)))
        case Compound("literal", (Compound("type", (Atom() as type, (str() | int() | float()) as text)),)):
            return _ValuePattern(RdfTerm("literal", str(text), str(type)))
        case Compound("literal", (Compound("lang", (Atom() as language, str() as text)),)):
            return _ValuePattern(RdfTerm("literal", str(text), RDF + "langString", str(language)))
        case Compound("literal", ((str() | int() | float()) as text,)):
            return _ValuePattern(is_literal=True, text=str(text))
        case Compound("literal", (_,)):
            return _ValuePattern(is_literal=True)
        case _:
            raise InvalidArgumentError(
                "the value", cause=f"{value!r} is no resource and no literal", remedy=_VALUE_HINT
            )


def _to_rdf_term(value: Value) -> RdfTerm:
    """What is to be told; a literal without a type has that of what stands in it.

    Raises:
        InvalidArgumentError: it is neither a resource nor a literal, or not a whole one.
    """
    match value:
        case Compound("literal", (int() as number,)):
            return RdfTerm("literal", str(number), XSD + "integer")
        case Compound("literal", (float() as number,)):
            return RdfTerm("literal", repr(number), XSD + "double")
    wanted = _value_pattern(value)
    if wanted.exact_term:
        return wanted.exact_term
    if wanted.text is None:
        raise InvalidArgumentError("the value", cause="it is not told as a whole", remedy=_VALUE_HINT)
    return RdfTerm("literal", wanted.text, XSD + "string")


def _value_term(term: RdfTerm) -> Value:
    match term.kind:
        case "literal":
            return literal_term(term.value, term.datatype, term.language)
        case "blank":
            return Atom(f"_:{term.value}")
        case _:
            return Atom(term.value)


def _expression_term(expression: Expression) -> Value:
    match expression:
        case NamedClass(iri):
            return Atom(iri)
        case Constant(literal):
            return literal_term(literal.text, literal.datatype, literal.language)
        case UnionOf(members):
            return Compound("union_of", ([_expression_term(each) for each in members],))
        case IntersectionOf(members):
            return Compound("intersection_of", ([_expression_term(each) for each in members],))
        case Restriction(property, kind, filler):
            inner = (Atom(property), Atom(kind.value), None if filler is None else _expression_term(filler))
            return Compound("restriction", inner)
        case _:
            return None
