"""Landlock, access control by the kernel: afterwards this process can read below some folders and open nothing else.

Links cannot circumvent it, even if they change: the kernel checks the opened file, not its name. As far as this
kernel supports it, writing, executing, TCP, abstract sockets and signals to other processes are forbidden, too.

References
----------
https://docs.kernel.org/userspace-api/landlock.html
"""

import contextlib
import ctypes
import os
import struct
from collections.abc import Iterable
from pathlib import Path

from pipeline.confine.kernel import NO_NEW_PRIVILEGES, prctl, syscall

_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446
"""Numbers of the system calls, the same on all machines."""
_ASK_VERSION = 1
"""LANDLOCK_CREATE_RULESET_VERSION of linux/landlock.h, as all below."""
_PATH_BENEATH = 1
"""LANDLOCK_RULE_PATH_BENEATH."""
_READ_FILE, _READ_DIR = 1 << 2, 1 << 3
"""LANDLOCK_ACCESS_FS_READ_FILE and _READ_DIR."""
_RIGHTS_OF_VERSION = {1: 13, 2: 14, 3: 15, 4: 15, 5: 16}
"""Number of file rights that each version knows; later versions know no more."""
_NO_TCP, _NO_SCOPES = 0b11, 0b11
"""Rights that are removed: bind and connect; access to abstract sockets and signals."""


def version() -> int:
    """Version of Landlock's interface in this kernel; 0 without Landlock."""
    return max(0, syscall(_CREATE_RULESET, None, 0, _ASK_VERSION))


def restrict(readable: Iterable[Path]) -> int:
    """Restrict this thread, and everything that it starts, to reading files and folders below some paths.

    Returns
    -------
    int
        The version in force; 0 if the kernel does not know Landlock, and then nothing is restricted.
    """
    known = version()
    if not known:
        return 0
    rights = (1 << _RIGHTS_OF_VERSION.get(known, 16)) - 1
    rules = struct.pack("=QQQ", rights, _NO_TCP if known >= 4 else 0, _NO_SCOPES if known >= 6 else 0)
    size = 24 if known >= 6 else 16 if known >= 4 else 8
    ruleset = syscall(_CREATE_RULESET, ctypes.create_string_buffer(rules, 24), size, 0)
    if ruleset < 0:
        return 0
    try:
        for path in readable:
            with contextlib.suppress(OSError):  # a missing path needs no rule
                _allow(ruleset, path)
        prctl(NO_NEW_PRIVILEGES, 1)
        return known if syscall(_RESTRICT_SELF, ruleset, 0) == 0 else 0
    finally:
        os.close(ruleset)


def _allow(ruleset: int, path: Path) -> None:
    place = os.open(path, os.O_PATH | os.O_CLOEXEC)
    try:
        rights = _READ_FILE | (_READ_DIR if path.is_dir() else 0)
        syscall(
            _ADD_RULE, ruleset, _PATH_BENEATH, ctypes.create_string_buffer(struct.pack("=Qi", rights, place), 12), 0
        )
    finally:
        os.close(place)
