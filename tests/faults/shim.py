"""Faults at every step: Python tells an audit hook before each call that opens, makes, renames or removes a file.

A step is such a call below a folder. At a chosen step the process is killed, or the call fails; nothing of this is in
the engine. Builds run in forks of a process that has loaded everything, so that one costs a fraction of a second.
"""

import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path

_STEPS = {"os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.chmod", "os.utime", "os.truncate", "os.link"}
_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC


class Shim:
    """Counts steps below a folder since it was armed, and acts at one of them."""

    def __init__(self) -> None:
        self.steps, self._root, self._act = 0, None, None
        sys.addaudithook(self._hook)  # a hook cannot be removed: this one does nothing unless armed

    def arm(self, root: Path, act: Callable[[int], None] | None = None) -> None:
        """Count from now on, and call `act` with the number of each step before it happens."""
        self.steps, self._act, self._root = 0, act, os.fspath(root)

    def _hook(self, event: str, args: tuple) -> None:
        if self._root is None or (event not in _STEPS and event != "open"):
            return
        if event == "open" and not (isinstance(args[2], int) and args[2] & _WRITING):
            return
        path = args[0]
        if not isinstance(path, str | os.PathLike) or not os.fspath(path).startswith(self._root):
            return
        self.steps += 1
        if self._act is not None:
            self._act(self.steps)


def kill_at(number: int) -> Callable[[int], None]:
    return lambda step: os.kill(os.getpid(), signal.SIGKILL) if step == number else None


def fail_at(number: int, error: int, *, for_good: bool) -> Callable[[int], None]:
    """The step fails with an errno, and all later ones too if it is `for_good`."""

    def act(step: int) -> None:
        if step == number or (for_good and step > number):
            raise OSError(error, os.strerror(error))

    return act


def in_fork(work: Callable[[], int]) -> int:
    """Exit code of some work done in a copy of this process; negative if a signal ended it."""
    pid = os.fork()
    if pid == 0:
        code = 99
        try:
            code = work()
        finally:
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
