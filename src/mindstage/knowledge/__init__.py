"""Knowledge bases: maps and ontologies in an RDF store, answering questions, asserting statements.

A module is imported when one of its names is first used.
"""

from typing import TYPE_CHECKING

from mindstage.lazy_names import lazy_names

if TYPE_CHECKING:
    from mindstage.knowledge.assertion_file import AssertionFile
    from mindstage.knowledge.endpoint import SparqlEndpoint
    from mindstage.knowledge.knowledge_base import KnowledgeBase

__all__ = ["AssertionFile", "KnowledgeBase", "SparqlEndpoint"]

_MODULES = {
    "AssertionFile": "mindstage.knowledge.assertion_file",
    "KnowledgeBase": "mindstage.knowledge.knowledge_base",
    "SparqlEndpoint": "mindstage.knowledge.endpoint",
}


__getattr__, __dir__ = lazy_names(__name__, _MODULES)
