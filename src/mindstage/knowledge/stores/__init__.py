"""Stores: where statements are kept, in memory, in a folder or elsewhere, and how they are queried."""

__all__: list[str] = []
