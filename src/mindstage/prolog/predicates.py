"""The Python side of the Prolog predicates: declared questions, RDF triples, spawning and highlights.

Each request is a term whose functor names a handler. The reply is `answer(Answer)`; `unknown_name(Name, Message)`,
which makes the goal fail; `error_reply(Kind, Message)`, which is thrown as an exception in Prolog; or `interrupted`.
No Python exception reaches Prolog.
"""

from __future__ import annotations

import os
import re
import tempfile
import traceback
from collections.abc import Callable, Collection, Container, Iterable, Iterator, Mapping, Sequence
from enum import Enum
from pathlib import Path
from typing import Any

import msgspec

from mindstage.engines import SpawnReport
from mindstage.errors import (
    InvalidArgumentError,
    MindstageError,
    NameNotFoundError,
    NumberRefusedError,
    without_surrogates,
)
from mindstage.files import atomic_write
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.assertion_file import RUNTIME_GRAPH_IRI, Triple, TripleStoreView
from mindstage.knowledge.change_feed import ChangeFeed, StoreCopy
from mindstage.knowledge.names import PREFIXES, EntityType
from mindstage.knowledge.owl import (
    ComplementOf,
    Expression,
    IntersectionOf,
    NamedClass,
    OneOf,
    Restriction,
    RestrictionType,
    UnionOf,
)
from mindstage.knowledge.owl import LiteralValue as Constant
from mindstage.knowledge.queries import AnswerRow, Answers, Question, get_question, list_questions
from mindstage.knowledge.sentences import is_sentence
from mindstage.prolog.swipl import FREE, Atom, Compound, Unbound, Value
from mindstage.rdf import RdfTerm
from mindstage.rdf.graphs import local_name, namespace_of
from mindstage.rdf.vocabulary import OWL, RDF, RDFS, TYPE, XSD
from mindstage.scene import Attachment, BodyId, Color, Iri, IriRef, Joint, Literal, World
from mindstage.scene.colors import parse_color
from mindstage.scene.edits import Attach
from mindstage.simulation import Simulation

__all__ = [
    "Handler",
    "QuestionPredicates",
    "RdfPredicates",
    "WorldPredicates",
    "answer",
    "literal_term",
    "term_of",
    "text_of",
]


Handler = Callable[..., Value]


def answer(handlers: Mapping[str, Handler], request: Value) -> Compound:
    """Handles one request; never raises.

    Args:
        handlers: handlers by the name of the request.
        request: the request, an atom or a compound.
    """
    name, arguments = (request.name, request.arguments) if isinstance(request, Compound) else (str(request), ())
    if name not in handlers:
        return _error_term("PrologUnavailableError", f"{name} cannot be answered: the console was closed")
    try:
        return Compound("answer", (handlers[name](*arguments),))
    except NameNotFoundError as error:
        return Compound("unknown_name", (Atom(error.name), str(error)))
    except (MindstageError, OverflowError) as error:
        if isinstance(error, OverflowError):  # Prolog has integers of any size
            error = NumberRefusedError(name, cause="a number is too large", remedy="give a finite number")
        return _error_term(error.code, str(error))
    except KeyboardInterrupt:
        return Compound("interrupted", ())
    except Exception as error:  # must not propagate through Prolog's stack frames
        raised = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{raised.filename}, line {raised.lineno}"
        return _error_term(
            "defect", f"{type(error).__name__}: {error} ({where}); please report this defect in Mindstage"
        )


def _error_term(error_name: str, message: str) -> Compound:
    return Compound("error_reply", (Atom(error_name), message))


