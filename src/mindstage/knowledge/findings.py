"""Findings: what a source says that could not be taken as it stands, and what was done instead."""

from __future__ import annotations

from enum import StrEnum
from typing import Protocol

import msgspec

__all__ = ["Finding", "FindingSink", "Severity"]


class Severity(StrEnum):
    """How much of what was meant is missing in the world."""

    WARNING = "warning"
    """Something had to be chosen or ignored; the thing itself is there."""
    ERROR = "error"
    """A thing is not there. What is said about it is kept all the same."""


class Finding(msgspec.Struct, frozen=True, rename={"problem": "what", "action": "did"}):
    """One oddity of a source, and how it was met; none of them loses a statement."""

    severity: Severity
    individual: str
    """The IRI that it is about, or the file."""
    property: str
    """The IRI of the property that is odd or missing; empty where it is about the whole."""
    problem: str
    action: str

    def __str__(self) -> str:
        about = ", ".join(part for part in (self.individual, self.property) if part)
        return f"{self.severity.value}: {about}: {self.problem}; {self.action}"


class FindingSink(Protocol):
    """Where findings go while a source is read."""

    def __call__(self, severity: Severity, individual: str, property: str, problem: str, action: str) -> None:
        """Keeps one finding."""
