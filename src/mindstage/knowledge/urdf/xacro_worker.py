"""The process that expands one description: its path, then the folders of packages; XML comes out."""

from __future__ import annotations

import sys
from contextlib import suppress
from pathlib import Path

from mindstage.knowledge.io.ros_packages import RosPackagePath

__all__ = ["main"]

_MEMORY_LIMIT = 2 * 1024**3
"""More than any description takes [bytes]."""


def main(path: str, *folders: str) -> int:
    """Writes the description without macros, or in one line why there is none; 0 for success."""
    import xacro
    from xacro import substitution_args

    packages = RosPackagePath(map(Path, folders))

    def find(name: str) -> str:
        home = packages.package_folder(name)
        if home is None:
            known = ", ".join(map(str, packages.folders)) or "none; give one with --ontology"
            raise LookupError(f"no folder of packages has {name!r}; searched: {known}")
        return str(home)

    # xacro itself would ask an installation of ROS.
    substitution_args._eval_find = find
    _limit_memory()
    try:
        text: str = xacro.process_file(path).toxml()
    except Exception as error:  # a macro may hold any Python expression, so anything may come out of it
        print(" ".join(str(error).split()) or type(error).__name__, file=sys.stderr)  # noqa: T201
        return 1
    sys.stdout.buffer.write(text.encode())
    return 0


def _limit_memory() -> None:
    with suppress(ImportError, ValueError, OSError):  # not everywhere is there a limit
        import resource

        _, hard = resource.getrlimit(resource.RLIMIT_AS)
        resource.setrlimit(resource.RLIMIT_AS, (_MEMORY_LIMIT, hard))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
