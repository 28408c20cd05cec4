"""View page: viser's own page as we serve it, without its panel and with our few scripts for the picture."""

from __future__ import annotations

import gzip
import hashlib
from collections.abc import Mapping
from http import HTTPStatus

from mindstage.viewport.files import page_files
from mindstage.viewport.gate import Answer, Headers

__all__ = ["ViewPage"]

_LINKED = ("viserOverrides.css",)
_RUN = ("clippingPlane.js", "shadowBias.js")
"""Of our files, those that the picture itself needs."""


class ViewPage:
    """One file with everything in it, some megabytes; browsers keep it as long as it is the same."""

    def __init__(self, viser: bytes) -> None:
        """Viser's page as it comes with it."""
        there = page_files()
        links = [f'<link rel="stylesheet" href="/mindstage/{name}" />' for name in _LINKED if name in there]
        links += [f'<script type="module" src="/mindstage/{name}"></script>' for name in _RUN if name in there]
        self._whole = viser.replace(b"<title>", "".join(links).encode() + b"<title>", 1)
        self._small = gzip.compress(self._whole, compresslevel=6)
        self._tag = f'"{hashlib.sha256(self._whole).hexdigest()[:24]}"'

    def answer(self, headers: Headers, told: Mapping[str, str]) -> Answer:
        """The page for a request.

        Args:
            headers: of the request.
            told: headers that go with it.
        """
        told = {"Content-Type": "text/html; charset=utf-8", "ETag": self._tag, "Vary": "Accept-Encoding", **told}
        if headers.get("If-None-Match") == self._tag:
            return Answer(HTTPStatus.NOT_MODIFIED, b"", told)
        if "gzip" in (headers.get("Accept-Encoding") or ""):
            return Answer(HTTPStatus.OK, self._small, told | {"Content-Encoding": "gzip"})
        return Answer(HTTPStatus.OK, self._whole, told)
