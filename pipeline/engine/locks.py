"""File locks of the operating system: they end with the process that holds them, even if it is killed.

They only save work: a process without the lock computes the same bytes once more. The holder writes its name into the
lock file, and a waiting process reports it.
"""

import contextlib
import datetime
import errno
import fcntl
import json
import os
import socket
import stat
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

_POLL_S = 0.02
"""Time between two tries for a lock [s]: the system can wait for ever or not at all, so a wait with a timeout must
poll. A lock is held for milliseconds or for a whole build.
"""
_SILENT_S = 1.0
"""Wait that is not reported [s]: most locks are free sooner."""
_REPEAT_S = 60.0
"""Time after which a wait is reported again [s]: a terminal that is silent for minutes looks dead."""
_NO_LINK = os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC

Say = Callable[[str], None]


def silent(text: str) -> None:
    """Ignore a message."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Errand:
    """Why a lock is held or wanted: `doing` follows "which", as in `makes rays/Left`.

    `say` is called with a sentence about the holder after a second of waiting, and again every minute.
    """

    doing: str = "works there"
    say: Say = silent


def try_lock(handle: int, *, shared: bool = False) -> bool | None:
    """Try once to lock an open file; None means that this file system has no locks."""
    try:
        fcntl.flock(handle, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except OSError as error:
        return False if error.errno in (errno.EWOULDBLOCK, errno.EINTR) else None
    return True


@contextlib.contextmanager
def locked(
    path: Path, timeout_s: float = 3600.0, *, shared: bool = False, errand: Errand | None = None
) -> Iterator[bool]:
    """Hold a lock, or a shared one; yields False after the timeout or if the file system has no locks."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle = _opened(path)
    except OSError:
        yield False
        return
    with _held(handle, timeout_s, path, errand or Errand(), shared=shared) as held:
        yield held


@contextlib.contextmanager
def locked_folder(folder: Path, timeout_s: float = 3600.0, *, errand: Errand | None = None) -> Iterator[bool]:
    """Hold the lock of a folder as `locked` does; nothing is written into it, so it may be read-only."""
    try:
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    except OSError:
        yield False
        return
    with _held(handle, timeout_s, folder, errand or Errand()) as held:
        yield held


def _opened(path: Path) -> int:
    """Open or create a lock file, but no link. A read-only one of another user can be locked, too."""
    try:
        return os.open(path, os.O_RDWR | os.O_CREAT | _NO_LINK, 0o666)
    except PermissionError:
        return os.open(path, os.O_RDONLY | _NO_LINK)


@contextlib.contextmanager
def _held(handle: int, timeout_s: float, path: Path, errand: Errand, *, shared: bool = False) -> Iterator[bool]:
    """Wait for the lock of an open file, hold it, and close the file at the end."""
    try:
        held = try_lock(handle, shared=shared)
        if held is False:
            held = _waited(handle, timeout_s, path, errand, shared=shared)
        if held and not shared:
            _sign(handle, errand.doing)
        yield bool(held)
    finally:
        os.close(handle)


def _waited(handle: int, timeout_s: float, path: Path, errand: Errand, *, shared: bool) -> bool | None:
    start = time.monotonic()
    say_at = start + _SILENT_S
    while (held := try_lock(handle, shared=shared)) is False and time.monotonic() < start + timeout_s:
        if time.monotonic() >= say_at:
            errand.say(f"waiting for {_holder(handle, path)}")
            say_at += _REPEAT_S
        time.sleep(_POLL_S)
    return held


def _sign(handle: int, doing: str) -> None:
    """Write the holder into a lock file, unless it is a folder, belongs to another user, or has several names."""
    facts = os.fstat(handle)
    if not stat.S_ISREG(facts.st_mode) or facts.st_nlink != 1:
        return
    since = datetime.datetime.now().astimezone().isoformat(timespec="seconds")
    note = {"host": socket.gethostname(), "pid": os.getpid(), "since": since, "doing": doing}
    with contextlib.suppress(OSError):
        os.ftruncate(handle, 0)
        os.pwrite(handle, json.dumps(note).encode(), 0)


def _holder(handle: int, path: Path) -> str:
    """Description of the holder of a lock: the last process that signed it."""
    try:
        note = json.loads(os.pread(handle, 4096, 0))
        return f"process {int(note['pid'])} on {note['host']}, which {note['doing']} since {note['since']}"
    except (OSError, ValueError, KeyError, TypeError):
        return f"another process, which holds {path}"
