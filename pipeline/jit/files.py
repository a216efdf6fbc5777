"""Files of compiled kernels: closed by their own digest, in a folder that nobody else can write to.

They hold pickles, so that reading one is executing it. None is given to anybody before its digest was right, and none
from a folder of somebody else. Whatever else lies there is no kernel, and compiled again.
"""

import contextlib
import errno
import hashlib
import os
import shutil
import stat
import sys
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path

from pipeline.errors import EnvironmentFault

_TRAILER = b"\n#sha256="
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)

Warn = Callable[[str], None]

_said: set[str] = set()


def say(text: str) -> None:
    """Warn on stderr, once in a process: of a command, or in the log of the task that met the damage."""
    if text not in _said:
        _said.add(text)
        print(f"warning: {text}", file=sys.stderr, flush=True)


def read(path: Path, warn: Warn = say) -> bytes | None:
    """Bytes that `write` wrote. Anything else that lies there is removed, with a warning that names it, and None."""
    with _folder_of(path, warn) as folder:
        if folder is None or not _is_there(path.name, folder):
            return None
        try:
            handle = os.open(path.name, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, dir_fd=folder)
            with os.fdopen(handle, "rb") as stream:
                raw = stream.read() if stat.S_ISREG(os.fstat(handle).st_mode) else b""
        except OSError:
            raw = b""
    body, _, tail = raw.rpartition(_TRAILER)
    if tail == _digest(path, body):
        return body
    discard(path, "is damaged", warn)
    return None


def discard(path: Path, why: str, warn: Warn = say) -> None:
    """Remove a file that cannot be used, and say so."""
    warn(f"the compiled kernel {path} {why}; it is compiled again")
    with contextlib.suppress(OSError):
        path.rename(_aside(path, "damaged")) if path.is_dir() and not path.is_symlink() else path.unlink()


def write(path: Path, body: bytes, warn: Warn = say) -> None:
    """Put a file into place at once: whoever reads meanwhile finds the old one, the new one or none.

    A folder that cannot be written is only slower, and that is said.

    Raises
    ------
    EnvironmentFault
        The disk is full.
    """
    aside = _aside(path, "new")
    with _folder_of(path, warn) as folder, _kept(path.parent, len(body), warn):
        if folder is None and path.parent.is_dir():  # somebody else's
            return
        try:
            aside.write_bytes(body + _TRAILER + _digest(path, body))
            aside.replace(path)
        finally:
            aside.unlink(missing_ok=True)


def make_folder(folder: Path, warn: Warn = say) -> None:
    """Make the folder, for this user alone. What stands there and is no folder of ours gets another name.

    Raises
    ------
    EnvironmentFault
        The disk is full.
    """
    with _kept(folder, 0, warn):
        folder.parent.mkdir(parents=True, exist_ok=True)
        if os.path.lexists(folder) and not _is_safe(folder) and folder.lstat().st_uid == os.geteuid():
            damaged = _aside(folder, "damaged")
            folder.rename(damaged)
            warn(f"{folder} was no folder for you alone, and is now {damaged.name}; kernels are compiled again")
        folder.mkdir(mode=0o700, exist_ok=True)


@contextlib.contextmanager
def _kept(folder: Path, size: int, warn: Warn) -> Iterator[None]:
    """Tell errors that happen while something is put into a folder."""
    try:
        yield
    except OSError as error:
        if error.errno in _FULL:
            free = shutil.disk_usage(next(place for place in (folder, *folder.parents) if place.is_dir())).free
            raise EnvironmentFault(
                f"cannot keep compiled kernels in {folder}: {error.strerror}",
                hint=f"{size:,} bytes needed, {free:,} bytes free; PIPELINE_JIT_CACHE names another folder",
            ) from error
        warn(
            f"cannot keep compiled kernels in {folder} ({error.strerror}), so every process compiles them; "
            "set PIPELINE_JIT_CACHE to a folder that you may write to"
        )


@contextlib.contextmanager
def _folder_of(path: Path, warn: Warn) -> Iterator[int | None]:
    """The open folder of a file, if nobody else can have put anything there."""
    try:
        handle = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    except OSError:
        yield None
        return
    try:
        safe = _is_private(os.fstat(handle))
        if not safe:
            warn(f"others than you may write to {path.parent}: the compiled kernels in it are not used")
        yield handle if safe else None
    finally:
        os.close(handle)


def _is_safe(folder: Path) -> bool:
    return folder.is_dir() and _is_private(folder.stat())


def _is_private(facts: os.stat_result) -> bool:
    """Whether only this user, or the administrator, can have put anything into a folder."""
    return facts.st_uid in (os.geteuid(), 0) and not facts.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def _is_there(name: str, folder: int) -> bool:
    try:
        os.stat(name, dir_fd=folder, follow_symlinks=False)
    except OSError:
        return False
    return True


def _aside(path: Path, why: str) -> Path:
    return path.with_name(f"{path.name}.{uuid.uuid4().hex}.{why}")


def _digest(path: Path, body: bytes) -> bytes:
    """Digest of the bytes, and of the name that they belong to."""
    return hashlib.sha256(path.name.encode() + b"\0" + body).hexdigest().encode() + b"\n"
