"""Knowledge: semantic maps and ontologies go in, worlds and answers come out, and worlds go back into maps."""

from mindstage.knowledge.analysis import Analysis
from mindstage.knowledge.base import KnowledgeBase
from mindstage.knowledge.bundled import bundled_kitchen, bundled_ontology
from mindstage.knowledge.findings import Finding, Severity
from mindstage.knowledge.reading.assumptions import Assumption
from mindstage.knowledge.reading.conventions import Conventions, Frame, QuaternionOrder, Units
from mindstage.knowledge.reading.losses import lost_statements
from mindstage.knowledge.reading.origin import Origin
from mindstage.knowledge.stores.endpoint import Endpoint
from mindstage.knowledge.stores.sparql import Table, Term
from mindstage.knowledge.told_file import ToldFile
from mindstage.knowledge.writers.mapwriter import MapDialect, MapFormat, save_map, write_map

__all__ = [
    "Analysis",
    "Assumption",
    "Conventions",
    "Endpoint",
    "Finding",
    "Frame",
    "KnowledgeBase",
    "MapDialect",
    "MapFormat",
    "Origin",
    "QuaternionOrder",
    "Severity",
    "Table",
    "Term",
    "ToldFile",
    "Units",
    "bundled_kitchen",
    "bundled_ontology",
    "lost_statements",
    "save_map",
    "write_map",
]
