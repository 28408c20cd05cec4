"""Add a class and a restriction in Turtle, and ask a question whose answer follows from them."""

import tempfile
from pathlib import Path

import mindstage as ms

RULE = """
@prefix : <http://example.org/sweets#> .
@prefix knowrob: <http://knowrob.org/kb/knowrob.owl#> .
@prefix owl: <http://www.w3.org/2002/07/owl#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .

:Chocolate a owl:Class ; rdfs:subClassOf knowrob:Candy .
knowrob:Cupboard rdfs:subClassOf [ a owl:Restriction ;
    owl:onProperty knowrob:typePrimaryFunction-containerFor ;
    owl:someValuesFrom knowrob:Candy ] .
"""

with tempfile.TemporaryDirectory() as folder:
    ontology = Path(folder, "sweets.ttl")
    ontology.write_text(RULE)
    with ms.open("bundled:kitchen", engine="null", ontologies=ontology) as sim:
        for answer in sim.ask("storage_place_in_environment", item="Chocolate"):
            print(answer.individual.rpartition("#")[2], "is a", answer.place.rpartition("#")[2])
