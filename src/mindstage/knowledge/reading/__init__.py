"""Reading: which dialect a map is in, how its numbers are meant, and who lives in it."""

__all__: list[str] = []
