"""The request filter: hosts, origins and tokens."""

from __future__ import annotations

from http import HTTPStatus

import pytest

from mindstage.access.gate import Gate
from mindstage.errors import AuthenticationError
from mindstage.textures import TextureMap
from mindstage.viewer.http import RequestFilter, is_texture_path, texture_path, view_key

HOME = {"Host": "127.0.0.1:8080"}
VIEW = "/view/0123456789abcdef"
CHANNEL = "/mindstage/channel?client=0123456789abcdef"


@pytest.fixture
def request_filter() -> RequestFilter:
    return RequestFilter(Gate(host="127.0.0.1"))


@pytest.fixture
def token_filter() -> RequestFilter:
    return RequestFilter(Gate(host="0.0.0.0", token="sesame"))


def status(request_filter: RequestFilter, path: str, headers: dict[str, str]) -> HTTPStatus | None:
    answer = request_filter.respond(path, headers)
    return None if answer is None else answer.status


def socket_status(request_filter: RequestFilter, path: str, headers: dict[str, str]) -> HTTPStatus | None:
    refusal = request_filter.socket_error(path, headers)
    return None if refusal is None else refusal.status


# -- names -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("host", ["127.0.0.1:8080", "localhost:8080", "[::1]:8080", "LOCALHOST", "127.0.0.2"])
def test_host_names_of_this_machine_are_allowed(request_filter: RequestFilter, host: str) -> None:
    assert status(request_filter, "/", {"Host": host}) == HTTPStatus.OK


@pytest.mark.parametrize(
    "host",
    ["evil.example", "evil.example:8080", "127.0.0.1.evil.example", "192.168.1.7:8080", "", "a b", "x/y", "[::1"],
)
def test_foreign_host_names_are_refused(request_filter: RequestFilter, host: str) -> None:
    assert status(request_filter, "/", {"Host": host}) == HTTPStatus.MISDIRECTED_REQUEST
    assert socket_status(request_filter, CHANNEL, {"Host": host}) == HTTPStatus.MISDIRECTED_REQUEST


def test_a_request_without_a_host_is_refused(request_filter: RequestFilter) -> None:
    assert status(request_filter, "/", {}) == HTTPStatus.MISDIRECTED_REQUEST


def test_configured_origins_are_allowed() -> None:
    request_filter = RequestFilter(Gate(host="127.0.0.1", origins=["https://robot.example/"]))
    assert status(request_filter, "/", {"Host": "robot.example"}) == HTTPStatus.OK
    assert socket_status(request_filter, CHANNEL, {"Host": "robot.example", "Origin": "https://robot.example"}) is None
    assert status(request_filter, "/", {"Host": "other.example"}) == HTTPStatus.MISDIRECTED_REQUEST


# -- origins -----------------------------------------------------------------------------------------------------------


def test_the_own_page_and_programs_may_open_websockets(request_filter: RequestFilter) -> None:
    for path in (CHANNEL, VIEW):
        assert socket_status(request_filter, path, HOME | {"Origin": "http://127.0.0.1:8080"}) is None
        assert socket_status(request_filter, path, HOME) is None


@pytest.mark.parametrize(
    "origin",
    [
        "http://evil.example",
        "http://127.0.0.1:9999",
        "http://localhost:8080",
        "null",
        "",
        "http://127.0.0.1:8080.evil.example",
        "http://[",
        "file://",
    ],
)
def test_pages_of_other_origins_may_not_open_websockets(request_filter: RequestFilter, origin: str) -> None:
    for path in (CHANNEL, VIEW, "/"):
        assert socket_status(request_filter, path, HOME | {"Origin": origin}) == HTTPStatus.FORBIDDEN


def test_other_sites_may_link_to_the_page_but_not_load_its_files(request_filter: RequestFilter) -> None:
    foreign = HOME | {"Sec-Fetch-Site": "cross-site"}
    assert status(request_filter, "/", foreign) == HTTPStatus.OK
    assert status(request_filter, "/mindstage/main.js", foreign) == HTTPStatus.FORBIDDEN
    assert status(request_filter, VIEW, foreign) == HTTPStatus.FORBIDDEN


# -- tokens ------------------------------------------------------------------------------------------------------------


def test_serving_other_machines_requires_a_token() -> None:
    for token in (None, ""):
        with pytest.raises(AuthenticationError, match="token"):
            RequestFilter(Gate(host="0.0.0.0", token=token))


def test_without_the_token_everything_is_refused(token_filter: RequestFilter) -> None:
    headers = {"Host": "robot.local:8080"}
    for path in ("/", "/mindstage/main.js", VIEW, "/?token=", "/?token=sesam", "/mindstage/main.js?token=Sesame"):
        assert status(token_filter, path, headers) == HTTPStatus.UNAUTHORIZED, path
    for path in (CHANNEL, VIEW, f"{CHANNEL}&token=wrong"):
        assert socket_status(token_filter, path, headers) == HTTPStatus.UNAUTHORIZED, path
    assert socket_status(token_filter, CHANNEL, headers | {"Authorization": "Bearer wrong"}) == HTTPStatus.UNAUTHORIZED
    assert socket_status(token_filter, CHANNEL, headers | {"Cookie": "mindstage=wrong"}) == HTTPStatus.UNAUTHORIZED
    assert socket_status(token_filter, CHANNEL, headers | {"Cookie": "mindstage=\xe9"}) == HTTPStatus.UNAUTHORIZED


