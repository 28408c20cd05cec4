"""Security advisories about the pinned packages: asks the package index, so it is part of the slow suite."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
ACCEPTED: dict[str, str] = {}
"""Advisories that do not apply here, by id, with the reason."""
TIMEOUT_S = 900.0


@pytest.mark.slow
@pytest.mark.parametrize("pins", sorted(ROOT.glob("requirements/*.txt")), ids=lambda path: path.stem)
def test_no_pinned_package_has_a_security_advisory(pins: Path) -> None:
    pytest.importorskip("pip_audit", reason="pip-audit is not installed; `make test-slow` installs it")
    options = ("--disable-pip", "--no-deps", "--format=json", "--progress-spinner=off")
    run = subprocess.run(
        [sys.executable, "-m", "pip_audit", "-r", str(pins), *options],
        capture_output=True, text=True, timeout=TIMEOUT_S, check=False,
    )  # fmt: skip
    if not run.stdout:
        pytest.skip(f"no advisories can be read here: {run.stderr.strip().splitlines()[-1]}")
    packages = json.loads(run.stdout)["dependencies"]
    missing = {each["name"]: each["skip_reason"] for each in packages if "skip_reason" in each}
    if len(missing) == len(packages):
        pytest.skip(f"the package index here has no advisories: {next(iter(missing.values()))}")
    found = {
        f"{each['name']} {each['version']}: {advisory['id']}, fixed in {', '.join(advisory['fix_versions']) or 'none'}"
        for each in packages
        for advisory in each.get("vulns", ())
        if ACCEPTED.keys().isdisjoint({advisory["id"], *advisory["aliases"]})
    }
    assert not found
    assert not missing, "packages that the index does not have were not audited"
    assert len(packages) == sum("==" in line for line in pins.read_text(encoding="utf-8").splitlines())
