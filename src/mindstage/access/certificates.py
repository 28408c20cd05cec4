"""Certificates for TLS: of servers, and of the authorities that clients trust."""

from __future__ import annotations

import ssl
from pathlib import Path

import msgspec

from mindstage.errors import CertificateError

__all__ = ["TlsCertificate", "client_tls_context"]


class TlsCertificate(msgspec.Struct, frozen=True, kw_only=True):
    """The certificate that a server shows its clients, with its private key; files in PEM format."""

    certificate: Path
    """The certificate, followed by those of the authorities in between, if there are any."""
    key: Path | None = None
    """The private key, without a password; None if it is in the file of the certificate."""

    def server_context(self) -> ssl.SSLContext:
        """Loads the files: TLS 1.2 or newer.

        Raises:
            CertificateError: a file is missing, is not in that format or is encrypted, the key is not that of the
                certificate, or the certificate has expired.
        """
        for path in (self.certificate, self.key or self.certificate):
            _require_readable(path)
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.minimum_version = ssl.TLSVersion.TLSv1_2
        try:
            context.load_cert_chain(self.certificate, self.key, password=self._refuse_password)
        except ssl.SSLError as error:
            raise self._load_error(error) from error
        if problem := _validity_problem(context, self.certificate):
            raise CertificateError(str(self.certificate), cause=problem, remedy="renew it")
        return context

    def _refuse_password(self) -> str:
        remedy = "decrypt it, for example with: openssl pkey -in ENCRYPTED -out KEY"
        raise CertificateError(str(self.key or self.certificate), cause="the private key is encrypted", remedy=remedy)

    def _load_error(self, error: ssl.SSLError) -> CertificateError:
        if error.reason == "KEY_VALUES_MISMATCH":
            cause = f"the key in {self.key or self.certificate} is not that of the certificate"
            return CertificateError(str(self.certificate), cause=cause, remedy="give the key it was issued for")
        problems = (
            (self.certificate, "CERTIFICATE", "it contains no certificate in PEM format"),
            (self.key or self.certificate, "PRIVATE KEY", "it contains no private key in PEM format"),
        )
        for path, marker, cause in problems:
            if f"{marker}-----".encode() not in path.read_bytes():
                remedy = "give --tls-key too" if marker != "CERTIFICATE" and self.key is None else "convert it to PEM"
                return CertificateError(str(path), cause=cause, remedy=remedy)
        cause = f"it cannot be loaded ({error.reason or error})"
        return CertificateError(str(self.certificate), cause=cause, remedy="check it with: openssl x509 -in FILE -text")


def client_tls_context(authorities: Path | None = None) -> ssl.SSLContext:
    """The context of a client: TLS 1.2 or newer, and certificates and host names of servers are always checked.

    Args:
        authorities: certificates of further authorities, or of one server, in PEM format; those of the system are
            trusted too.

    Raises:
        CertificateError: the file is missing or contains no certificate.
    """
    context = ssl.create_default_context()
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    if authorities is not None:
        _require_readable(authorities)
        try:
            context.load_verify_locations(authorities)
        except ssl.SSLError as error:
            cause = "it contains no certificate in PEM format"
            raise CertificateError(
                str(authorities), cause=cause, remedy="give the certificate of the authority"
            ) from error
    return context


def _require_readable(path: Path) -> None:
    try:
        with path.open("rb"):
            pass
    except OSError as error:
        cause = error.strerror or str(error)
        raise CertificateError(
            str(path), cause=cause, remedy="give the path of a readable file in PEM format"
        ) from error


def _validity_problem(server: ssl.SSLContext, certificate: Path) -> str:
    """Why the certificate is not valid today; empty if it is.

    A handshake in memory checks it, since the standard library does not read a certificate otherwise.
    """
    client = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    client.check_hostname = False
    client.load_verify_locations(certificate)
    client.verify_flags |= ssl.VERIFY_X509_PARTIAL_CHAIN  # the certificate itself is the trust anchor
    to_server, to_client = ssl.MemoryBIO(), ssl.MemoryBIO()
    ends = (
        client.wrap_bio(to_client, to_server, server_hostname="unchecked"),
        server.wrap_bio(to_server, to_client, server_side=True),
    )
    for _ in range(4):
        for end in ends:
            try:
                end.do_handshake()
            except ssl.SSLWantReadError:
                continue
            except ssl.SSLCertVerificationError as error:
                return (
                    error.verify_message if "expired" in error.verify_message or "valid" in error.verify_message else ""
                )
            except ssl.SSLError:
                return ""
    return ""
