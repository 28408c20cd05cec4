"""Who may connect, over what, and how often: certificates, and limits of what one visitor may use.

A visitor is a network address, for IPv6 a network of 64 bits. Addresses of this machine are limited in failed tokens
only: programs here that call a service ten thousand times a second are normal, and could harm the machine in any case.
"""

from __future__ import annotations

import ipaddress
import ssl
from collections.abc import Callable
from pathlib import Path

import msgspec

from mindstage.errors import CertificateError

__all__ = [
    "DEFAULT_VISITOR_LIMITS",
    "TlsCertificate",
    "TokenBucket",
    "Visitor",
    "VisitorLimits",
    "VisitorRegistry",
    "client_tls_context",
    "is_loopback",
]

HANDSHAKE_TIMEOUT_S = 10.0
"""Time for a client to complete the TLS handshake [s]."""


def is_loopback(host: str) -> bool:
    """Whether a host can be reached from this machine only."""
    if host.strip("[]").lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


# -- certificates ------------------------------------------------------------------------------------------------------


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


# -- limits ------------------------------------------------------------------------------------------------------------


class VisitorLimits(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What one visitor may use; the defaults are far above what robots and their tools need.

    Of rates, bursts of several seconds are allowed. A visitor that sends too fast is read more slowly, so that no
    message is lost.
    """

    connections: int = 64
    """Open connections of an address that is not this machine."""
    messages_per_second: float = 5000.0
    """Messages from an address that is not this machine [1/s]."""
    bytes_per_second: float = 64.0 * 1024**2
    """Bytes from an address that is not this machine [B/s]."""
    queries_per_second: float = 10.0
    """Queries, questions, files and other expensive requests of the page, from an address that is not this machine."""
    failed_tokens_per_minute: float = 20.0
    """Wrong tokens from any address; beyond it, no token from that address is checked for a while."""


DEFAULT_VISITOR_LIMITS = VisitorLimits()
"""Limits that are used unless others are given."""

_BURST_S = 4.0
"""The time whose allowance may be used at once [s]."""
_MAX_VISITORS = 4096
"""Visitors that are remembered; those that used least are forgotten first."""


class TokenBucket:
    """A sustained rate, with bursts."""

    def __init__(self, rate: float, burst: float) -> None:
        """Creates a full bucket.

        Args:
            rate: what is added per second [1/s].
            burst: the capacity.
        """
        self._rate, self._burst = rate, burst
        self._left = burst
        self._last_s: float | None = None

    def _refill(self, now_s: float) -> None:
        if self._last_s is not None:
            self._left = min(self._burst, self._left + (now_s - self._last_s) * self._rate)
        self._last_s = now_s

    def try_take(self, now_s: float) -> bool:
        """Takes one; False if there is none."""
        if not self.has_any(now_s):
            return False
        self._left -= 1.0
        return True

    def has_any(self, now_s: float) -> bool:
        """Whether one could be taken."""
        self._refill(now_s)
        return self._left >= 1.0

    def take(self, amount: float, now_s: float) -> float:
        """Takes an amount in any case, and returns how long to wait until it has been refilled [s]."""
        self._refill(now_s)
        self._left -= amount
        return max(0.0, -self._left / self._rate)


class Visitor:
    """What one address uses at one server."""

    def __init__(self, limits: VisitorLimits, *, is_local: bool) -> None:
        self._limits = limits
        self._is_local = is_local
        self.connections = 0
        per_second = limits.failed_tokens_per_minute / 60.0
        self._failures = TokenBucket(per_second, max(1.0, limits.failed_tokens_per_minute))
        self._messages = TokenBucket(limits.messages_per_second, max(1.0, _BURST_S * limits.messages_per_second))
        self._bytes = TokenBucket(limits.bytes_per_second, max(1.0, _BURST_S * limits.bytes_per_second))
        self._queries = TokenBucket(limits.queries_per_second, max(1.0, _BURST_S * limits.queries_per_second))

    @property
    def may_connect(self) -> bool:
        """Whether it may open a further connection."""
        return self._is_local or self.connections < self._limits.connections

    def may_try_token(self, now_s: float) -> bool:
        """Whether a token of it is checked."""
        return self._failures.has_any(now_s)

    def add_failed_token(self, now_s: float) -> None:
        """Counts a wrong token."""
        self._failures.take(1.0, now_s)

    def may_query(self, now_s: float) -> bool:
        """Whether it may send a further expensive request now; counts it."""
        return self._is_local or self._queries.try_take(now_s)

    @property
    def receive_delay(self) -> Callable[[int, float], float] | None:
        """Counts a received message by its size and time, and returns how long to wait before the next one [s].

        None if the visitor is not limited.
        """
        return None if self._is_local else self._receive_delay

    def _receive_delay(self, size: int, now_s: float) -> float:
        return max(self._messages.take(1.0, now_s), self._bytes.take(float(size), now_s))


class VisitorRegistry:
    """The visitors of one server. Belongs to the thread of the server's loop."""

    def __init__(self, limits: VisitorLimits = DEFAULT_VISITOR_LIMITS) -> None:
        """Creates a registry without visitors.

        Args:
            limits: the limits of each visitor.
        """
        self.limits = limits
        self._visitors: dict[str, Visitor] = {}

    def visitor(self, address: object) -> Visitor:
        """The visitor of the remote address of a socket, as asyncio gives it."""
        host = str(address[0]) if isinstance(address, tuple) and address else "127.0.0.1"  # else a Unix socket
        key = _network(host)
        found = self._visitors.pop(key, None)
        if found is None:
            found = Visitor(self.limits, is_local=is_loopback(key))
            self._forget_idle()
        self._visitors[key] = found  # the latest is the last
        return found

    def _forget_idle(self) -> None:
        if len(self._visitors) >= _MAX_VISITORS:
            oldest = next((key for key, visitor in self._visitors.items() if not visitor.connections), None)
            if oldest is not None:
                del self._visitors[oldest]


def _network(host: str) -> str:
    try:
        address = ipaddress.ip_address(host.partition("%")[0])
    except ValueError:
        return host
    if isinstance(address, ipaddress.IPv6Address):
        if address.ipv4_mapped:
            return str(address.ipv4_mapped)
        if not address.is_loopback:
            return str(ipaddress.IPv6Network((address, 64), strict=False).network_address)
    return str(address)
