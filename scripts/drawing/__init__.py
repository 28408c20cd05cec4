"""Images of body geometry without a display, GPU or browser."""

from __future__ import annotations

__all__: list[str] = []
