"""TLS of the server and the client, with certificates of an authority of our own."""

from __future__ import annotations

import json
import socket
import ssl
from pathlib import Path
from typing import Any

import pytest
import roslibpy
from cryptography.hazmat.primitives import serialization
from websockets.sync.client import connect as open_websocket

from mindstage.access.certificates import TlsCertificate, client_tls_context
from mindstage.bridge import LocalNode, RosbridgeClient, RosbridgeServer
from mindstage.engines import make_engine
from mindstage.engines.remote import connect as connect_engine
from mindstage.engines.remote.client import RemoteUrl
from mindstage.errors import AuthenticationError, CertificateError, ConnectionLostError, EngineUnavailableError
from mindstage.knowledge import KnowledgeBase
from mindstage.ros import RosInterface
from mindstage.simulation import Simulation
from tests.bridge.certificates import Certificates
from tests.bridge.raw_client import TIMEOUT_S


def serve(node: LocalNode, tls: TlsCertificate, **options: Any) -> RosbridgeServer:
    """A server on a free port, with the service /echo."""
    node.create_service("/echo", "test/Echo", lambda request: {"answer": "here"})
    return RosbridgeServer(node, port=0, tls=tls, **options)


# -- the server and its clients ----------------------------------------------------------------------------------------


def test_a_client_that_trusts_the_authority_calls_services(local_node: LocalNode, certificates: Certificates) -> None:
    with (
        serve(local_node, certificates.local) as server,
        RosbridgeClient(server.url, tls_authorities=certificates.authority) as client,
    ):
        assert server.url.startswith("wss://127.0.0.1:")
        client.wait_connected(TIMEOUT_S)
        assert client.call_service("/echo", timeout_s=TIMEOUT_S) == {"answer": "here"}


def test_a_certificate_of_an_unknown_authority_is_refused_at_once(
    local_node: LocalNode, certificates: Certificates
) -> None:
    with serve(local_node, certificates.local) as server, RosbridgeClient(server.url) as client:
        with pytest.raises(ConnectionLostError, match=r"its certificate is not accepted: .*; .* --tls-ca"):
            client.wait_connected(TIMEOUT_S)
        assert not client.connected
        assert server.client_count == 0


def test_a_certificate_of_another_host_is_refused(local_node: LocalNode, certificates: Certificates) -> None:
    with (
        serve(local_node, certificates.elsewhere) as server,
        RosbridgeClient(server.url, tls_authorities=certificates.authority) as client,
        pytest.raises(ConnectionLostError, match=r"not accepted: .*[Ii][Pp] address mismatch"),
    ):
        client.wait_connected(TIMEOUT_S)


def test_authorities_without_tls_are_refused(certificates: Certificates) -> None:
    with pytest.raises(CertificateError, match="connect to wss://, or give no authorities"):
        RosbridgeClient("ws://127.0.0.1:9", tls_authorities=certificates.authority)


def test_tokens_are_checked_over_tls(local_node: LocalNode, certificates: Certificates) -> None:
    with serve(local_node, certificates.local, host="0.0.0.0", token="sesame") as server:
        with (
            RosbridgeClient(server.url, token="wrong", tls_authorities=certificates.authority) as client,
            pytest.raises(AuthenticationError),
        ):
            client.wait_connected(TIMEOUT_S)
        with RosbridgeClient(server.url, token="sesame", tls_authorities=certificates.authority) as client:
            client.wait_connected(TIMEOUT_S)


@pytest.mark.filterwarnings("ignore:ssl.TLSVersion:DeprecationWarning")
def test_versions_before_tls_1_2_are_refused(local_node: LocalNode, certificates: Certificates) -> None:
    assert certificates.local.server_context().minimum_version is ssl.TLSVersion.TLSv1_2
    assert client_tls_context().minimum_version is ssl.TLSVersion.TLSv1_2
    assert client_tls_context().check_hostname
    context = client_tls_context(certificates.authority)
    context.minimum_version, context.maximum_version = ssl.TLSVersion.TLSv1, ssl.TLSVersion.TLSv1_1
    with serve(local_node, certificates.local) as server, pytest.raises((ssl.SSLError, OSError)):
        open_websocket(server.url, ssl=context, open_timeout=TIMEOUT_S)


