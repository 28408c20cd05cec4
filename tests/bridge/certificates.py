"""Certificates for tests, of an authority that nothing trusts by default."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
import trustme

from mindstage.access.certificates import TlsCertificate

__all__ = ["Certificates", "certificates"]


@dataclass(frozen=True)
class Certificates:
    """Files of an authority and of certificates that it issued."""

    authority: Path
    local: TlsCertificate
    """For 127.0.0.1 and localhost."""
    elsewhere: TlsCertificate
    """For another host."""
    expired: TlsCertificate


@pytest.fixture(scope="session")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Certificates:
    """The certificates."""
    folder = tmp_path_factory.mktemp("certificates")
    authority = trustme.CA()
    authority.cert_pem.write_to_path(str(folder / "authority.pem"))
    yesterday = datetime.now(UTC) - timedelta(days=1)

    def issue(name: str, *hosts: str, not_after: datetime | None = None) -> TlsCertificate:
        issued = authority.issue_cert(*hosts, not_after=not_after)
        certificate, key = folder / f"{name}.pem", folder / f"{name}.key"
        issued.cert_chain_pems[0].write_to_path(str(certificate))
        issued.private_key_pem.write_to_path(str(key))
        return TlsCertificate(certificate=certificate, key=key)

    return Certificates(
        authority=folder / "authority.pem",
        local=issue("local", "127.0.0.1", "localhost", "::1"),
        elsewhere=issue("elsewhere", "robot.example"),
        expired=issue("expired", "127.0.0.1", not_after=yesterday),
    )
