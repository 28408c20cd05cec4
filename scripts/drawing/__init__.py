"""Drawing: pictures of forms without a screen, a GPU or a browser."""

from __future__ import annotations

__all__: list[str] = []