class QuestionPredicates:
    """Handlers of the declared questions."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self.handlers: dict[str, Handler] = {
            "predicates": self.predicates,
            "rows": self.rows,
            "reasons": self.reasons,
            "missing": self.missing,
            "sentence": self.sentence,
            "prefixes": self.prefixes,
        }

    def predicates(self) -> Value:
        """Every question as predicate(Name, Columns, NumberOfArguments, Text).

        Prolog defines a predicate with the arguments and, if there are more columns, one with all columns.
        """
        return [
            Compound(
                "predicate",
                (
                    Atom(each.name),
                    [Atom(name) for name in _columns(each)],
                    len(each.arguments),
                    each.text.partition("\n")[0],
                ),
            )
            for each in list_questions()
        ]

    def rows(self, name: Value, args: Sequence[Value]) -> Value:
        """The answers, each a list as long as `args`; columns with bound arguments are left unbound in them."""
        answers, bound = self._ask(name, args)
        return [list(row) for row in dict.fromkeys(_row_values(row, answers, bound, len(args)) for row in answers)]

    def reasons(self, name: Value, args: Sequence[Value]) -> Value:
        """The rows, each with the lines of its explanation."""
        answers, bound = self._ask(name, args)
        explain = self._simulation.knowledge.explain
        return [
            [list(_row_values(row, answers, bound, len(args))), [Atom(line) for line in explain(answers.question, row)]]
            for row in answers
        ]

    def missing(self, name: Value, args: Sequence[Value]) -> Value:
        """The missing facts, one sentence each; empty if there is an answer."""
        answers, _ = self._ask(name, args)
        return [Atom(fact.reason) for fact in answers.missing]

    def sentence(self, text: Value) -> Value:
        """The answers to a plain sentence as understood(Question, Arguments, Rows), with all columns."""
        asked = str(text)
        answers = self._simulation.ask(asked if is_sentence(asked) else f"{asked}?")
        columns = _columns(answers.question)
        given = [term_of(answers.args[column]) if column in answers.args else FREE for column in columns]
        rows = dict.fromkeys(_row_values(row, answers, (), len(columns)) for row in answers)
        return Compound("understood", (Atom(answers.question.name), given, [list(row) for row in rows]))

    def prefixes(self) -> Value:
        """The prefixes of IRIs; each map adds one for its namespace if the prefix is free."""
        prefixes = dict(PREFIXES)
        for map in self._simulation.knowledge.maps():
            namespace = namespace_of(map)
            prefix = re.sub(r"\.\w+$", "", re.split(r"[/:]", namespace.rstrip("#/:"))[-1]).lower()
            if prefix and namespace not in prefixes.values():
                prefixes.setdefault(prefix, namespace)
        return [Compound("-", (Atom(prefix), Atom(namespace))) for prefix, namespace in prefixes.items()]

    def _ask(self, name: Value, args: Sequence[Value]) -> tuple[Answers[Any], Container[str]]:
        """The answers, and the columns that are bound by arguments."""
        question = get_question(str(name))
        arguments = {argument.name for argument in question.arguments}
        columns = _columns(question)
        if len(args) > len(columns):
            cause = f"it has no more than {len(columns)} arguments: {', '.join(columns)}"
            raise InvalidArgumentError(question.name, cause=cause)
        pairs = zip(columns, args, strict=False)
        bound = {column: value for column, value in pairs if column in arguments and value is not FREE}
        return self._simulation.ask(question, **bound), bound


def _row_values(row: AnswerRow, answers: Answers[Any], bound: Container[str], width: int) -> tuple[Value, ...]:
    """A row as terms; arguments that are no columns, such as tolerances, have their default values."""
    defaults = {argument.name: argument.default for argument in answers.question.arguments}
    return tuple(
        FREE if column in bound else term_of(getattr(row, column, defaults.get(column)))
        for column in _columns(answers.question)[:width]
    )


_FUNCTORS = {
    "JointSummary": "joint",
    "AnswerField": "=",
    "PropertyAssertion": "fact",
    "BlankNode": "anonymous",
    "LinearLimits": "linearmotion",
    "AngularLimits": "angularmotion",
    "SoftLimit": "soft",
    "BodyPhysics": "physics",
    "PrimitiveShape": "shape",
}
"""Functors of records that differ from the class name in lower case."""


def term_of(value: object) -> Value:  # noqa: PLR0911 (one per type)
    """Converts a field of an answer: text to an atom, a record to a compound, None to `none`."""
    match value:
        case bool() | int() | float() | None | Compound() | Unbound():
            return value
        case Enum():  # before str, because of StrEnum
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
    """A literal in the form of SWI-Prolog's semweb library; without a datatype it is an xsd:string, see RDF 1.1."""
    if language:
        return Compound("literal", (Compound("lang", (Atom(language), Atom(text))),))
    type = datatype or PREFIXES["xsd"] + "string"
    return Compound("literal", (Compound("type", (Atom(type), Atom(text))),))


