"""Reading maps from texts."""

from tests.maps.conftest import make_knowledge_base, read

__all__ = ["make_knowledge_base", "read"]
