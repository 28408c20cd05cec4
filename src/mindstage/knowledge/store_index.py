"""The index in the folder of a store: what the reasoner and the names were built from, so that they need not be.

    FOLDER/
      index.msgpack    classes, types, maps and names; which state of the store it belongs to
      index.state      the number of that state, replaced before the first change of the statements, and the manifest of
                       the triple store, which that replaces whenever a program opens it for writing

An index that has another state, that another program may have outdated, or that cannot be decoded is not used: it is
rebuilt, which is reported. While files are loaded, the index is built from their text, since
reading the same statements from the store takes several times as long.
"""

from __future__ import annotations

import secrets
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from hashlib import blake2b
from pathlib import Path

import msgspec
import pyoxigraph as ox

from mindstage.files import atomic_write
from mindstage.knowledge.names import NameIndex
from mindstage.knowledge.owl import ClassExpressionParser
from mindstage.knowledge.reasoner import IndividualIndex, Reasoner
from mindstage.knowledge.reasoner_classes import CLASS_AXIOM_PROPERTIES, Axiom, ClassAxioms
from mindstage.maps.io.files import SourceFile
from mindstage.rdf.graphs import QuadSource, gc_paused, has_blank_node
from mindstage.rdf.vocabulary import DESCRIBED_IN_MAP, OWL, RDF, RDFS, SEMANTIC_MAP, TYPE
from mindstage.scene import Iri

__all__ = ["IndexBuilder", "IndexFile", "StoreIndex"]

_INDEX, _STATE = "index.msgpack", "index.state"
_DIGEST_BYTES = 16
_VERSION = 1
_INDEXED = CLASS_AXIOM_PROPERTIES | {TYPE, DESCRIBED_IN_MAP}
_SCHEMA_NAMESPACES = (OWL, RDFS, RDF)
Groups = list[tuple[str, list[int]]]
"""Keys with the numbers of names."""


class _Individuals(msgspec.Struct, frozen=True):
    """An `IndividualIndex`; integers are numbers of names, and `*_groups` the different values of a column."""

    type_groups: list[tuple[Iri, ...]]
    typed: list[int]
    types: list[int]
    map_groups: list[tuple[Iri, ...]]
    described: list[int]
    maps: list[int]
    nested: list[int]
    nested_maps: list[int]
    members: Groups
    members_by_map: Groups
    declared: Groups
    untyped: list[int]
    anonymous: list[tuple[Iri, list[str]]]


class StoreIndex(msgspec.Struct, frozen=True, kw_only=True):
    """The contents of the file."""

    version: int = _VERSION
    state: str
    names: list[Iri]
    individuals: _Individuals
    axioms: list[Axiom]
    axiom_names: list[int]
    restricted_properties: list[Iri]
    fillers: list[Iri]
    local_names: Groups
    maps_by_source: dict[str, tuple[Iri, ...]]

    def reasoner(self, store: QuadSource) -> Reasoner:
        """The reasoner in the state in which it was saved."""
        parser = ClassExpressionParser(look_up=store)
        parser.restricted_properties = dict.fromkeys(self.restricted_properties)
        parser.fillers = dict.fromkeys(self.fillers)
        with gc_paused():
            axioms = _merged_axioms(store)
            axioms.merge(self.axioms, parser, map(self.names.__getitem__, self.axiom_names))
            return Reasoner(store, axioms=axioms, individuals=self._individual_index())

    def name_index(self, store: QuadSource, reasoner: Reasoner) -> NameIndex:
        """The names in the state in which they were saved."""
        with gc_paused():
            return NameIndex(store, reasoner, names=dict(_groups(self.local_names, self.names)))

    def _individual_index(self) -> IndividualIndex:
        saved, names = self.individuals, self.names
        index = IndividualIndex(lambda _: ())
        index.types = dict(_column(saved.typed, saved.types, names, saved.type_groups))
        index.maps_of = dict(_column(saved.described, saved.maps, names, saved.map_groups))
        index.nested_resources = dict(_column(saved.nested, saved.nested_maps, names, saved.map_groups))
        index.members = dict(_groups(saved.members, names))
        index.members_by_map = dict(_groups(saved.members_by_map, names))
        index.declared |= dict(_groups(saved.declared, names))
        index.untyped = _members(saved.untyped, names)
        index.anonymous_types = {name: dict.fromkeys(map(ox.BlankNode, nodes)) for name, nodes in saved.anonymous}
        return index


def _members(numbers: Iterable[int], names: list[Iri]) -> dict[Iri, None]:
    return dict.fromkeys(map(names.__getitem__, numbers))


def _groups(groups: Groups, names: list[Iri]) -> Iterator[tuple[Iri, dict[Iri, None]]]:
    return ((Iri(key), _members(numbers, names)) for key, numbers in groups)


def _column(
    numbers: list[int], groups: list[int], names: list[Iri], values: list[tuple[Iri, ...]]
) -> Iterable[tuple[Iri, tuple[Iri, ...]]]:
    return zip(map(names.__getitem__, numbers), map(values.__getitem__, groups), strict=True)


