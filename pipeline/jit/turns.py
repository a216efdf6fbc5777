"""Turns of processes that want the same kernel: one compiles it, and the others wait for its file.

Locks of bytes of a file beside the folder of kernels, a byte for each name. They die with the process that holds them,
and only save work: whoever goes on without one compiles the same code once more.
"""

import contextlib
import fcntl
import functools
import hashlib
import os
from pathlib import Path

_NO_LINK = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC


def take(path: Path) -> None:
    """Wait until no other process compiles the kernel of a file; this one does from now on."""
    handle = _opened(path.parent)
    if handle is not None:
        with contextlib.suppress(OSError):
            fcntl.lockf(handle, fcntl.LOCK_EX, 1, _byte(path))


def end(path: Path) -> None:
    """Let others have the kernel of a file."""
    handle = _opened(path.parent)
    if handle is not None:
        with contextlib.suppress(OSError):
            fcntl.lockf(handle, fcntl.LOCK_UN, 1, _byte(path))


def end_all(folder: Path) -> None:
    """Let others have all kernels of a folder, also those whose compilation failed."""
    handle = _opened(folder)
    if handle is not None:
        with contextlib.suppress(OSError):
            fcntl.lockf(handle, fcntl.LOCK_UN)


@functools.cache
def _opened(folder: Path) -> int | None:
    """The open file of a folder's turns, once in a process, which loses its locks with any handle that it closes."""
    try:
        return os.open(folder.with_name(f"{folder.name}.turns"), _NO_LINK, 0o600)
    except OSError:
        return None


def _byte(path: Path) -> int:
    """Number of the byte that a name has."""
    return int.from_bytes(hashlib.sha256(path.name.encode()).digest()[:4])
