"""View page: viser's own page as we serve it, without its panel and with our few scripts for the picture."""

from __future__ import annotations

import gzip
import hashlib
from collections.abc import Mapping
from http import HTTPStatus

from mindstage.viewport.files import page_files
from mindstage.viewport.gate import HttpResponse, RequestHeaders

__all__ = ["ViserPage"]

_STYLESHEETS = ("viserOverrides.css",)
_SCRIPTS = ("clippingPlane.js", "shadowBias.js")
"""Of our files, those that the picture itself needs."""


class ViserPage:
    """One file with everything in it, some megabytes; browsers keep it as long as it is the same."""

    def __init__(self, viser: bytes) -> None:
        """Viser's page as it comes with it."""
        there = page_files()
        links = [f'<link rel="stylesheet" href="/mindstage/{name}" />' for name in _STYLESHEETS if name in there]
        links += [f'<script type="module" src="/mindstage/{name}"></script>' for name in _SCRIPTS if name in there]
        self._page = viser.replace(b"<title>", "".join(links).encode() + b"<title>", 1)
        self._compressed = gzip.compress(self._page, compresslevel=6)
        self._etag = f'"{hashlib.sha256(self._page).hexdigest()[:24]}"'

    def answer(self, headers: RequestHeaders, request_headers: Mapping[str, str]) -> HttpResponse:
        """The page for a request.

        Args:
            headers: of the request.
            told: headers that go with it.
        """
        request_headers = {
            "Content-Type": "text/html; charset=utf-8",
            "ETag": self._etag,
            "Vary": "Accept-Encoding",
            **request_headers,
        }
        if headers.get("If-None-Match") == self._etag:
            return HttpResponse(HTTPStatus.NOT_MODIFIED, b"", request_headers)
        if "gzip" in (headers.get("Accept-Encoding") or ""):
            return HttpResponse(HTTPStatus.OK, self._compressed, request_headers | {"Content-Encoding": "gzip"})
        return HttpResponse(HTTPStatus.OK, self._page, request_headers)
