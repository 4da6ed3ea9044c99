"""The rights of an ordinary user, a full disk and little memory, also for root.

Both are real: the system refuses, nothing is mocked.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path

# Linux: root's right to read, write and search whatever the permissions say.
_OVERRIDE = (1 << 1) | (1 << 2)
_VERSION = 0x20080522


@contextlib.contextmanager
def as_ordinary_user() -> Iterator[None]:
    """Within the block permissions count for root too (this thread, Linux)."""
    if not hasattr(os, "geteuid") or os.geteuid() != 0 or sys.platform != "linux":
        yield
        return
    libc = ctypes.CDLL(None, use_errno=True)
    head = (ctypes.c_uint32 * 2)(_VERSION, 0)
    rights = (ctypes.c_uint32 * 6)()  # twice effective, permitted, inheritable
    if libc.capget(head, rights):
        raise OSError(ctypes.get_errno(), "capget")
    before = rights[0]
    rights[0] = before & ~_OVERRIDE
    if libc.capset(head, rights):
        raise OSError(ctypes.get_errno(), "capset")
    try:
        yield
    finally:
        rights[0] = before
        libc.capset(head, rights)


@contextlib.contextmanager
def no_larger_files(size: int) -> Iterator[None]:
    """Within the block no file grows beyond ``size`` bytes, as on a full disk."""
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@contextlib.contextmanager
def little_memory(more: int = 150_000_000) -> Iterator[None]:
    """Within the block this process gets at most ``more`` further bytes (Linux)."""
    import resource

    status = Path("/proc/self/status").read_text("ascii")
    (now,) = re.findall(r"^VmData:\s+(\d+) kB$", status, re.MULTILINE)
    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    resource.setrlimit(resource.RLIMIT_DATA, (1024 * int(now) + more, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))
