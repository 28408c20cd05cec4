"""The page over TLS: in a real browser, and at the command line."""

from __future__ import annotations

import base64
import hashlib
import http.client
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import serialization
from playwright.sync_api import Error
from typer.testing import CliRunner

from mindstage.access.certificates import TlsCertificate, client_tls_context
from mindstage.access.gate import Gate
from mindstage.access.limits import VisitorLimits
from mindstage.cli.app import app
from mindstage.engines import NullEngine
from mindstage.knowledge import KnowledgeBase
from mindstage.simulation import Simulation
from mindstage.viewer import Viewer
from mindstage.viewer.http import RequestFilter
from tests.bridge.certificates import Certificates, certificates
from tests.cases import each_case

__all__ = ["certificates"]

TIMEOUT_S = 120.0


@pytest.fixture
def secure_viewer(certificates: Certificates) -> Iterator[Viewer]:
    with (
        Simulation(KnowledgeBase(), NullEngine()) as simulation,
        Viewer(simulation, port=0, token="sesame", tls=certificates.local) as viewer,
    ):
        yield viewer


def fingerprint(tls: TlsCertificate) -> str:
    """The hash of the public key, as the option of Chromium has it."""
    certificate = x509.load_pem_x509_certificate(tls.certificate.read_bytes())
    der, info = serialization.Encoding.DER, serialization.PublicFormat.SubjectPublicKeyInfo
    return base64.b64encode(hashlib.sha256(certificate.public_key().public_bytes(der, info)).digest()).decode()


def test_a_browser_that_trusts_the_certificate_opens_the_page(
    secure_viewer: Viewer, certificates: Certificates, chromium: Path, browser: Any
) -> None:
    assert secure_viewer.url.startswith("https://127.0.0.1:")
    arguments = ["--no-sandbox", "--no-proxy-server"]
    trusting = [*arguments, f"--ignore-certificate-errors-spki-list={fingerprint(certificates.local)}"]
    trusting_browser = browser.browser_type.launch(executable_path=chromium, args=trusting)
    page = trusting_browser.new_page()
    messages: list[str] = []
    page.on("console", lambda message: messages.append(message.text))
    page.goto(f"{secure_viewer.url}/?token=sesame", timeout=TIMEOUT_S * 1000)
    page.wait_for_function("window.mindstage?.clientKey", timeout=TIMEOUT_S * 1000)
    assert page.evaluate("location.protocol") == "https:"
    (cookie,) = page.context.cookies()
    assert (cookie["secure"], cookie["httpOnly"]) == (True, True)
    assert len(secure_viewer.channel.sessions) == 1
    trusting_browser.close()
    wary = browser.browser_type.launch(executable_path=chromium, args=arguments)
    with pytest.raises(Error, match="ERR_CERT_AUTHORITY_INVALID"):
        wary.new_page().goto(secure_viewer.url, timeout=TIMEOUT_S * 1000)
    wary.close()


def test_wrong_tokens_of_the_page_are_limited_and_the_cookie_is_not() -> None:
    request_filter = RequestFilter(
        Gate(host="0.0.0.0", token="sesame", secure=True, limits=VisitorLimits(failed_tokens_per_minute=2))
    )
    visitor = request_filter.gate.visitors.visitor(("192.0.2.7", 1))
    headers = {"Host": "robot.local"}

    def status(path: str, now_s: float, **more: str) -> int:
        answer = request_filter.respond(path, headers | more, visitor=visitor, now_s=now_s)
        assert answer is not None
        return int(answer.status)

    redirect = request_filter.respond("/?token=sesame", headers, visitor=visitor, now_s=0.0)
    assert redirect is not None
    assert "; Secure" in redirect.headers["Set-Cookie"]
    cookie = redirect.headers["Set-Cookie"].partition(";")[0]
    assert [status(f"/?token={token}", 0.0) for token in ("a", "b", "c", "sesame")] == [401, 401, 429, 429]
    assert status("/", 0.0, Cookie=cookie) == 200
    assert status("/?token=sesame", 60.0) == 303
    for token, expected in (("x", 401), ("y", 401), ("z", 429), ("sesame", 429)):
        path = f"/mindstage/channel?token={token}"
        refusal = request_filter.socket_error(path, headers, visitor=visitor, now_s=120.0)
        assert refusal is not None
        assert int(refusal.status) == expected


def test_the_command_line_serves_both_ports_over_tls(certificates: Certificates) -> None:
    tls = certificates.local
    command = [sys.executable, "-m", "mindstage", "serve", "--engine", "null", "--viewer", "--json", "--port", "0"]
    command += ["--viewer-port", "0", "--tls-cert", str(tls.certificate), "--tls-key", str(tls.key)]
    command += ["--limit", "connections=8"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            text = ""
            for line in iter(process.stdout.readline, "}\n"):
                assert line, "the process exited"
                text += line
            output = json.loads(text + "}")
            assert output["url"].startswith("wss://")
            host = output["viewer"].removeprefix("https://")
            context = client_tls_context(certificates.authority)
            connection = http.client.HTTPSConnection(host, context=context, timeout=TIMEOUT_S)
            connection.request("GET", "/")
            assert b"Mindstage" in connection.getresponse().read()
            connection.close()
        finally:
            process.terminate()
            process.wait(TIMEOUT_S)


@each_case(
    ("arguments", "message"),
    [
        (("--tls-key", "key.pem"), "--tls-key: it requires --tls-cert"),
        (("--tls-cert", "none.pem"), "none.pem cannot be used: No such file"),
        (("--limit", "speed=1"), "there is no limit 'speed'; the limits are connections, messages_per_second"),
        (("--limit", "connections=many"), "write NAME=NUMBER"),
        (("--limit", "connections=0"), "Expected `int` >= 1 - at `$.connections`"),
        (("--tls-ca", "ca.pem"), "it requires --connect"),
    ],
)
def test_wrong_options_are_refused_before_anything_is_loaded(arguments: tuple[str, ...], message: str) -> None:
    done = CliRunner().invoke(app, ["serve", "no-such-map.owl", "--engine", "null", *arguments], prog_name="mindstage")
    assert done.exit_code == 2
    assert message in done.stderr