def text_of(value: Value, role: str) -> str:
    """The text of an atom or string.

    Raises:
        InvalidArgumentError: it is neither; `role` says what it should be the name of.
    """
    if isinstance(value, str):
        return str(value)
    raise InvalidArgumentError(f"the {role}", cause=f"{value!r} is not a name")


def _columns(question: Question[Any]) -> list[str]:
    """The columns of a predicate in their order: the map first, as in KnowRob, then the other arguments."""
    arguments = [argument.name for argument in question.arguments]
    arguments.sort(key=lambda name: name != "map")
    return [*arguments, *(column for column in question.columns if column not in arguments)]


class WorldPredicates:
    """Handlers that spawn, attach and highlight bodies."""

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
        """The parts of a map that can be spawned: bodies, joints, and parents and children of attachments."""
        world = self._world(map)
        iris = {body.id: Atom(body.iri) for body in world.bodies}
        joints = [Atom(each.iri) for each in world.joints]
        parents = [iris[each.parent] for each in world.attachments]
        children = [iris[each.child] for each in world.attachments]
        return Compound("contents", (list(iris.values()), joints, parents, children))

    def spawn(self, map: Value) -> Value:
        """Spawns a map; returns whether nothing failed."""
        return self._spawn(self._world(map))

    def spawn_models(self, map: Value, models: Sequence[Value]) -> Value:
        """Spawns some bodies of a map; returns whether nothing failed."""
        world = self._world(map)
        bodies = {body.iri: body for body in world.bodies}
        selected = tuple(bodies[iri] for iri in self._select(models, bodies, "bodies", world))
        return self._spawn(msgspec.structs.replace(world, bodies=selected, joints=(), attachments=()))

    def spawn_constraints(self, map: Value, constraints: Sequence[Value]) -> Value:
        """Adds joints of a map between spawned bodies; returns whether nothing failed."""
        world = self._world(map)
        joints: dict[Iri, Joint] = {each.iri: each for each in world.joints}
        selected = tuple(joints[iri] for iri in self._select(constraints, joints, "joints", world))
        return self._spawn(World(iri=world.iri, name=world.name, joints=selected))

    def spawn_relations(self, map: Value, parents: Sequence[Value], children: Sequence[Value]) -> Value:
        """Attaches each child to the parent at the same index; returns whether nothing failed."""
        if len(parents) != len(children):
            cause = f"{len(parents)} parents and {len(children)} children are not pairs"
            raise InvalidArgumentError("spawn_relations", cause=cause, remedy="give one parent for each child")
        world = self._world(map)
        ids = {body.iri: body.id for body in world.bodies}
        parent_ids = [ids[iri] for iri in self._select(parents, ids, "bodies", world)]
        child_ids = [ids[iri] for iri in self._select(children, ids, "bodies", world)]
        pairs = zip(parent_ids, child_ids, strict=True)
        attachments = tuple(Attachment(parent=parent, child=child) for parent, child in pairs)
        return self._spawn(World(iri=world.iri, name=world.name, attachments=attachments))

    def failed_items(self) -> Value:
        """What could not be spawned last, as failed(Kind, Id, Reason)."""
        return self._failed

    def _world(self, map: Value) -> World:
        knowledge = self._simulation.knowledge
        return knowledge.world(knowledge.names.find(text_of(map, "map"), EntityType.MAP))

    def _spawn(self, world: World) -> bool:
        report = self._simulation.spawn(world)
        self._failed = tuple(_failures(report))
        return report.ok

    def _select(self, names: Sequence[Value], candidates: Collection[Iri], type_name: str, world: World) -> list[Iri]:
        find = self._simulation.knowledge.names.find
        iris = [find(text_of(name, "individual"), EntityType.INDIVIDUAL) for name in names]
        for iri in iris:
            if iri not in candidates:
                raise InvalidArgumentError(local_name(iri), cause=f"it is none of the {type_name} of {world.name}")
        return iris

    # -- spawned bodies -----------------------------------------------------------------------------------------------

    def attach(self, parent: Value, child: Value) -> Value:
        """Attaches a body to another one at its current pose."""
        self._simulation.apply(Attach(self._body(parent), self._body(child)))
        return True

    def highlight(self, individuals: Sequence[Value], color: Value, reason: Value) -> Value:
        """Highlights bodies, or clears their highlights.

        Returns highlighted(Count, List), with not_highlighted(Name, Reason) for each individual without a body.
        """
        names = [self._body_or_name(each) for each in individuals]
        result = self._simulation.highlight(names, _color(color), label=str(reason), missing_ok=True)
        failed = [Compound("not_highlighted", (Atom(each.id), each.reason)) for each in result.unhighlighted]
        return Compound("highlighted", (len(result.highlighted), failed))

    def unhighlight(self) -> Value:
        """Clears all highlights."""
        self._simulation.clear_highlights()
        return True

    def _body_or_name(self, individual: Value) -> str:
        """The id of a body if the name is one, otherwise the IRI."""
        name = text_of(individual, "individual")
        return (
            name
            if name in self._simulation.state.ids
            else self._simulation.knowledge.names.find(name, EntityType.INDIVIDUAL)
        )

    def _body(self, individual: Value) -> BodyId:
        """The id of the body; the local name if there is none, for the error message of the engine."""
        name = self._body_or_name(individual)
        bodies = (body for world in self._simulation.worlds for body in world.bodies)
        return next((body.id for body in bodies if body.iri == name), BodyId(local_name(name)))