def test_a_client_that_never_finishes_the_handshake_does_not_block_others(
    local_node: LocalNode, certificates: Certificates
) -> None:
    with serve(local_node, certificates.local) as server, socket.create_connection(("127.0.0.1", server.port)):
        context = client_tls_context(certificates.authority)
        with open_websocket(server.url, ssl=context, open_timeout=TIMEOUT_S) as client:
            client.send(json.dumps({"op": "call_service", "service": "/echo", "id": "a"}))
            assert json.loads(client.recv(TIMEOUT_S))["result"] is True


def test_roslibpy_calls_a_service_over_tls(
    local_node: LocalNode, certificates: Certificates, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Roslibpy trusts the authorities of OpenSSL, for which the environment can name a file."""
    monkeypatch.setenv("SSL_CERT_FILE", str(certificates.authority))
    with serve(local_node, certificates.local) as server:
        ros = roslibpy.Ros(host=server.url, transport="asyncio")
        try:
            ros.run(timeout=TIMEOUT_S)
            service = roslibpy.Service(ros, "/echo", "test/Echo")
            assert service.call(roslibpy.ServiceRequest(), timeout=TIMEOUT_S)["answer"] == "here"
        finally:
            ros.close()


# -- remote engines ----------------------------------------------------------------------------------------------------


def test_a_remote_engine_is_controlled_over_tls(certificates: Certificates) -> None:
    with (
        Simulation(KnowledgeBase(bundled_ontology=False), make_engine("null")) as simulation,
        LocalNode() as node,
        serve(node, certificates.local) as server,
    ):
        interface = RosInterface(simulation, node, namespace="lab")
        url = server.url.replace("wss://", "ros+tls://") + "/lab"
        try:
            with pytest.raises(EngineUnavailableError, match="its certificate is not accepted"):
                connect_engine(url, timeout_s=TIMEOUT_S)
            engine = make_engine(f"{url}?ca={certificates.authority}")
            try:
                assert engine.snapshot().bodies == ()
            finally:
                engine.close()
        finally:
            interface.close()


def test_the_address_of_an_engine_over_tls_is_printed_without_secrets(tmp_path: Path) -> None:
    address = RemoteUrl.parse(f"ros+tls://robot.example/lab?token=sesame&ca={tmp_path / 'ca.pem'}")
    assert (address.url, str(address)) == ("wss://robot.example:9090", "ros+tls://robot.example:9090/lab")
    assert address.authorities == tmp_path / "ca.pem"
    assert RemoteUrl.parse("ros://robot.example").url == "ws://robot.example:9090"


# -- files -------------------------------------------------------------------------------------------------------------


def test_each_unusable_file_is_named_with_what_to_do(certificates: Certificates, tmp_path: Path) -> None:
    good = certificates.local
    assert good.key is not None
    garbage = tmp_path / "garbage.pem"
    garbage.write_text("no certificate")
    both = tmp_path / "both.pem"
    both.write_bytes(good.certificate.read_bytes() + good.key.read_bytes())
    encrypted = tmp_path / "encrypted.key"
    key: Any = serialization.load_pem_private_key(good.key.read_bytes(), password=None)
    encryption = serialization.BestAvailableEncryption(b"secret")
    pem, pkcs8 = serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8
    encrypted.write_bytes(key.private_bytes(pem, pkcs8, encryption))
    cases = (
        (tmp_path / "none.pem", good.key, "none.pem cannot be used: No such file"),
        (good.certificate, tmp_path / "none.key", "none.key cannot be used: No such file"),
        (tmp_path, good.key, "Is a directory"),
        (good.certificate, certificates.elsewhere.key, "elsewhere.key is not that of the certificate"),
        (garbage, good.key, "garbage.pem cannot be used: it contains no certificate in PEM format"),
        (good.certificate, garbage, "garbage.pem cannot be used: it contains no private key"),
        (good.certificate, None, "it contains no private key in PEM format; give --tls-key too"),
        (good.certificate, encrypted, "encrypted.key cannot be used: the private key is encrypted; decrypt it"),
        (certificates.expired.certificate, certificates.expired.key, "certificate has expired; renew it"),
    )
    for certificate, private_key, message in cases:
        with pytest.raises(CertificateError) as refused:
            TlsCertificate(certificate=certificate, key=private_key).server_context()
        assert message in str(refused.value)
    assert TlsCertificate(certificate=both).server_context()
    with pytest.raises(CertificateError, match="it contains no certificate in PEM format"):
        client_tls_context(garbage)
    with pytest.raises(CertificateError, match="No such file"):
        client_tls_context(tmp_path / "none.pem")
