"""Endpoints: servers that answer SPARQL 1.1's protocol over HTTP.

Every request has a time in which it must be done whole, and every reply a size that it must not pass. Nobody but the
address that was given is ever spoken to: no proxy, no redirection.
"""

from __future__ import annotations

import base64
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING
from urllib.parse import SplitResult, unquote, urlencode, urlsplit, urlunsplit

from mindstage.errors import EndpointError, EndpointUnreachableError, InvalidArgumentError
from mindstage.knowledge.stores.query_process import REPLY_LIMIT

if TYPE_CHECKING:
    import http.client  # it loads ssl and email, which is worth waiting for only where there is an endpoint

__all__ = ["JSON_RESULTS", "N_TRIPLES", "HttpReply", "SparqlEndpoint"]

JSON_RESULTS = "application/sparql-results+json"
N_TRIPLES = "application/n-triples"

_CHUNK_SIZE = 256 * 1024
_MAX_SHOWN = 300
"""Letters of a server's own words that an error repeats."""


class HttpReply:
    """What a server said yes with."""

    def __init__(self, media_type: str, body: bytes) -> None:
        self.media_type = media_type
        """Its media type, without parameters."""
        self.body = body


class SparqlEndpoint:
    """One server's address; a connection lives as long as a request."""

    def __init__(self, url: str, *, update_url: str | None = None, timeout_s: float = 30.0) -> None:
        """Takes addresses; nothing is sent yet.

        Args:
            url: where queries go, such as `http://localhost:7878/query`; it may hold a user's name and password.
            update_url: where changes go; by default beside `query` or `sparql` as `update`, else the same address.
            timeout_s: how long any request may take [s].

        Raises:
            InvalidArgumentError: it is no address of HTTP.
        """
        self._url_parts = _parse_url(url)
        self._update_url_parts = _parse_url(update_url) if update_url else _update_url(self._url_parts)
        self.timeout_s = timeout_s

    def __str__(self) -> str:
        return _redacted_url(self._url_parts)

    def query(
        self, query: str, *, accept: str = f"{JSON_RESULTS}, {N_TRIPLES}", timeout_s: float | None = None
    ) -> HttpReply:
        """Puts a query to the server.

        Raises:
            EndpointUnreachableError: nobody answers there, or not in time.
            EndpointError: the server says no, or too much.
        """
        return self._post(self._url_parts, {"query": query}, accept, timeout_s or self.timeout_s)

    def update(self, update: str) -> None:
        """Has the server change what it keeps, which not every one allows.

        Raises:
            EndpointUnreachableError: nobody answers there, or not in time.
            EndpointError: the server says no.
        """
        self._post(self._update_url_parts, {"update": update}, "*/*", self.timeout_s)

    def _post(self, url_parts: SplitResult, form: Mapping[str, str], accept: str, timeout_s: float) -> HttpReply:
        from http.client import HTTPException

        deadline = time.monotonic() + timeout_s
        connection = _connection(url_parts, timeout_s)
        headers = {"Accept": accept, "Content-Type": "application/x-www-form-urlencoded", "User-Agent": "mindstage"}
        if url_parts.username is not None:
            user = f"{unquote(url_parts.username)}:{unquote(url_parts.password or '')}"
            headers["Authorization"] = f"Basic {base64.b64encode(user.encode()).decode('ascii')}"
        try:
            target = urlunsplit(("", "", url_parts.path or "/", url_parts.query, ""))
            connection.request("POST", target, urlencode(form).encode("ascii"), headers)
            _set_deadline(deadline, connection)
            response = connection.getresponse()
            kind = response.headers.get_content_type()
            limit = REPLY_LIMIT if response.status < 300 else _CHUNK_SIZE
            body = _read(response, connection, deadline, limit)
        except TimeoutError as error:
            raise EndpointUnreachableError(
                _redacted_url(url_parts), cause=f"no answer within {timeout_s:g} s"
            ) from error
        except (OSError, HTTPException) as error:
            raise EndpointUnreachableError(_redacted_url(url_parts), cause=_error_cause(error)) from error
        finally:
            connection.close()
        if len(body) > limit and limit == REPLY_LIMIT:
            cause = f"the reply is larger than {REPLY_LIMIT // 1024**2} MiB"
            raise EndpointError(_redacted_url(url_parts), cause=cause, remedy="ask for less")
        if not 200 <= response.status < 300:
            raise _http_error(url_parts, response, body)
        return HttpReply(kind, body)


