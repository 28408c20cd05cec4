"""Readers: one file a dialect, each turning an `SourceMap` into a `World`; `reading/dialects.py` names them."""

__all__: list[str] = []
