"""File locks of the operating system: they end with the process that holds them, even if it is killed.

Locks only save work: a process without the lock computes the same bytes once more. The holder writes its name into the
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


def try_lock(handle: int, *, shared: bool = False) -> bool | None:
    """Try once to lock an open file; None means that this file system has no locks."""
    try:
        fcntl.flock(handle, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except OSError as error:
        return False if error.errno in (errno.EWOULDBLOCK, errno.EINTR) else None
    return True


@contextlib.contextmanager
def locked(
    path: Path,
    timeout_s: float = 3600.0,
    *,
    shared: bool = False,
    doing: str = "works there",
    say: Callable[[str], None] = lambda text: None,
) -> Iterator[bool]:
    """Hold the lock of a folder, or of a file, which is created; yields False after the timeout or without locks.

    `doing` completes the report of waiting processes, as in `makes rays/Left`. While this process waits, `say` receives
    a sentence about the holder after a second, and again every minute.
    """
    try:
        handle = _opened(path)
    except OSError:
        yield False
        return
    try:
        start = time.monotonic()
        say_at = start + _SILENT_S
        while (held := try_lock(handle, shared=shared)) is False and time.monotonic() < start + timeout_s:
            if time.monotonic() >= say_at:
                say(f"waiting for {_holder(handle, path)}")
                say_at += _REPEAT_S
            time.sleep(_POLL_S)
        if held and not shared:
            _sign(handle, doing)
        yield bool(held)
    finally:
        os.close(handle)


def _opened(path: Path) -> int:
    """Open a folder, which may be read-only, or open or create a lock file that is no link."""
    if path.is_dir():
        return os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        return os.open(path, os.O_RDWR | os.O_CREAT | _NO_LINK, 0o666)
    except PermissionError:  # a read-only one of another user can be locked, too
        return os.open(path, os.O_RDONLY | _NO_LINK)


def _sign(handle: int, doing: str) -> None:
    """Write the holder into a lock file, unless it is a folder, belongs to another user, or has several hard links."""
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