def _read(
    response: http.client.HTTPResponse, connection: http.client.HTTPConnection, deadline: float, limit: int
) -> bytes:
    """The body, or a little more than is allowed of it."""
    from http.client import IncompleteRead

    body = bytearray()
    while len(body) <= limit:
        _set_deadline(deadline, connection)
        piece = response.read1(_CHUNK_SIZE)
        if not piece:
            break
        body += piece
    if response.length:
        raise IncompleteRead(bytes(body[:0]), response.length)
    return bytes(body)


def _set_deadline(deadline: float, connection: http.client.HTTPConnection) -> None:
    left = deadline - time.monotonic()
    if left <= 0:
        raise TimeoutError
    if connection.sock is not None:  # else the server has said that this is all, and closed it
        connection.sock.settimeout(left)


def _connection(url_parts: SplitResult, timeout_s: float) -> http.client.HTTPConnection:
    import ssl
    from http.client import HTTPConnection, HTTPSConnection

    host = url_parts.hostname or ""
    if url_parts.scheme == "https":
        return HTTPSConnection(host, url_parts.port, timeout=timeout_s, context=ssl.create_default_context())
    return HTTPConnection(host, url_parts.port, timeout=timeout_s)


def _parse_url(url: str) -> SplitResult:
    remedy = "give one such as http://localhost:7878/query"
    try:
        parts = urlsplit(url)
        if parts.scheme in {"http", "https"} and parts.hostname and parts.port != 0:
            return parts
    except ValueError as error:
        raise InvalidArgumentError("the endpoint", cause=str(error), remedy=remedy) from error
    raise InvalidArgumentError(f"the endpoint {url!r}", cause="it is no address of HTTP", remedy=remedy)


def _update_url(url_parts: SplitResult) -> SplitResult:
    before, slash, last = url_parts.path.rpartition("/")
    return url_parts._replace(path=f"{before}{slash}update") if last in {"query", "sparql"} else url_parts


def _redacted_url(url_parts: SplitResult) -> str:
    """An address without what is secret in it."""
    return urlunsplit(url_parts._replace(netloc=url_parts.netloc.rpartition("@")[2]))


def _http_error(url_parts: SplitResult, response: http.client.HTTPResponse, body: bytes) -> EndpointError:
    where = response.headers.get("Location")
    words = " ".join(body.decode("utf-8", "replace").split())[:_MAX_SHOWN]
    remedy = {
        401: "give a name and password in the address: http://NAME:PASSWORD@HOST/…",
        403: "the server does not let you; ask whoever runs it",
        404: "is that the address where it takes SPARQL?",
        405: "is that the address where it takes SPARQL, and does it allow that?",
    }.get(response.status, f"it points to {where}; give that address, if you trust it" if where else "")
    cause = f"{response.status} {response.reason}" + (f": {words}" if words and words != response.reason else "")
    return EndpointError(_redacted_url(url_parts), cause=cause, remedy=remedy, status=response.status)


def _error_cause(error: Exception) -> str:
    from http.client import HTTPException, IncompleteRead

    if isinstance(error, IncompleteRead):
        return "the connection ended in the middle of the reply"
    if isinstance(error, HTTPException):
        return f"it does not speak HTTP ({type(error).__name__})"
    return (error.strerror if isinstance(error, OSError) else None) or str(error) or type(error).__name__
