"""Report: what became of a world that was spawned, for people and for programs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import TYPE_CHECKING

from mindstage.cli.output import print_table, warn

if TYPE_CHECKING:
    from mindstage.engines import SpawnReport
    from mindstage.knowledge import Finding

__all__ = ["is_complete", "print_failures", "print_report", "report_json"]


def is_complete(report: SpawnReport, findings: Iterable[Finding]) -> bool:
    """Whether all that the map describes is in the world: nothing left out while reading, nothing while spawning."""
    from mindstage.knowledge import Severity

    return report.ok and not any(finding.severity is Severity.ERROR for finding in findings)


def report_json(report: SpawnReport) -> dict[str, object]:
    """The report as it stands in JSON; `warnings` are what the engine assumed, each said in words."""
    import msgspec

    return {
        "ok": report.ok,
        "bodies": report.bodies,
        "constraints": report.joints,
        "attachments": report.attachments,
        "failed_bodies": msgspec.to_builtins(report.failed_bodies),
        "failed_constraints": msgspec.to_builtins(report.failed_joints),
        "failed_attachments": msgspec.to_builtins(report.failed_attachments),
        "warnings": msgspec.to_builtins(report.notes),
    }


def print_report(report: SpawnReport, *, title: str, verbose: bool) -> None:
    """The report as tables; failures always one by one, on stderr."""
    kinds = (
        ("bodies", report.bodies, report.failed_bodies),
        ("constraints", report.joints, report.failed_joints),
        ("attachments", report.attachments, report.failed_attachments),
    )
    print_table(title, ("", "spawned", "failed"), [(kind, done, len(failed)) for kind, done, failed in kinds])
    print_failures(report)
    if report.notes and verbose:
        rows = [(note.kind.value, ", ".join(note.ids), note.text) for note in report.notes]
        print_table("What the map did not say", ("assumption", "about", "what"), rows)
    elif report.notes:
        counts = Counter(note.kind.value for note in report.notes)
        print_table("What the map did not say (--verbose lists each)", ("assumption", "times"), counts.most_common())


def print_failures(report: SpawnReport) -> None:
    """What could not be spawned, one by one."""
    kinds = ("bodies", report.failed_bodies), ("constraints", report.failed_joints)
    for kind, failures in (*kinds, ("attachments", report.failed_attachments)):
        for failure in failures:
            warn(f"not spawned, of the {kind}: {failure.id}: {failure.reason}")
