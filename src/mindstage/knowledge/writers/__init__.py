"""Writers: statements of a world in other words than dialect 1's, each dialect in a file of its own."""

__all__: list[str] = []
