"""Moves the files of `changes` into CHANGELOG.md, as the section of a version: join_changes.py VERSION.

Without a version the section is printed, and nothing is changed. `changes/README.md` describes the files.
"""

from __future__ import annotations

import sys
from datetime import date
from pathlib import Path

__all__ = ["main", "section"]

ROOT = Path(__file__).resolve().parent.parent
KINDS = ("security", "added", "changed", "removed", "fixed")


def main() -> int:
    """Prints or writes the section; returns 1 where a file has no valid name or no text, or where there is none."""
    fragments = sorted(path for path in (ROOT / "changes").iterdir() if path.name != "README.md")
    invalid = [path for path in fragments if path.suffixes[-2:] not in [[f".{kind}", ".md"] for kind in KINDS]]
    invalid += [path for path in fragments if not path.read_text(encoding="utf-8").strip()]
    if invalid or (sys.argv[1:] and not fragments):
        print("no valid changes:", *(path.name for path in invalid), file=sys.stderr)
        return 1
    if not sys.argv[1:]:
        print(section(fragments), end="")
        return 0
    log = ROOT / "CHANGELOG.md"
    head, _, rest = log.read_text(encoding="utf-8").partition("\n## ")
    title = f"## {sys.argv[1]} ({date.today().isoformat()})"
    log.write_text(f"{head}\n{title}\n\n{section(fragments)}\n## {rest}", encoding="utf-8")
    for path in fragments:
        path.unlink()
    return 0


def section(fragments: list[Path]) -> str:
    """The text of a version: a heading for each kind, and a bullet for each change."""
    lines: list[str] = []
    for kind in KINDS:
        texts = [path.read_text(encoding="utf-8").strip() for path in fragments if path.suffixes[-2] == f".{kind}"]
        if texts:
            bullets = ("- " + text.replace("\n", "\n  ") for text in texts)
            lines += [f"### {kind.capitalize()}", "", *bullets, ""]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
