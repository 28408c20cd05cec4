"""`python launcher.py COMMAND…` runs a command and prints its exit code, seconds, and peak memory [KiB].

A process of its own, and a small one: Linux counts the memory of whoever starts a process into that process's peak.
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
    # wait4 alone tells the peak memory of just this child.
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.perf_counter() - start
    process.returncode = os.waitstatus_to_exitcode(status)
    print(process.returncode, seconds, usage.ru_maxrss)


if __name__ == "__main__":
    main(sys.argv[1:])
