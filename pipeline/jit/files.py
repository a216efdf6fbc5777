"""Folders of compiled kernels, one for each kernel, closed by digests of what Numba has put there.

Numba's cache believes whatever it finds: a file that lost its end breaks every build for ever, and one that somebody
else wrote is executed. So a process opens the folder of a kernel once, before Numba does. What is not as its digests
say, or may be another user's, is thrown away whole, and the kernel is compiled again.
"""

import contextlib
import errno
import fcntl
import functools
import hashlib
import os
import shutil
import stat
import sys
import tempfile
import uuid
from collections.abc import Iterator
from pathlib import Path

from pipeline.errors import EnvironmentFault

_DIGESTS = "SHA256SUMS"
"""Name of the file that `sha256sum -c` understands."""

_warned: set[str] = set()
opened: set[str] = set()
"""Names of the folders that this process has opened."""


def say(text: str) -> None:
    """Warn on stderr, once in a process: of a command, or in the log of the task that met the damage."""
    if text not in _warned:
        _warned.add(text)
        print(f"warning: {text}", file=sys.stderr, flush=True)


def open_folder(folder: Path) -> Path:
    """A folder for the code of a kernel, with code that can be trusted or none; EnvironmentFault if the disk is full.

    Numba needs a folder that it can write to, so that a temporary one stands in for one that is read-only, with a copy
    of its code.
    """
    opened.add(folder.name)
    make_folder(folder.parent)
    if _is_private(folder.parent):
        with contextlib.suppress(OSError), no_full_disk(folder), locked(folder):
            is_new = _is_private(folder) and not any(folder.rglob("*.nb?"))
            if os.path.lexists(folder) and not is_new and not is_whole(folder):
                if not folder.is_dir() or (folder / _DIGESTS).is_file():  # else a process was killed that compiled
                    say(f"the compiled kernel {folder} is damaged; it is compiled again")
                aside = _aside(folder, "damaged")
                folder.rename(aside)
                shutil.rmtree(aside) if aside.is_dir() and not aside.is_symlink() else aside.unlink()
            folder.mkdir(mode=0o700, exist_ok=True)
        if os.access(folder, os.W_OK):
            return folder
    stand_in = Path(_temporary().name) / folder.name
    if is_whole(folder):
        shutil.copytree(folder, stand_in, dirs_exist_ok=True)
    else:
        say(
            f"cannot keep compiled kernels in {folder.parent}, so every process compiles them; "
            "set PIPELINE_JIT_CACHE to a folder that you may write to"
        )
        stand_in.mkdir(exist_ok=True)
    return stand_in


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the folder of a kernel while code is put into it: others wait, and then load what they would have compiled.

    Numba's index is not made for two processes that save at a time. Callers are held before what they call, so that
    nobody waits in a circle. Without locks, as on some network file systems, nothing is held.
    """
    with contextlib.ExitStack() as last:
        with contextlib.suppress(OSError):
            handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
            last.callback(os.close, handle)
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield


def seal(folder: Path) -> None:
    """Close a folder in which Numba has put code; without it, whoever opens the folder throws that away."""
    with contextlib.suppress(FileNotFoundError), no_full_disk(folder):  # thrown away by a process that came between
        aside = _aside(folder / _DIGESTS, "new")
        aside.write_text(_digests(folder), encoding="utf-8")
        aside.replace(folder / _DIGESTS)


def closed(folder: Path) -> int:
    """Number of the kernels in a folder that are there and closed."""
    return len(list(folder.glob(f"*/{_DIGESTS}")))


def is_whole(folder: Path) -> bool:
    """Whether only this user can have put anything into a folder, and it holds what it was closed with."""
    try:
        private = _is_private(folder.parent) and _is_private(folder)
        return private and _digests(folder) == _read(folder / _DIGESTS).decode()
    except (OSError, ValueError):
        return False


def make_folder(folder: Path) -> None:
    """Make the folder of all kernels, for this user alone; EnvironmentFault if the disk is full.

    What is there and no folder of ours gets another name.
    """
    with contextlib.suppress(OSError), no_full_disk(folder):
        folder.parent.mkdir(parents=True, exist_ok=True)
        if os.path.lexists(folder) and not _is_private(folder) and folder.lstat().st_uid == os.geteuid():
            damaged = folder.rename(_aside(folder, "damaged"))
            say(f"{folder} was no folder for you alone, and is now {damaged.name}; kernels are compiled again")
        folder.mkdir(mode=0o700, exist_ok=True)


@contextlib.contextmanager
def no_full_disk(folder: Path) -> Iterator[None]:
    """Raise EnvironmentFault where the disk of compiled kernels is full."""
    try:
        yield
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            raise
        free = shutil.disk_usage(next(place for place in (folder, *folder.parents) if place.is_dir())).free
        raise EnvironmentFault(
            f"cannot keep compiled kernels in {folder}: {error.strerror}",
            hint=f"{free:,} bytes are free; PIPELINE_JIT_CACHE names another folder",
        ) from error


def _digests(folder: Path) -> str:
    """A line for each file that Numba would read."""
    paths = sorted(Path(place) / name for place, _, names in os.walk(folder) for name in names)
    code = [path for path in paths if path.suffix in (".nbi", ".nbc")]
    return "".join(f"{hashlib.sha256(_read(path)).hexdigest()}  {path.relative_to(folder)}\n" for path in code)


def _read(path: Path) -> bytes:
    """Bytes of a file, not by way of a link; none of a pipe."""
    with os.fdopen(os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC), "rb") as stream:
        return stream.read() if stat.S_ISREG(os.fstat(stream.fileno()).st_mode) else b""


def _is_private(folder: Path) -> bool:
    """Whether something is a folder into which only this user, or the administrator, can have put anything."""
    try:
        facts = folder.lstat()
    except OSError:
        return False
    ours = facts.st_uid in (os.geteuid(), 0) and not facts.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    return ours and stat.S_ISDIR(facts.st_mode)


@functools.cache
def _temporary() -> "tempfile.TemporaryDirectory[str]":
    """A folder of this process, removed when it ends."""
    return tempfile.TemporaryDirectory(prefix="kernels-")


def _aside(path: Path, why: str) -> Path:
    return path.with_name(f"{path.name}.{uuid.uuid4().hex}.{why}")
