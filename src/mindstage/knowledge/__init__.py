"""Semantic maps and ontologies: reading and writing maps, answering questions, asserting statements.

A module is imported when one of its names is first used: a question needs no writer of maps.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
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

_MODULES = {
    "AssertionFile": "mindstage.knowledge.assertion_file",
    "Assumption": "mindstage.knowledge.dialects.conventions",
    "Finding": "mindstage.knowledge.rdf",
    "Handedness": "mindstage.knowledge.dialects.conventions",
    "KnowledgeBase": "mindstage.knowledge.knowledge_base",
    "LengthUnit": "mindstage.knowledge.dialects.conventions",
    "MapDialect": "mindstage.knowledge.io.write",
    "MapFormat": "mindstage.knowledge.io.write",
    "MapStatistics": "mindstage.knowledge.map_statistics",
    "QuaternionOrder": "mindstage.knowledge.dialects.conventions",
    "RdfTerm": "mindstage.knowledge.rdf",
    "Severity": "mindstage.knowledge.rdf",
    "SizeFrame": "mindstage.knowledge.dialects.conventions",
    "SourceMapView": "mindstage.knowledge.graph_diff",
    "SparqlEndpoint": "mindstage.knowledge.endpoint",
    "SparqlResult": "mindstage.knowledge.rdf",
    "UnitConventions": "mindstage.knowledge.dialects.conventions",
    "bundled_kitchen": "mindstage.knowledge.io.files",
    "bundled_ontology": "mindstage.knowledge.io.files",
    "lost_statements": "mindstage.knowledge.graph_diff",
    "save_map": "mindstage.knowledge.io.write",
    "write_map": "mindstage.knowledge.io.write",
}


def __getattr__(name: str) -> object:
    if name in _MODULES:
        return getattr(import_module(_MODULES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
