"""`plugins`: what other packages add to Mindstage."""

from __future__ import annotations

from mindstage.cli.options import AsJson, ExitCode
from mindstage.cli.output import print_json, print_line, print_table
from mindstage.registry import Group, extensions, problems, reporting

__all__ = ["plugins"]


def plugins(*, as_json: AsJson = False) -> ExitCode:
    """List what installed packages add, and whether clients of ports may use it; exit 1 if any of it has a problem."""
    found = [each for group in Group for each in extensions(group).values() if each.package != "mindstage"]
    for each in found:
        with reporting():
            each.load(object)
    rows = [(each.name, each.group.value, each.package, each.access or "", each.is_offered) for each in found]
    columns = ("name", "group", "package", "access", "offered")
    if as_json:
        plugins = [dict(zip(columns, row, strict=True)) for row in rows]
        print_json({"plugins": plugins, "problems": problems()})
    elif not rows:
        print_line("no other package adds anything to Mindstage")
    else:
        print_table("", columns, [(*row[:-1], "yes" if row[-1] else "no") for row in rows])
    return ExitCode.NEGATIVE if problems() else ExitCode.OK
