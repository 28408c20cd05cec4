"""What the operating system denies a worker process that computes with untrusted input. No denial can be undone.

On Linux these are a filter of system calls (seccomp, `man 2 seccomp`), in addition limits of resources, and, where the
kernel has it, Landlock. Other systems have only the limits of resources, and Windows has none of the three.
"""

from __future__ import annotations

import ctypes
import errno
import os
import platform
import struct
import sys
from collections.abc import Collection

if sys.platform != "win32":
    import resource

__all__ = ["confine", "deny_network", "end_with_parent"]

_PR_SET_PDEATHSIG, _PR_SET_NO_NEW_PRIVS = 1, 38
_SIGKILL = 9
_SECCOMP_SET_MODE_FILTER, _ALL_THREADS = 1, 1
_LOAD_WORD, _JUMP_IF_EQUAL, _JUMP_IF_AT_LEAST, _RETURN = 0x20, 0x15, 0x35, 0x06
_ALLOW, _FAIL = 0x7FFF0000, 0x00050000 | errno.EACCES
"""These are codes of Linux, and of the programs of its filters."""
_X32_CALLS = 0x40000000
"""System calls from this number are those of the x32 interface of x86_64."""

_AUDIT_NUMBERS = {"x86_64": 0xC000003E, "aarch64": 0xC00000B7}
"""The machines by their number in the Linux audit interface; the tables below have their system calls."""
_SECCOMP = {"x86_64": 317, "aarch64": 277}
_NETWORK = {"x86_64": (41, 425), "aarch64": (198, 425)}
"""`socket` and `io_uring_setup`."""
_COMPUTING = {
    # read write close fstat lseek readv writev, mmap mprotect munmap brk mremap madvise
    "x86_64": (
        *(0, 1, 3, 5, 8, 19, 20, 9, 10, 11, 12, 25, 28),
        # rt_sigaction rt_sigprocmask rt_sigreturn sigaltstack restart_syscall, futex sched_yield sched_getaffinity
        *(13, 14, 15, 131, 219, 202, 24, 204),
        # getpid gettid getrusage times gettimeofday time clock_gettime clock_getres nanosleep clock_nanosleep
        *(39, 186, 98, 100, 96, 201, 228, 229, 35, 230),
        # getrandom set_robust_list membarrier rseq exit exit_group
        *(318, 273, 324, 334, 60, 231),
    ),
    "aarch64": (  # the same, without time
        *(63, 64, 57, 80, 62, 65, 66, 222, 226, 215, 214, 216, 233),
        *(134, 135, 139, 132, 128, 98, 124, 123),
        *(172, 178, 165, 153, 169, 113, 114, 101, 115),
        *(278, 99, 283, 293, 93, 94),
    ),
}
"""What a process needs that computes, manages its memory, and reads and writes files that are open."""

_LANDLOCK_CREATE_RULESET, _LANDLOCK_RESTRICT_SELF = 444, 446  # on all machines
_LANDLOCK_VERSION = 1
"""These are codes of Linux."""
_LANDLOCK_FILE_RIGHTS = (0x1FFF, 0x3FFF, 0x7FFF, 0x7FFF, 0xFFFF)
"""The rights to files that each version of Landlock can deny; the last one is that of all newer versions."""
_LANDLOCK_TCP_SINCE, _LANDLOCK_TCP_RIGHTS = 4, 0x3
"""Version of the interface, and its mask of rights."""


def confine() -> str | None:
    """Denies this process everything but computing, and reading and writing the descriptors that are open.

    It then cannot open a file, a socket or another descriptor, start or end another process, or change anything in the
    file system. It ends with the thread of its parent that has started it.

    Returns:
        Why the system cannot do so; None if it does. The process is partly confined then, and should end.
    """
    if sys.platform == "win32":
        return "Windows cannot confine a process to its open files"
    if sys.platform == "linux":
        end_with_parent()
        _deny_paths(ctypes.CDLL(None, use_errno=True))
    for limit in (resource.RLIMIT_NPROC, resource.RLIMIT_FSIZE, resource.RLIMIT_CORE, resource.RLIMIT_NOFILE):
        resource.setrlimit(limit, (0, 0))
    machine = platform.machine()
    if sys.platform == "linux" and not _filter_calls(_COMPUTING.get(machine, ()), allowed=True):
        return f"the kernel has no filter of system calls (seccomp) for {machine}"
    try:
        os.close(os.open(os.devnull, os.O_RDONLY))
    except OSError:
        return None
    return "the system does not enforce that no file is opened"


