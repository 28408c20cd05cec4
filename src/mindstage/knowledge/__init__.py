"""Knowledge bases: maps and ontologies in an RDF store, answering questions, asserting statements.

A module is imported when one of its names is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING

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


def __getattr__(name: str) -> object:
    if name in _MODULES:
        return getattr(import_module(_MODULES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
