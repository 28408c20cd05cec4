"""Semantic maps and ontologies: reading and writing maps, answering questions, asserting statements."""

from mindstage.knowledge.assertion_file import AssertionFile
from mindstage.knowledge.dialects.conventions import (
    Assumption,
    Handedness,
    LengthUnit,
    QuaternionOrder,
    SizeFrame,
    UnitConventions,
)
from mindstage.knowledge.endpoint import SparqlEndpoint
from mindstage.knowledge.graph_diff import SourceMapView, lost_statements
from mindstage.knowledge.io.files import bundled_kitchen, bundled_ontology
from mindstage.knowledge.io.write import MapDialect, MapFormat, save_map, write_map
from mindstage.knowledge.knowledge_base import KnowledgeBase
from mindstage.knowledge.map_statistics import MapStatistics
from mindstage.knowledge.rdf import Finding, RdfTerm, Severity, SparqlResult

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
    "SizeFrame",
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
