"""`python in_rdflib.py MAP FILE…` loads files into rdflib, runs SPARQL queries, and prints the columns of `ours`."""

from __future__ import annotations

import logging
import sys
import time
from statistics import median

from rdflib import RDF, Graph, Namespace, URIRef
from rdflib.plugins.sparql import prepareQuery

__all__ = ["main"]

KNOWROB = Namespace("http://knowrob.org/kb/knowrob.owl#")

UP = "(rdfs:subClassOf|owl:equivalentClass|^owl:equivalentClass)*"
STORED = f"""knowrob:CowsMilk {UP} ?item . ?item ^((owl:unionOf/rdf:rest*/rdf:first)?) ?filler .
    ?filler ^owl:someValuesFrom ?restriction . ?place rdfs:subClassOf ?restriction .
    ?restriction owl:onProperty/rdfs:subPropertyOf* knowrob:typePrimaryFunction-containerFor ."""
NEEDED = f"""knowrob:BakingFood {UP} ?owner . ?owner rdfs:subClassOf ?restriction .
    ?restriction owl:onProperty/rdfs:subPropertyOf* knowrob:deviceUsed ; owl:someValuesFrom ?device ."""
HERE = f"?class {UP} ?kind . ?it a ?class ; knowrob:describedInMap ?map ."

QUERIES = {
    "maps": "SELECT ?map { ?map a knowrob:SemanticEnvironmentMap }",
    "individual_of_class": f"SELECT DISTINCT ?it {{ {HERE} }}".replace("?kind", "knowrob:Handle"),
    "part_of": "SELECT DISTINCT ?part { ?door (knowrob:properPhysicalParts|knowrob:child|^knowrob:parent)+ ?part }",
    "subclass_of": f"SELECT DISTINCT ?above {{ knowrob:Refrigerator {UP} ?above FILTER(isIRI(?above)) }}",
    "storage_place": f"SELECT DISTINCT ?place {{ {STORED} }}",
    "storage_place_in_environment": f"SELECT DISTINCT ?it {{ {STORED} {HERE.replace('?kind', '?place')} }}",
    "device_for_action": f"SELECT DISTINCT ?device {{ {NEEDED} }}",
    "device_for_action_in_environment": f"SELECT DISTINCT ?it {{ {NEEDED} {HERE.replace('?kind', '?device')} }}",
}
"""The queries by the name of the question; only questions that SPARQL property paths can express."""


def main(map: str, files: list[str]) -> None:
    logging.disable(logging.WARNING)
    graph = Graph()
    graph.bind("knowrob", KNOWROB)
    start = time.perf_counter()
    for file in files:
        graph.parse(file, format="turtle" if file.endswith(".ttl") else "xml")
    print("load", time.perf_counter() - start, len(graph), sep="\t")
    doors = set(graph.subjects(RDF.type, KNOWROB.IAIFridgeDoor))
    door = next(door for door in doors if (door, KNOWROB.describedInMap, URIRef(map)) in graph)
    bindings = {"map": URIRef(map), "door": door}
    for name, text in QUERIES.items():
        query = prepareQuery(text, initNs=dict(graph.namespaces()))
        bound = {each: node for each, node in bindings.items() if f"?{each}" in text and name != "maps"}
        times, count = [], 0
        for _ in range(3):
            start = time.perf_counter()
            count = len(list(graph.query(query, initBindings=bound)))
            times.append(time.perf_counter() - start)
        print(name, median(times), count, sep="\t", flush=True)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