def _failures(report: SpawnReport) -> Iterator[Value]:
    for kind, failures in (
        ("body", report.failed_bodies),
        ("joint", report.failed_joints),
        ("attachment", report.failed_attachments),
    ):
        for failure in failures:
            yield Compound("failed", (Atom(kind), Atom(failure.id), failure.reason))


def _color(value: Value) -> Color | None:
    match value:
        case Compound("rgb", parts):
            return parse_color(",".join(map(str, parts)))
        case _:
            return parse_color(str(value))


_GRAPH_PREFIX = "urn:graph:"
_THING = Iri(OWL + "Thing")
_VOCABULARY_NAMESPACES = (OWL, RDFS, RDF)
_INVERSE_OF = "inverse_of"
"""The functor of the inverse of a property, as in `rdf_has/4`."""
"""Namespaces of the vocabulary of ontologies, whose classes have no members in the index."""


def _subfolders(folder: Path) -> list[Path]:
    """The folders in one, by name, without hidden ones; none if it cannot be read.

    Those whose names are not UTF-8 are left out, because Prolog cannot open them.
    """
    try:
        with os.scandir(folder) as entries:
            names = [each.name for each in entries if not each.name.startswith(".") and each.is_dir()]
    except OSError:
        return []
    return [folder / name for name in sorted(names) if name == without_surrogates(name)]


