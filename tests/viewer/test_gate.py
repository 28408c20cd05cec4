"""Who may come to the page, judged by the path and the headers alone."""

from __future__ import annotations

from http import HTTPStatus

import pytest

from mindstage.errors import AuthenticationError
from mindstage.viewer.http import RequestFilter, view_key

HOME = {"Host": "127.0.0.1:8080"}
VIEW = "/view/0123456789abcdef"
CHANNEL = "/mindstage/channel?client=0123456789abcdef"


@pytest.fixture
def gate() -> RequestFilter:
    return RequestFilter(host="127.0.0.1")


@pytest.fixture
def guarded() -> RequestFilter:
    return RequestFilter(host="0.0.0.0", token="sesame")


def status(gate: RequestFilter, path: str, headers: dict[str, str]) -> HTTPStatus | None:
    answer = gate.respond(path, headers)
    return None if answer is None else answer.status


def socket_status(gate: RequestFilter, path: str, headers: dict[str, str]) -> HTTPStatus | None:
    refusal = gate.socket_error(path, headers)
    return None if refusal is None else refusal.status


# -- names -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("host", ["127.0.0.1:8080", "localhost:8080", "[::1]:8080", "LOCALHOST", "127.0.0.2"])
def test_this_machine_is_known_by_its_own_names(gate: RequestFilter, host: str) -> None:
    assert status(gate, "/", {"Host": host}) == HTTPStatus.OK


@pytest.mark.parametrize(
    "host",
    ["evil.example", "evil.example:8080", "127.0.0.1.evil.example", "192.168.1.7:8080", "", "a b", "x/y", "[::1"],
)
def test_a_name_that_somebody_let_point_here_is_refused(gate: RequestFilter, host: str) -> None:
    assert status(gate, "/", {"Host": host}) == HTTPStatus.MISDIRECTED_REQUEST
    assert socket_status(gate, CHANNEL, {"Host": host}) == HTTPStatus.MISDIRECTED_REQUEST


def test_a_request_without_a_host_is_refused(gate: RequestFilter) -> None:
    assert status(gate, "/", {}) == HTTPStatus.MISDIRECTED_REQUEST


def test_a_name_that_was_allowed_is_known() -> None:
    gate = RequestFilter(host="127.0.0.1", origins=["https://robot.example/"])
    assert status(gate, "/", {"Host": "robot.example"}) == HTTPStatus.OK
    assert socket_status(gate, CHANNEL, {"Host": "robot.example", "Origin": "https://robot.example"}) is None
    assert status(gate, "/", {"Host": "other.example"}) == HTTPStatus.MISDIRECTED_REQUEST


# -- origins -----------------------------------------------------------------------------------------------------------


def test_our_own_page_may_open_sockets_and_so_may_programs(gate: RequestFilter) -> None:
    for path in (CHANNEL, VIEW):
        assert socket_status(gate, path, HOME | {"Origin": "http://127.0.0.1:8080"}) is None
        assert socket_status(gate, path, HOME) is None


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
def test_a_page_from_anywhere_else_may_not_open_a_socket(gate: RequestFilter, origin: str) -> None:
    for path in (CHANNEL, VIEW, "/"):
        assert socket_status(gate, path, HOME | {"Origin": origin}) == HTTPStatus.FORBIDDEN


def test_a_page_from_elsewhere_may_link_to_the_page_and_load_nothing_of_it(gate: RequestFilter) -> None:
    foreign = HOME | {"Sec-Fetch-Site": "cross-site"}
    assert status(gate, "/", foreign) == HTTPStatus.OK
    assert status(gate, "/mindstage/main.js", foreign) == HTTPStatus.FORBIDDEN
    assert status(gate, VIEW, foreign) == HTTPStatus.FORBIDDEN


# -- tokens ------------------------------------------------------------------------------------------------------------


def test_others_than_this_machine_are_served_only_with_a_token() -> None:
    for token in (None, ""):
        with pytest.raises(AuthenticationError, match="token"):
            RequestFilter(host="0.0.0.0", token=token)


