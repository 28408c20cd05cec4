"""Classes of the bundled ontology and their restrictions, computed independently of Mindstage's reasoner."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import pyoxigraph
from pyoxigraph import BlankNode, NamedNode

from tests.maps.bundled_scene import KNOWROB, MS, OWL, RDF, RDFS

TYPE = NamedNode(RDF + "type")
SUBCLASS = NamedNode(RDFS + "subClassOf")
Node = NamedNode | BlankNode


@dataclass(frozen=True)
class Restriction:
    """A restriction of a class to one or several (a union) other classes."""

    subject: str
    restriction_type: str
    fillers: tuple[str, ...]


class OntologyClasses:
    def __init__(self, *files: Path) -> None:
        self.store = pyoxigraph.Store()
        for file in files:
            form = pyoxigraph.RdfFormat.TURTLE if file.suffix == ".ttl" else pyoxigraph.RdfFormat.RDF_XML
            self.store.load(path=str(file), format=form, base_iri="http://example.org/", lenient=True)
        self.parents: dict[str, set[str]] = defaultdict(set)
        for quad in self.store.quads_for_pattern(None, SUBCLASS, None):
            if isinstance(quad.subject, NamedNode) and isinstance(quad.object, NamedNode):
                self.parents[short_name(quad.subject)].add(short_name(quad.object))
        self.declared = set(self.individuals_of_type(OWL + "Class"))

    def individuals_of_type(self, cls: str) -> Iterator[str]:
        for quad in self.store.quads_for_pattern(None, TYPE, NamedNode(cls)):
            if isinstance(quad.subject, NamedNode):
                yield short_name(quad.subject)

    def ancestors(self, cls: str) -> set[str]:
        found: set[str] = set()
        queue = [cls]
        while queue:
            new = self.parents.get(queue.pop(), set()) - found
            found |= new
            queue += new
        return found

    def class_and_ancestors(self, cls: str) -> set[str]:
        """The class and its ancestors."""
        return {cls} | self.ancestors(cls)

    def instances(self, cls: str, map: str | None = None) -> set[str]:
        """Individuals of a map, or of any map, whose class is that class or a subclass."""
        described = NamedNode(KNOWROB + "describedInMap")
        within = None if map is None else NamedNode(map)
        return {
            quad.subject.value.rpartition("#")[2]
            for quad in self.store.quads_for_pattern(None, described, within)
            for kind in self.store.quads_for_pattern(quad.subject, TYPE, None)
            if cls in self.class_and_ancestors(short_name(kind.object))
        }

    def restrictions(self, property: str) -> Iterator[Restriction]:
        for quad in self.store.quads_for_pattern(None, NamedNode(OWL + "onProperty"), NamedNode(KNOWROB + property)):
            (subject,) = {
                short_name(each.subject) for each in self.store.quads_for_pattern(None, SUBCLASS, quad.subject)
            }
            for kind in ("someValuesFrom", "allValuesFrom"):
                for each in self.store.quads_for_pattern(quad.subject, NamedNode(OWL + kind), None):
                    yield Restriction(subject, kind, tuple(self.union_members(each.object)))

    def union_members(self, node: Node) -> Iterator[str]:
        """The class, or the classes of a union."""
        if isinstance(node, NamedNode):
            yield short_name(node)
        for quad in self.store.quads_for_pattern(node, NamedNode(OWL + "unionOf"), None):
            yield from map(short_name, self.list_items(quad.object))

    def list_items(self, node: Node) -> Iterator[Node]:
        while node != NamedNode(RDF + "nil"):
            (first,) = self.store.quads_for_pattern(node, NamedNode(RDF + "first"), None)
            (rest,) = self.store.quads_for_pattern(node, NamedNode(RDF + "rest"), None)
            yield first.object
            node = rest.object

    def disjoint(self) -> Iterator[tuple[str, str]]:
        for quad in self.store.quads_for_pattern(None, NamedNode(OWL + "disjointWith"), None):
            yield short_name(quad.subject), short_name(quad.object)
        for quad in self.store.quads_for_pattern(None, TYPE, NamedNode(OWL + "AllDisjointClasses")):
            for members in self.store.quads_for_pattern(quad.subject, NamedNode(OWL + "members"), None):
                yield from combinations(map(short_name, self.list_items(members.object)), 2)

    def in_cycles(self) -> list[str]:
        return [cls for cls in list(self.parents) if cls in self.ancestors(cls)]

    def storage_classes_for(self, item: str) -> dict[str, int]:
        """Classes for storing an item, with the distance of the restriction's class from the item's class."""
        above = self.nearest_first(item)
        found: dict[str, int] = {}
        for restriction in self.restrictions("typePrimaryFunction-containerFor"):
            reasons = [above.index(filler) for filler in restriction.fillers if filler in above]
            if reasons and restriction.restriction_type == "someValuesFrom":
                found[restriction.subject] = min(reasons)
        return found

    def nearest_first(self, cls: str) -> list[str]:
        line = [cls]
        for each in line:
            line += sorted(self.parents.get(each, set()) - set(line))
        return line

    def devices_for(self, action: str) -> set[str]:
        line = self.class_and_ancestors(action)
        return {filler for each in self.restrictions("deviceUsed") if each.subject in line for filler in each.fillers}


def short_name(node: Node) -> str:
    """Returns the local name of a KnowRob IRI; other IRIs keep a prefix."""
    value = str(node.value)
    for namespace, prefix in ((KNOWROB, ""), (MS, "ms:"), (OWL, "owl:")):
        if value.startswith(namespace):
            return prefix + value.removeprefix(namespace)
    return value