class RdfPredicates:
    """Handlers of the RDF predicates, as in SWI-Prolog's semweb library and KnowRob."""

    def __init__(self, knowledge: KnowledgeBase) -> None:
        self._knowledge = knowledge
        self.feed = ChangeFeed.of(knowledge)
        """The changes for the copy of the store in Prolog."""
        handlers: dict[str, Handler] = {
            "rdf_changes": self.changes,
            "rdf_table": self.table,
            "rdf": self.asserted,
            "rdf_has": self.inferred,
            "rdf_assert": self.assert_triple,
            "rdf_retractall": self.retract_triples,
            "rdfs_individual_of": self.individuals,
            "rdfs_subclass_of": self.subclasses,
            "owl_class_properties": self.class_properties,
            "owl_description": self.description,
            "owl_parse": self.load_source,
            "ros_package_folder": self.package_folder,
            "neighbor_folders": self.neighbor_folders,
        }
        self.handlers = {name: self._locked(handler) for name, handler in handlers.items()}

    def _locked(self, handler: Handler) -> Handler:
        """Wraps a handler to hold the lock of the knowledge base."""

        def handle(*arguments: Value) -> Value:
            with self._knowledge.lock:
                return handler(*arguments)

        return handle

    # -- triples -------------------------------------------------------------------------------------------------------

    def changes(self, copied: Value) -> Value:
        """What has changed since the last call, for the copy of the store in `rdf_mirror.pl`.

        Returns:
            `copy(Name, File)` with a temporary file, which Prolog removes; `changed(List)` of added/4 and removed/4; or
            `remote` if the store is not copied.
        """
        match self.feed.changes(str(copied)):
            case None:
                return Atom("remote")
            case StoreCopy(name, quads):
                handle, path = tempfile.mkstemp(prefix="mindstage-", suffix=".nq")
                os.close(handle)
                atomic_write(Path(path), quads)
                return Compound("copy", (Atom(name), Atom(path)))
            case changes:
                return Compound(
                    "changed",
                    (
                        [
                            Compound(
                                "added" if each.is_asserted else "removed",
                                (Atom(each.subject), Atom(each.property), _value_term(each.value), Atom(each.graph)),
                            )
                            for each in changes
                        ],
                    ),
                )

    def asserted(self, subject: Value, property: Value, value: Value) -> Value:
        """Asserted triples."""
        return self._rows(TripleStoreView(self._knowledge).find, subject, property, value)

    def inferred(self, subject: Value, property: Value, value: Value) -> Value:
        """Triples of a property, its subproperties and their inverses."""
        return self._rows(TripleStoreView(self._knowledge).find_entailed, subject, property, value)

    def assert_triple(self, subject: Value, property: Value, value: Value, graph: Value) -> Value:
        """Adds a triple to a graph."""
        subject_name, property_name = text_of(subject, "subject"), text_of(property, "property")
        triples = TripleStoreView(self._knowledge)
        triples.add(subject_name, property_name, _to_rdf_term(value), _graph(graph))
        return True

    def retract_triples(self, subject: Value, property: Value, value: Value, graph: Value) -> Value:
        """Removes all matching triples of a graph, or of all graphs, and returns their number."""
        source = _graph(graph)
        triples, pattern = TripleStoreView(self._knowledge), _value_pattern(value)
        subject_name, property_name = _resource_name(subject, "subject"), _resource_name(property, "property")
        if value is FREE or pattern.exact_term:
            return triples.remove(subject_name, property_name, pattern.exact_term, source)
        matching = [each for each in triples.find(subject_name, property_name) if pattern.matches(each.value)]
        return sum(triples.remove(each.subject, each.property, each.value, source) for each in matching)

    def load_source(self, source: Value, follow_imports: Value = True) -> Value:
        """Loads a file, a folder of packages or a `package://` URL, with imports."""
        self._knowledge.load((), ontologies=text_of(source, "source"), follow_imports=follow_imports is True)
        return True

    def _rows(
        self,
        search: Callable[[str | None, str | None, RdfTerm | None], Iterator[Triple]],
        subject: Value,
        property: Value,
        value: Value,
    ) -> list[Value]:
        subject_name, property_name = _resource_name(subject, "subject"), _resource_name(property, "property")
        pattern = _value_pattern(value)
        return [
            [
                Atom(each.subject) if subject_name is None else FREE,
                Atom(each.property) if property_name is None else FREE,
                FREE if pattern.is_exact else _value_term(each.value),
            ]
            for each in search(subject_name, property_name, pattern.exact_term)
            if pattern.matches(each.value)
        ]

    # -- inference -----------------------------------------------------------------------------------------------------

    def table(self, table: Value, name: Value) -> Value:
        """What is inferred about a class, an individual or a property, for the tables of `rdf_mirror.pl`."""
        reasoner, iri = self._knowledge.reasoner, Iri(text_of(name, "name"))
        properties = reasoner.properties
        tables: dict[str, Callable[[], Iterable[Value]]] = {
            "class_member_": lambda: (each[0] for each in self.individuals(FREE, name)),
            "class_of_": lambda: (each[1] for each in self.individuals(name, FREE)),
            "superclass_": lambda: (each[1] for each in self.subclasses(name, FREE)),
            "subclass_": lambda: (each[0] for each in self.subclasses(FREE, name)),
            "restriction_": lambda: dict.fromkeys(
                _restriction_term(each.restriction) for each in reasoner.restrictions(iri)
            ),
            "implied_": lambda: map(Atom, properties.sub_properties(iri)),
            "superproperty_": lambda: map(Atom, properties.super_properties(iri)),
            "expressions_": lambda: (
                Compound("forward" if forward else "backward", (Atom(node.value),))
                for node, forward in properties.used_expressions(iri)
            ),
        }
        return list(tables[str(table)]())

    def description(self, node: Value) -> Value:
        """The class expression of a node; None if it is no class."""
        name = text_of(node, "class")
        return _description_term(self._knowledge.reasoner.expression(Iri(name)))

    def package_folder(self, package: Value) -> Value:
        """The folder of a ROS package among those of the knowledge base; None if there is none."""
        folder = self._knowledge.package_folder(text_of(package, "package"))
        return None if folder is None else Atom(str(folder))

    def neighbor_folders(self, stack: Value, base: Value) -> Value:
        """The folders named `base` of packages in the folder `stack`, then in the folders beside it, by name."""
        within, name = Path(text_of(stack, "folder")), text_of(base, "name")
        packages = dict.fromkeys(_subfolders(within))
        for beside in _subfolders(within.parent):
            packages |= dict.fromkeys(_subfolders(beside))
        return [Atom(str(each / name)) for each in packages if (each / name).is_dir()]

    def individuals(self, individual: Value, cls: Value) -> list[list[Value]]:
        """Individuals and their classes, asserted and inherited."""
        index = self._knowledge.reasoner
        one, kind = self._name(individual, EntityType.INDIVIDUAL), self._name(cls, EntityType.CLASS)
        if kind == _THING:
            everything = [one] if one else sorted({*index.types, *index.individuals.untyped})
            return [[FREE if one else Atom(each), FREE] for each in everything if not one or index.types_of(one)]
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
            for above in _with_thing(up for type in index.types_of(each) for up in index.classes.above(type))
        ]

    def subclasses(self, cls: Value, superclass: Value) -> list[list[Value]]:
        """Classes and their superclasses, each class itself first."""
        classes = self._knowledge.reasoner.classes
        lower, upper = self._name(cls, EntityType.CLASS), self._name(superclass, EntityType.CLASS)
        if lower and upper:
            return [[FREE, FREE]] if upper in {*classes.above(lower), _THING} else []
        if upper and upper != _THING:
            return [[Atom(each), FREE] for each in classes.below(upper)]
        every = [lower] if lower else sorted({*self._knowledge.reasoner.declared_classes(), _THING})
        if upper:
            return [[Atom(each), FREE] for each in every]
        return [
            [FREE if lower else Atom(each), Atom(above)] for each in every for above in _with_thing(classes.above(each))
        ]

    def class_properties(self, cls: Value, property: Value) -> Value:
        """Values that restrictions guarantee for members of a class, inherited ones included, nearest first.

        A property is `inverse_of(P)` where the restriction is on the inverse of P.
        """
        index, inverse = self._knowledge.reasoner, None if property is FREE else False
        if isinstance(property, Compound) and property.name == _INVERSE_OF and len(property.arguments) == 1:
            inverse, property = True, property.arguments[0]
        one, wanted = self._name(cls, EntityType.CLASS), self._name(property, EntityType.PROPERTY)
        below = {lower for owner in index.restricted_classes() for lower in index.classes.below(owner)}
        rows: dict[tuple[Iri, Value, Expression], None] = {}
        for each in [one] if one else sorted(below):
            for owned in index.restrictions(each):
                restriction = owned.restriction
                if (
                    restriction.restriction_type is not RestrictionType.HAS_VALUE
                    and not restriction.implies_existence()
                ):
                    continue
                is_wanted = not wanted or wanted in index.properties.super_properties(restriction.property)
                if restriction.filler and is_wanted and inverse in (None, restriction.inverse):
                    rows[each, FREE if wanted else _property_term(restriction), restriction.filler] = None
        return [
            [FREE if one else Atom(owner), property_term, _expression_term(filler)]
            for owner, property_term, filler in rows
        ]

    def _name(self, value: Value, kind: EntityType) -> Iri | None:
        """The IRI of a name; a full IRI is not looked up, so it may be unknown."""
        if value is FREE:
            return None
        name = text_of(value, kind.value)
        return Iri(name) if ":" in name else self._knowledge.names.find(name, kind)