def end_with_parent() -> None:
    """Ends this process with the thread of its parent that has started it, on Linux."""
    if sys.platform == "linux":
        libc = ctypes.CDLL(None, use_errno=True)
        libc.prctl(_PR_SET_PDEATHSIG, ctypes.c_ulong(_SIGKILL), *[ctypes.c_ulong(0)] * 3)


def deny_network(*, no_new_files: bool) -> bool:
    """Denies this process new sockets, and returns whether the operating system does so.

    On Linux a filter of system calls lets `socket` fail; elsewhere, the process may open no further file.

    Args:
        no_new_files: whether the process needs no further file either.
    """
    filtered = sys.platform == "linux" and _filter_calls(_NETWORK.get(platform.machine(), ()), allowed=False)
    if no_new_files and sys.platform != "win32":
        resource.setrlimit(resource.RLIMIT_NOFILE, (0, 0))
    return filtered or no_new_files


class _FilterProgram(ctypes.Structure):
    _fields_ = (("length", ctypes.c_ushort), ("instructions", ctypes.c_char_p))


def _filter_calls(calls: Collection[int], *, allowed: bool) -> bool:
    """Lets some system calls of this process fail with EACCES: those, or all but those that are `allowed`.

    Returns whether the kernel does so in all threads. Calls of other machines, as of 32 bits, fail in any case.
    """
    machine = platform.machine()
    if not calls or machine not in _AUDIT_NUMBERS:
        return False
    count = len(calls) + 1
    instructions = [struct.pack("HBBI", _LOAD_WORD, 0, 0, 4)]  # seccomp_data.arch
    instructions.append(struct.pack("HBBI", _JUMP_IF_EQUAL, 0, count + 3, _AUDIT_NUMBERS[machine]))
    instructions.append(struct.pack("HBBI", _LOAD_WORD, 0, 0, 0))  # seccomp_data.nr
    instructions.append(struct.pack("HBBI", _JUMP_IF_AT_LEAST, count + 1, 0, _X32_CALLS))
    instructions += (struct.pack("HBBI", _JUMP_IF_EQUAL, count - at, 0, call) for at, call in enumerate(calls, start=1))
    others, listed = (_FAIL, _ALLOW) if allowed else (_ALLOW, _FAIL)
    instructions += (struct.pack("HBBI", _RETURN, 0, 0, action) for action in (others, listed, _FAIL))
    program = _FilterProgram(len(instructions), b"".join(instructions))
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(_PR_SET_NO_NEW_PRIVS, *map(ctypes.c_ulong, (1, 0, 0, 0))) != 0:
        return False
    arguments = (_SECCOMP[machine], _SECCOMP_SET_MODE_FILTER, _ALL_THREADS, ctypes.addressof(program))
    return bool(libc.syscall(*map(ctypes.c_long, arguments)) == 0)


def _deny_paths(libc: ctypes.CDLL) -> None:
    """Denies all paths and TCP ports with Landlock, as far as the kernel has it."""

    def call(number: int, *arguments: int) -> int:
        return int(libc.syscall(*map(ctypes.c_long, (number, *arguments))))

    version = call(_LANDLOCK_CREATE_RULESET, 0, 0, _LANDLOCK_VERSION)
    if version < 1:
        return
    rights = _LANDLOCK_FILE_RIGHTS[min(version, len(_LANDLOCK_FILE_RIGHTS)) - 1]
    numbers = (rights, _LANDLOCK_TCP_RIGHTS) if version >= _LANDLOCK_TCP_SINCE else (rights,)
    attributes = (ctypes.c_uint64 * len(numbers))(*numbers)
    ruleset = call(_LANDLOCK_CREATE_RULESET, ctypes.addressof(attributes), ctypes.sizeof(attributes), 0)
    if ruleset >= 0:
        libc.prctl(_PR_SET_NO_NEW_PRIVS, *map(ctypes.c_ulong, (1, 0, 0, 0)))
        call(_LANDLOCK_RESTRICT_SELF, ruleset, 0)
        os.close(ruleset)
