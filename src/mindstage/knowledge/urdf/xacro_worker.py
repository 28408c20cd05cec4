"""Subprocess that expands one xacro file, given with the package folders as arguments, and prints the XML."""

from __future__ import annotations

import sys
from contextlib import suppress
from pathlib import Path

from mindstage.knowledge.io.ros_packages import RosPackagePath

__all__ = ["main"]

_MEMORY_LIMIT = 2 * 1024**3
"""Address space limit [bytes]."""


def main(path: str, *folders: str) -> int:
    """Prints the expanded file, or one line with the reason of a failure to stderr; returns the exit code."""
    import xacro
    from xacro import substitution_args

    packages = RosPackagePath(map(Path, folders))

    def find(name: str) -> str:
        folder = packages.package_folder(name)
        if folder is None:
            searched = ", ".join(map(str, packages.folders)) or "none; give one with --ontology"
            raise LookupError(f"no package folder contains {name!r}; searched: {searched}")
        return str(folder)

    # xacro itself would search an installation of ROS.
    substitution_args._eval_find = find
    _limit_memory()
    try:
        text: str = xacro.process_file(path).toxml()
    except Exception as error:  # a macro may raise anything
        print(" ".join(str(error).split()) or type(error).__name__, file=sys.stderr)  # noqa: T201
        return 1
    sys.stdout.buffer.write(text.encode())
    return 0


def _limit_memory() -> None:
    with suppress(ImportError, ValueError, OSError):  # not every platform has resource limits
        import resource

        _, hard = resource.getrlimit(resource.RLIMIT_AS)
        resource.setrlimit(resource.RLIMIT_AS, (_MEMORY_LIMIT, hard))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