_VALUE_HINT = "give an atom, or literal(Text), literal(type(Type, Text)), literal(lang(Language, Text))"


def _with_thing(classes: Iterable[Iri]) -> tuple[Iri, ...]:
    """Classes, each once, then owl:Thing, which is above all of them."""
    found = dict.fromkeys(classes)
    if found:
        found.pop(_THING, None)
        found[_THING] = None
    return tuple(found)


def _graph(value: Value) -> str | None:
    """The graph that Prolog calls by a name: `user` is that of assertions, other names without a scheme are URNs."""
    if value is FREE:
        return None
    name = text_of(value, "graph")
    return RUNTIME_GRAPH_IRI if name == "user" else name if ":" in name else _GRAPH_PREFIX + name


def _resource_name(value: Value, role: str) -> str | None:
    return None if value is FREE else text_of(value, role)


class _ValuePattern(msgspec.Struct, frozen=True):
    """The pattern of the value of a triple; Prolog unifies what the pattern does not restrict."""

    exact_term: RdfTerm | None = None
    """The resource or literal, if it is fully given."""
    is_literal: bool = False
    text: str | None = None
    """The text of a literal of any datatype."""

    @property
    def is_exact(self) -> bool:
        return bool(self.exact_term or self.text is not None)

    def matches(self, term: RdfTerm) -> bool:
        if self.exact_term or not self.is_literal:
            return True
        return term.kind == "literal" and self.text in {None, term.value}