def _merged_axioms(store: QuadSource) -> ClassAxioms:
    axioms = ClassAxioms(lambda _: ())
    axioms.parser = ClassExpressionParser(look_up=store)
    axioms.is_merged = True
    return axioms


class _Numbers:
    """Numbers names and groups in the order of their first use."""

    def __init__(self) -> None:
        self._numbers: dict[object, int] = {}

    def of(self, names: Iterable[object]) -> list[int]:
        numbers = self._numbers
        return [numbers.setdefault(name, len(numbers)) for name in names]

    def values(self) -> list[object]:
        return list(self._numbers)


def _snapshot(
    reasoner: Reasoner,
    names: NameIndex,
    *,
    state: str,
    maps_by_source: Mapping[str, tuple[Iri, ...]],
) -> StoreIndex:
    of, type_groups, map_groups = _Numbers(), _Numbers(), _Numbers()
    index, axioms = reasoner.individuals, reasoner.axioms
    individuals = _Individuals(
        typed=of.of(index.types),
        types=type_groups.of(index.types.values()),
        described=of.of(index.maps_of),
        maps=map_groups.of(index.maps_of.values()),
        nested=of.of(index.nested_resources),
        nested_maps=map_groups.of(index.nested_resources.values()),
        type_groups=type_groups.values(),  # type: ignore[arg-type]
        map_groups=map_groups.values(),  # type: ignore[arg-type]
        members=[(cls, of.of(each)) for cls, each in index.members.items()],
        members_by_map=[(map, of.of(each)) for map, each in index.members_by_map.items()],
        declared=[(kind, of.of(each)) for kind, each in index.declared.items()],
        untyped=of.of(index.untyped),
        anonymous=[(name, [node.value for node in nodes]) for name, nodes in index.anonymous_types.items()],
    )
    axiom_names = of.of(dict.fromkeys(name for name in axioms.names() if not name.startswith("_:")))
    local_names = [(name, of.of(iris)) for name, iris in names.by_local_name.items()]
    return StoreIndex(
        state=state,
        individuals=individuals,
        axioms=list(axioms.axioms),
        axiom_names=axiom_names,
        restricted_properties=list(axioms.parser.restricted_properties),
        fillers=list(axioms.parser.fillers),
        local_names=local_names,
        maps_by_source=dict(maps_by_source),
        names=of.values(),  # type: ignore[arg-type]
    )


class IndexBuilder:
    """Builds the parts of a reasoner from the texts of files while they are loaded into a store."""

    def __init__(self, store: QuadSource, saved: StoreIndex | None) -> None:
        """Starts with nothing, or with what was saved before."""
        self._store = store
        base = saved.reasoner(store) if saved else None
        self._axioms = base.axioms if base else _merged_axioms(store)
        self._individuals = base.individuals if base else IndividualIndex(lambda _: ())
        self.maps_by_source: dict[str, tuple[Iri, ...]] = dict(saved.maps_by_source) if saved else {}
        self._graphs_with_blank_nodes: list[ox.NamedNode] = []
        self._thread = ThreadPoolExecutor(1)
        self._pending: list[Future[None]] = []

    def add(self, source: str, file: SourceFile, graph: ox.NamedNode) -> Future[None]:
        """Begins to add the statements of a file, in another thread, which may be loaded into the store meanwhile.

        Args:
            source: the name of the source.
            file: its text.
        """
        self._pending.append(self._thread.submit(self._add, source, file, graph))
        return self._pending[-1]

    def discard(self, added: Future[None]) -> None:
        """Forgets a file whose text is not valid, so that nothing of it was added."""
        self._pending.remove(added)
        with suppress(SyntaxError):
            added.result()

    def close(self) -> None:
        """Drops what has not begun. May be called repeatedly."""
        self._thread.shutdown(cancel_futures=True)

    def _add(self, source: str, file: SourceFile, graph: ox.NamedNode) -> None:
        """Adds the statements of a file.

        Blank nodes have other labels in the store: where the labels matter, the statements are read from there.
        """
        quads = ox.parse(file.data, file.format, base_iri=file.iri)
        maps: dict[object, None] = {}
        map_class = ox.NamedNode(SEMANTIC_MAP)
        with gc_paused():
            groups: dict[str, list[ox.Quad]] = {property: [] for property in _INDEXED}
            for quad in quads:
                predicate = quad.predicate.value
                group = groups.get(predicate)
                if group is not None:
                    group.append(quad)
                    if predicate == DESCRIBED_IN_MAP:
                        maps[quad.object] = None
                    elif predicate == TYPE and quad.object == map_class:
                        maps[quad.subject] = None
            _normalize_literals(groups)
            self._axioms.add(groups.__getitem__)
            types = [quad for quad in groups[TYPE] if not _is_schema_of_blank_node(quad)]
            if any(has_blank_node(quad) for quad in (*types, *groups[DESCRIBED_IN_MAP])):
                self._graphs_with_blank_nodes.append(graph)
            else:
                self._individuals.add({**groups, TYPE: types}.__getitem__)
        if all(isinstance(map, ox.NamedNode) for map in maps):
            self.maps_by_source[source] = tuple(Iri(map.value) for map in maps if isinstance(map, ox.NamedNode))

    def reasoner(self) -> Reasoner:
        """The reasoner over everything that was added, which the store must contain by now."""
        for added in self._pending:
            added.result()
        for graph in self._graphs_with_blank_nodes:
            self._individuals.add(partial(self._quads_of, graph))
        return Reasoner(self._store, axioms=self._axioms, individuals=self._individuals)

    def _quads_of(self, graph: ox.NamedNode, property: str) -> Iterator[ox.Quad]:
        return self._store.quads_for_pattern(None, ox.NamedNode(property), None, graph)


