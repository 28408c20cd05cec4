"""Prolog: a console where every question is a predicate."""

__all__: list[str] = []