def test_without_the_token_nothing_is_had(guarded: RequestFilter) -> None:
    headers = {"Host": "robot.local:8080"}
    for path in ("/", "/mindstage/main.js", VIEW, "/?token=", "/?token=sesam", "/mindstage/main.js?token=Sesame"):
        assert status(guarded, path, headers) == HTTPStatus.UNAUTHORIZED, path
    for path in (CHANNEL, VIEW, f"{CHANNEL}&token=wrong"):
        assert socket_status(guarded, path, headers) == HTTPStatus.UNAUTHORIZED, path
    assert socket_status(guarded, CHANNEL, headers | {"Authorization": "Bearer wrong"}) == HTTPStatus.UNAUTHORIZED
    assert socket_status(guarded, CHANNEL, headers | {"Cookie": "mindstage=wrong"}) == HTTPStatus.UNAUTHORIZED
    assert socket_status(guarded, CHANNEL, headers | {"Cookie": "mindstage=\xe9"}) == HTTPStatus.UNAUTHORIZED


def test_a_person_is_asked_for_the_token(guarded: RequestFilter) -> None:
    answer = guarded.respond("/", {"Host": "robot.local"})
    assert answer is not None
    assert b'name="token"' in answer.body
    assert b"sesame" not in answer.body


def test_a_token_in_the_address_becomes_a_cookie_that_scripts_cannot_see(guarded: RequestFilter) -> None:
    headers = {"Host": "robot.local:8080"}
    answer = guarded.respond("/?token=sesame&fixedDpr=1", headers)
    assert answer is not None
    assert answer.status == HTTPStatus.SEE_OTHER
    assert answer.headers["Location"] == "/?fixedDpr=1"
    cookie = answer.headers["Set-Cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    assert "sesame" not in cookie
    known = headers | {"Cookie": f"other=1; {cookie.partition(';')[0]}"}
    assert status(guarded, "/", known) == HTTPStatus.OK
    assert status(guarded, VIEW, known) is None
    assert socket_status(guarded, CHANNEL, known | {"Origin": "http://robot.local:8080"}) is None
    assert socket_status(guarded, CHANNEL, known | {"Origin": "http://evil.example"}) == HTTPStatus.FORBIDDEN


def test_a_program_shows_the_token_with_each_request(guarded: RequestFilter) -> None:
    bearer = {"Host": "robot.local", "Authorization": "Bearer sesame"}
    assert status(guarded, "/mindstage/main.js", bearer) == HTTPStatus.OK
    assert socket_status(guarded, CHANNEL, bearer) is None
    assert socket_status(guarded, f"{CHANNEL}&token=sesame", {"Host": "robot.local"}) is None


# -- paths -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "path",
    [
        "/mindstage/../gate.py",
        "/mindstage/..%2fgate.py",
        "/mindstage/%2e%2e/gate.py",
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
def test_there_is_nothing_but_the_files_of_the_page(gate: RequestFilter, path: str) -> None:
    assert status(gate, path, HOME) == HTTPStatus.NOT_FOUND


def test_a_socket_leads_to_the_channel_or_to_a_view(gate: RequestFilter) -> None:
    for path in ("/", "/mindstage/main.js", "/view/x"):
        assert socket_status(gate, path, HOME) == HTTPStatus.NOT_FOUND


def test_a_view_tells_whose_it_is() -> None:
    assert view_key(f"{VIEW}/?fixedDpr=1") == "0123456789abcdef"
    assert view_key("/view/0123456789abcdef/more") is None


def test_every_answer_forbids_what_a_page_does_not_need(gate: RequestFilter) -> None:
    answer = gate.respond("/", HOME)
    assert answer is not None
    policy = answer.headers["Content-Security-Policy"]
    assert "script-src 'self';" in policy
    assert "frame-ancestors 'none'" in policy
    assert "unsafe" not in policy
    assert answer.headers["X-Content-Type-Options"] == "nosniff"
    assert "frame-ancestors 'self'" in gate.view_headers(HOME)["Content-Security-Policy"]


def test_a_file_that_a_browser_has_already_is_not_sent_again(gate: RequestFilter) -> None:
    answer = gate.respond("/mindstage/main.js", HOME)
    assert answer is not None
    again = gate.respond("/mindstage/main.js", HOME | {"If-None-Match": answer.headers["ETag"]})
    assert again is not None
    assert (again.status, again.body) == (HTTPStatus.NOT_MODIFIED, b"")
