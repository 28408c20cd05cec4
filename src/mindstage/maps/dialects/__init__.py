"""Map dialects: detection of the vocabulary that a semantic map is written in, inference of conventions, readers."""

__all__: list[str] = []
