"""RDF data: graphs and the interface of stores, vocabularies, class hierarchies, and findings about sources."""

from mindstage.rdf.graphs import Finding, RdfTerm, Severity, SparqlResult

__all__ = ["Finding", "RdfTerm", "Severity", "SparqlResult"]

__dir__ = __all__.copy
