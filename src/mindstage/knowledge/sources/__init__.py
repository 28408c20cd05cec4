"""Sources: from paths and addresses to statements, each source a graph of its own."""

__all__: list[str] = []
