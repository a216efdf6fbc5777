"""Reading and copying of plain files, for the store and for output folders."""

import contextlib
import errno
import fcntl
import hashlib
import os
import shutil
import stat
from collections.abc import Callable, Iterator
from io import BufferedReader
from pathlib import Path

from pipeline.errors import EnvironmentFault

_FICLONE = 0x40049409
"""FICLONE of linux/fs.h: share the blocks of another file, with copy on write."""
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Errors of a full disk, of a used-up quota, and of a file larger than the file system allows."""
_REFUSED = (errno.EROFS, errno.EACCES, errno.EPERM)
"""Errors of read-only file systems and of missing permissions."""
_MACHINE_ERRORS = (*_FULL, *_REFUSED, errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.EIO, errno.ESTALE)

Signature = list[int]
"""Size, inode, mtime and ctime of a file [bytes, -, ns, ns]: equal values suggest that its bytes are unchanged."""
CTIME = 3
"""Index of ctime in a signature."""


def signature(facts: os.stat_result) -> Signature:
    """Facts about a file that change when somebody writes to it. ctime cannot be set back, mtime can."""
    return [facts.st_size, facts.st_ino, facts.st_mtime_ns, facts.st_ctime_ns]


def nearest_existing(path: Path) -> Path:
    """The path, or the nearest folder above it that exists."""
    return next(folder for folder in (path.absolute(), *path.absolute().parents) if folder.exists())


def is_machines_fault(error: BaseException) -> bool:
    """Whether an error comes from the machine (disk full, read-only, …) and not from the work."""
    return isinstance(error, OSError) and error.errno in _MACHINE_ERRORS


@contextlib.contextmanager
def reporting_machine_faults(
    doing: str, folder: Path, *, least_bytes: Callable[[], int] | None = None
) -> Iterator[None]:
    """Turn errors of the machine (`is_machines_fault`) into an `EnvironmentFault`: cannot `doing` `folder`.

    Of a full disk it states the bytes that are free, and the result of `least_bytes`, which is called then only.
    """
    try:
        yield
    except OSError as error:
        if not is_machines_fault(error):
            raise
        if error.errno in _FULL:
            free = shutil.disk_usage(nearest_existing(folder)).free
            need = f"at least {least_bytes():,} bytes needed, " if least_bytes else ""
            hint = f"{need}{free:,} bytes free on that disk"
        elif error.errno in _REFUSED:
            hint = "choose another folder, or mend its permissions"
        else:
            hint = "build again"
        raise EnvironmentFault(f"cannot {doing} {folder}: {error.strerror}", hint=hint) from error


@contextlib.contextmanager
def chosen_place(doing: str, path: Path) -> Iterator[None]:
    """`reporting_machine_faults` for a path that the user chose, whose folder may not exist."""
    try:
        with reporting_machine_faults(doing, path):
            yield
    except (FileNotFoundError, FileExistsError, NotADirectoryError, IsADirectoryError) as error:
        raise EnvironmentFault(f"cannot {doing} {path}: {error.strerror}", hint="choose another place") from error


def open_regular(path: Path | str) -> BufferedReader:
    """Open a plain file for reading; OSError for anything else. No link is followed, and a FIFO does not block."""
    handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    if stat.S_ISREG(os.fstat(handle).st_mode):
        return os.fdopen(handle, "rb")
    os.close(handle)
    raise OSError(f"{path} is no plain file")


def read_regular(path: Path | str, limit_bytes: int | None = None) -> bytes | None:
    """All bytes of a plain file; None for anything else, an unreadable file, or one beyond the limit."""
    with contextlib.suppress(OSError), open_regular(path) as stream:
        data = stream.read() if limit_bytes is None else stream.read(limit_bytes + 1)
        return data if limit_bytes is None or len(data) <= limit_bytes else None
    return None


def digest_of(path: Path | str) -> str | None:
    """sha256 of a plain file, read in chunks; None for anything else, or an unreadable file."""
    with contextlib.suppress(OSError), open_regular(path) as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
    return None


def is_no_file(path: Path | str) -> bool:
    """Whether the path holds something other than a plain file; False if it cannot be examined."""
    try:
        return not stat.S_ISREG(os.lstat(path).st_mode)
    except OSError:
        return False


def has_other_names(path: Path) -> bool:
    """Whether a file has several hard links, so that writing to it would change files elsewhere."""
    try:
        return os.lstat(path).st_nlink > 1
    except OSError:
        return False


def is_unreadable(path: Path | str) -> bool:
    """Whether the path holds a plain file that cannot be read now: no descriptors left, no permission, a bad disk."""
    return os.path.lexists(path) and not is_no_file(path) and digest_of(path) is None


def copy(source: Path, target: Path) -> None:
    """Copy a file, sharing blocks if possible. The copy is never a hard link, so no edit of it reaches the source."""
    with source.open("rb") as reader, target.open("xb") as writer:
        with contextlib.suppress(OSError):
            fcntl.ioctl(writer.fileno(), _FICLONE, reader.fileno())
            return
        shutil.copyfileobj(reader, writer)