def _normalize_literals(groups: dict[str, list[ox.Quad]]) -> None:
    """Replaces literals by those that a store gives back: it normalizes numbers (1.0 becomes 1)."""
    for property in CLASS_AXIOM_PROPERTIES:
        literals = [quad for quad in groups[property] if isinstance(quad.object, ox.Literal)]
        if literals:
            store = ox.Store()
            store.extend(literals)
            others = (quad for quad in groups[property] if not isinstance(quad.object, ox.Literal))
            groups[property] = [*others, *store]


def _is_schema_of_blank_node(quad: ox.Quad) -> bool:
    """Whether a statement says that a blank node is a class or restriction, which no index needs."""
    is_schema = isinstance(quad.object, ox.NamedNode) and quad.object.value.startswith(_SCHEMA_NAMESPACES)
    return is_schema and isinstance(quad.subject, ox.BlankNode)


class IndexFile:
    """The index in a folder, and the state of the statements that it belongs to."""

    def __init__(self, folder: Path, store: Path, *, read_only: bool) -> None:
        """Must be called before the store is opened.

        Args:
            folder: the folder of the index.
            store: the folder of the triple store, a database of RocksDB.
            read_only: whether both are not written.
        """
        self._folder = folder
        self._store = store
        self._is_foreign = self._state()[1] != self._manifest()
        self._read_only = read_only
        self._has_new_state = False
        self.is_current = False
        """Whether the file is known to be that of the current statements."""
        self.problem = ""
        """Why the index that was found is not used; empty if there was none."""

    def on_opened(self) -> None:
        """Must be called after the store was opened, which replaces its manifest."""
        state, _ = self._state()
        if state and not self._read_only:
            self._write_state(secrets.token_hex(8) if self._is_foreign else state)

    def load(self) -> StoreIndex | None:
        """The index; None if there is none for the current statements, for the reason in `problem`."""
        try:
            data = (self._folder / _INDEX).read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            self.problem = f"it cannot be read: {error.strerror}"
            return None
        digest, encoded = data[:_DIGEST_BYTES], data[_DIGEST_BYTES:]
        if blake2b(encoded, digest_size=_DIGEST_BYTES).digest() != digest:
            self.problem = "it is damaged"
            return None
        try:
            with gc_paused():
                index = msgspec.msgpack.decode(encoded, type=StoreIndex)
        except msgspec.DecodeError as error:
            self.problem = f"it is of another version: {error}"
            return None
        if index.version != _VERSION:
            self.problem = f"it is of version {index.version}, and this Mindstage uses version {_VERSION}"
        elif self._is_foreign:
            self.problem = "another program has opened the statements for writing since it was made"
        elif index.state != self._state()[0]:
            self.problem = "the statements have changed since it was made"
        self.is_current = not self.problem
        return index if self.is_current else None

    def save(
        self,
        reasoner: Reasoner,
        names: NameIndex,
        *,
        maps_by_source: Mapping[str, tuple[Iri, ...]],
    ) -> None:
        """Writes the index of the current statements; has no effect in a read-only folder."""
        if self._read_only:
            return
        state = self._new_state()
        with gc_paused():
            index = _snapshot(reasoner, names, state=state, maps_by_source=maps_by_source)
            encoded = msgspec.msgpack.encode(index)
        digest = blake2b(encoded, digest_size=_DIGEST_BYTES).digest()
        atomic_write(self._folder / _INDEX, digest + encoded)
        self.is_current, self._has_new_state, self.problem, self._is_foreign = True, False, "", False

    @property
    def may_be_current(self) -> bool:
        """Whether no statement has changed since the folder was opened or the index was saved."""
        return not self._has_new_state

    def invalidate(self) -> None:
        """Must be called before statements change."""
        self.is_current = False
        if not self._has_new_state and not self._read_only:
            self._has_new_state = True
            self._new_state()

    def _state(self) -> tuple[str, str]:
        """The number of the state, and the manifest of the triple store at that time."""
        try:
            state, _, manifest = (self._folder / _STATE).read_text(encoding="ascii").partition(" ")
        except (OSError, ValueError):
            return "", ""
        return state, manifest

    def _manifest(self) -> str:
        try:
            return (self._store / "CURRENT").read_text(encoding="ascii").strip()
        except (OSError, ValueError):
            return ""

    def _new_state(self) -> str:
        state = secrets.token_hex(8)
        self._write_state(state)
        return state

    def _write_state(self, state: str) -> None:
        atomic_write(self._folder / _STATE, f"{state} {self._manifest()}".encode("ascii"), durable=True)
