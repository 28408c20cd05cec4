"""`python launcher.py COMMAND…` runs a command and prints its exit code, wall time [s] and peak memory [KiB].

It is a small process of its own, since on Linux the peak memory of a process includes that of its parent at the fork.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time

__all__ = ["main"]


def main(command: list[str]) -> None:
    start = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    # Only wait4 returns the peak memory of this child alone.
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.perf_counter() - start
    process.returncode = os.waitstatus_to_exitcode(status)
    print(process.returncode, seconds, usage.ru_maxrss)


if __name__ == "__main__":
    main(sys.argv[1:])
