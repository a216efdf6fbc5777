"""Limits that the system sets for this process, and its working directory: sufficient, or a clear error.

Below these limits processes crash, or an import fails anywhere.
"""

import os
import resource

from pipeline.errors import EnvironmentFault

FILES = 64
"""Open files: a driver with two workers takes about half of them."""

ADDRESSES = 1_500_000_000
"""Bytes of address space: USD, Numba and their compiled code take most of it before the first ray."""


def require_room() -> None:
    """Raise the limits as far as this process may, and check that they are sufficient.

    Raises
    ------
    EnvironmentFault
        A limit is too low; the error states the command that raises it.
    """
    try:
        os.getcwd()  # noqa: PTH109 (of the system, whatever Python thinks of it)
    except OSError as error:
        why = f"there is no working directory: {error.strerror}"
        raise EnvironmentFault(why, hint="it was removed, or may not be read; `cd` to another one") from None
    _require(resource.RLIMIT_NOFILE, FILES, "open files", f"ulimit -n {FILES * 16}")
    _require(resource.RLIMIT_AS, ADDRESSES, "bytes of address space", "ulimit -v unlimited")


def _require(which: int, least: int, unit: str, command: str) -> None:
    soft, hard = resource.getrlimit(which)
    if _is_enough(soft, least):
        return
    if not _is_enough(hard, least):
        raise EnvironmentFault(
            f"this process may have {hard:,} {unit}, and needs {least:,}", hint=f"`{command}` in the shell, before"
        )
    resource.setrlimit(which, (least, hard))


def _is_enough(limit: int, least: int) -> bool:
    return limit == resource.RLIM_INFINITY or limit >= least