def test_a_browser_without_the_token_gets_the_sign_in_page(token_filter: RequestFilter) -> None:
    answer = token_filter.respond("/", {"Host": "robot.local"})
    assert answer is not None
    assert b'name="token"' in answer.body
    assert b"sesame" not in answer.body


def test_a_token_in_the_address_becomes_a_cookie_that_scripts_cannot_see(token_filter: RequestFilter) -> None:
    headers = {"Host": "robot.local:8080"}
    answer = token_filter.respond("/?token=sesame&fixedDpr=1", headers)
    assert answer is not None
    assert answer.status == HTTPStatus.SEE_OTHER
    assert answer.headers["Location"] == "/?fixedDpr=1"
    cookie = answer.headers["Set-Cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    assert "sesame" not in cookie
    known = headers | {"Cookie": f"other=1; {cookie.partition(';')[0]}"}
    assert status(token_filter, "/", known) == HTTPStatus.OK
    assert status(token_filter, VIEW, known) is None
    assert socket_status(token_filter, CHANNEL, known | {"Origin": "http://robot.local:8080"}) is None
    assert socket_status(token_filter, CHANNEL, known | {"Origin": "http://evil.example"}) == HTTPStatus.FORBIDDEN


def test_programs_send_the_token_with_each_request(token_filter: RequestFilter) -> None:
    bearer = {"Host": "robot.local", "Authorization": "Bearer sesame"}
    assert status(token_filter, "/mindstage/main.js", bearer) == HTTPStatus.OK
    assert socket_status(token_filter, CHANNEL, bearer) is None
    assert socket_status(token_filter, f"{CHANNEL}&token=sesame", {"Host": "robot.local"}) is None


# -- paths -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "path",
    [
        "/mindstage/../request_filter.py",
        "/mindstage/..%2fgate.py",
        "/mindstage/%2e%2e/request_filter.py",
        "/mindstage//etc/passwd",
        "/mindstage/",
        "/mindstage",
        "/etc/passwd",
        "/../../etc/passwd",
        "/view/../../etc/passwd",
        "/view/short",
        "/view/UPPERCASE0000",
        "/index.html",
        "//evil.example/",
    ],
)
def test_only_files_of_the_page_are_served(request_filter: RequestFilter, path: str) -> None:
    assert status(request_filter, path, HOME) == HTTPStatus.NOT_FOUND


def test_websockets_exist_for_the_channel_and_for_views_only(request_filter: RequestFilter) -> None:
    for path in ("/", "/mindstage/main.js", "/view/x"):
        assert socket_status(request_filter, path, HOME) == HTTPStatus.NOT_FOUND


def test_the_path_of_a_view_contains_the_session_key() -> None:
    assert view_key(f"{VIEW}/?fixedDpr=1") == "0123456789abcdef"
    assert view_key("/view/0123456789abcdef/more") is None


def test_every_response_has_security_headers(request_filter: RequestFilter) -> None:
    answer = request_filter.respond("/", HOME)
    assert answer is not None
    policy = answer.headers["Content-Security-Policy"]
    assert "script-src 'self';" in policy
    assert "frame-ancestors 'none'" in policy
    assert "unsafe" not in policy
    assert answer.headers["X-Content-Type-Options"] == "nosniff"
    assert "frame-ancestors 'self'" in request_filter.view_headers(HOME)["Content-Security-Policy"]


def test_a_cached_file_is_not_sent_again(request_filter: RequestFilter) -> None:
    answer = request_filter.respond("/mindstage/main.js", HOME)
    assert answer is not None
    again = request_filter.respond("/mindstage/main.js", HOME | {"If-None-Match": answer.headers["ETag"]})
    assert again is not None
    assert (again.status, again.body) == (HTTPStatus.NOT_MODIFIED, b"")


# -- textures ----------------------------------------------------------------------------------------------------------


def test_textures_are_images_that_browsers_keep(request_filter: RequestFilter, token_filter: RequestFilter) -> None:
    path = texture_path("oak_board", TextureMap.COLOR)
    assert path is not None
    assert is_texture_path(path)
    answer = request_filter.respond(path, HOME)
    assert answer is not None
    assert answer.headers["Content-Type"] == "image/jpeg"
    assert "immutable" in answer.headers["Cache-Control"]
    assert answer.body[:2] == b"\xff\xd8"
    assert len(answer.body) < 64_000
    assert status(token_filter, path, HOME) == HTTPStatus.UNAUTHORIZED
    for unknown in (path.replace("oak", "gold"), path.replace("color", "height"), "/mindstage/textures/../main.js"):
        assert status(request_filter, unknown, HOME) == HTTPStatus.NOT_FOUND
