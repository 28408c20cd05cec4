"""Knowledge: semantic maps and ontologies go in, worlds and answers come out, and worlds go back into maps."""

from mindstage.knowledge.analysis import Analysis
from mindstage.knowledge.base import KnowledgeBase
from mindstage.knowledge.bundled import bundled_kitchen, bundled_ontology
from mindstage.knowledge.findings import Finding, Severity
from mindstage.knowledge.mapwriter import MapFormat, save_map, write_map
from mindstage.knowledge.sparql import Table, Term

__all__ = [
    "Analysis",
    "Finding",
    "KnowledgeBase",
    "MapFormat",
    "Severity",
    "Table",
    "Term",
    "bundled_kitchen",
    "bundled_ontology",
    "save_map",
    "write_map",
]
