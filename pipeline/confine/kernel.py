"""Two calls of the operating system that Python does not offer."""

import ctypes
import sys

NO_NEW_PRIVILEGES = 38
"""PR_SET_NO_NEW_PRIVS of linux/prctl.h: no program that is executed from now on gains rights."""
END_WITH_PARENT = 1
"""PR_SET_PDEATHSIG of linux/prctl.h: send a signal when the parent ends."""
FILTER_CALLS = 22
"""PR_SET_SECCOMP of linux/prctl.h."""


def prctl(option: int, *arguments: object) -> bool:
    """Set an option of this process; whether the kernel accepted it."""
    if sys.platform != "linux":
        return False
    filled = [*arguments, 0, 0, 0, 0][:4]
    return _library().prctl(ctypes.c_int(option), *map(_word, filled)) == 0


def syscall(number: int, *arguments: object) -> int:
    """Result of a system call; -1 if it failed or does not exist."""
    return int(_library().syscall(_word(number), *map(_word, arguments))) if sys.platform == "linux" else -1


def _library() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def _word(value: object) -> object:
    """A number as the 64 bits that the kernel expects."""
    return ctypes.c_long(value) if isinstance(value, int) else value
