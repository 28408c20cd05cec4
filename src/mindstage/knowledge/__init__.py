"""Knowledge: semantic maps and ontologies go in, worlds and answers come out, and worlds go back into maps."""

from mindstage.knowledge.analysis import MapStatistics
from mindstage.knowledge.base import KnowledgeBase
from mindstage.knowledge.bundled import bundled_kitchen, bundled_ontology
from mindstage.knowledge.findings import Finding, Severity
from mindstage.knowledge.reading.assumptions import Assumption
from mindstage.knowledge.reading.conventions import Handedness, LengthUnit, QuaternionOrder, UnitConventions
from mindstage.knowledge.reading.losses import lost_statements
from mindstage.knowledge.reading.origin import SourceMapView
from mindstage.knowledge.stores.endpoint import SparqlEndpoint
from mindstage.knowledge.stores.sparql import RdfTerm, SparqlResult
from mindstage.knowledge.told_file import AssertionFile
from mindstage.knowledge.writers.mapwriter import MapDialect, MapFormat, save_map, write_map

__all__ = [
    "AssertionFile",
    "Assumption",
    "Finding",
    "Handedness",
    "KnowledgeBase",
    "LengthUnit",
    "MapDialect",
    "MapFormat",
    "MapStatistics",
    "QuaternionOrder",
    "RdfTerm",
    "Severity",
    "SourceMapView",
    "SparqlEndpoint",
    "SparqlResult",
    "UnitConventions",
    "bundled_kitchen",
    "bundled_ontology",
    "lost_statements",
    "save_map",
    "write_map",
]
