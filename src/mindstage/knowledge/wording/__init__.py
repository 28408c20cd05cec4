"""Wording: how the values of a world are said by statements, in any dialect and any syntax."""

__all__: list[str] = []