def _value_pattern(value: Value) -> _ValuePattern:
    """The pattern of a term.

    Raises:
        InvalidArgumentError: the term is neither a resource nor a literal.
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
                "the value", cause=f"{value!r} is neither a resource nor a literal", remedy=_VALUE_HINT
            )


def _to_rdf_term(value: Value) -> RdfTerm:
    """The RDF term of a Prolog term; a literal without a datatype gets that of its value.

    Raises:
        InvalidArgumentError: the term is neither a resource nor a literal, or has unbound parts.
    """
    match value:
        case Compound("literal", (int() as number,)):
            return RdfTerm("literal", str(number), XSD + "integer")
        case Compound("literal", (float() as number,)):
            return RdfTerm("literal", repr(number), XSD + "double")
    pattern = _value_pattern(value)
    if pattern.exact_term:
        return pattern.exact_term
    if pattern.text is None:
        raise InvalidArgumentError("the value", cause="it has unbound parts", remedy=_VALUE_HINT)
    return RdfTerm("literal", pattern.text, XSD + "string")


def _value_term(term: RdfTerm) -> Value:
    match term.kind:
        case "literal":
            return literal_term(term.value, term.datatype, term.language)
        case "blank":
            return Atom(f"_:{term.value}")
        case _:
            return Atom(term.value)


def _restriction_term(restriction: Restriction) -> Compound:
    """A restriction in the terms of ClioPatria's `owl_restriction/2`."""
    filler = Atom(OWL + "Thing") if restriction.filler is None else _description_term(restriction.filler)
    count = restriction.cardinality or 0
    conditions: dict[RestrictionType, tuple[str, tuple[Value, ...]]] = {
        RestrictionType.SOME: ("some_values_from", (filler,)),
        RestrictionType.ALL: ("all_values_from", (filler,)),
        RestrictionType.HAS_VALUE: ("has_value", (filler,)),
        RestrictionType.HAS_SELF: ("has_self", (True,)),
        RestrictionType.MIN_CARDINALITY: ("cardinality", (count, Atom("inf"))),
        RestrictionType.MAX_CARDINALITY: ("cardinality", (0, count)),
    }
    condition = Compound(*conditions.get(restriction.restriction_type, ("cardinality", (count, count))))
    return Compound("restriction", (_property_term(restriction), condition))


def _property_term(restriction: Restriction) -> Value:
    """The property of a restriction; `inverse_of(P)` for one on the inverse of P."""
    property = Atom(restriction.property)
    return Compound(_INVERSE_OF, (property,)) if restriction.inverse else property


def _description_term(expression: Expression | None) -> Value:
    """A class expression in the terms of ClioPatria's `owl_description/2`; None if it has no meaning."""
    match expression:
        case Restriction():
            return _restriction_term(expression)
        case UnionOf(members):
            return Compound("union_of", (tuple(_description_term(each) for each in members),))
        case IntersectionOf(members):
            return Compound("intersection_of", (tuple(_description_term(each) for each in members),))
        case OneOf(members):
            return Compound("one_of", (tuple(_description_term(each) for each in members),))
        case ComplementOf(expression=complement):
            return Compound("complement_of", (_description_term(complement),))
        case _:
            return _expression_term(expression) if isinstance(expression, NamedClass | Constant) else None


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
        case Restriction(_, kind, filler):
            value = None if filler is None else _expression_term(filler)
            return Compound("restriction", (_property_term(expression), Atom(kind.value), value))
        case _:
            return None
