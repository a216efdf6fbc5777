"""Standard streams, resource limits and the working directory of this process, made safe in any state."""

import contextlib
import io
import os
import resource
import select
import sys
import threading
import warnings
from collections.abc import Iterator

from pipeline.errors import EnvironmentFault
from pipeline.spelling import for_terminals

FILES = 64
"""Open files: a driver with two workers takes about half of them."""
ADDRESSES = 1_500_000_000
"""Bytes of address space: USD, Numba and their compiled code take most of it before the first ray."""


class Stderr(io.TextIOWrapper):
    """A stream of messages for people. Writing to it never fails; text that cannot be written is lost.

    Control characters are escaped, except for streams that interpret and display them themselves.
    """

    def __init__(self, *, draws: bool = False) -> None:
        raw = os.fdopen(2, "wb", buffering=0, closefd=False)
        super().__init__(raw, errors="backslashreplace", write_through=True)  # type: ignore[type-var]
        self._draws = draws

    def write(self, text: str) -> int:
        try:
            return super().write(text if self._draws else for_terminals(text))
        except OSError:
            return len(text)

    def flush(self) -> None:
        """Flush the stream if possible."""
        try:
            super().flush()
        except OSError:
            return


def end_with_parent() -> None:
    """End this process, whatever it does, when no other one has the far end of its standard input open any more."""

    def wait() -> None:
        far_end = select.poll()
        far_end.register(0, 0)  # that it is closed is told unasked
        far_end.poll()
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


@contextlib.contextmanager
def hushed() -> Iterator[None]:
    """Context in which nothing reaches stderr: libraries write there unasked, and quote files unescaped."""
    saved = os.dup(2)
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 2)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        os.dup2(saved, 2)
        os.close(saved)
        os.close(nothing)


def mend_streams() -> None:
    """Open closed standard streams as /dev/null, and make stderr tolerant.

    Otherwise the next opened file would get the number of a closed stream and receive the output of libraries.
    """
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number, which is this one
            os.set_inheritable(number, True)
    if sys.stdin is None:
        sys.stdin = os.fdopen(0, encoding="utf-8", closefd=False)
    if sys.stdout is None:
        sys.stdout = os.fdopen(1, "w", encoding="utf-8", closefd=False)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="surrogateescape")  # a path is printed as it was typed
    sys.stderr = Stderr()


def require_resources() -> None:
    """Raise the resource limits below which this process would crash; EnvironmentFault if it may not.

    The error states the command that raises a limit. A missing working directory is an error, too.
    """
    try:
        os.getcwd()  # noqa: PTH109 (of the system, whatever Python thinks of it)
    except OSError as error:
        message = f"there is no working directory: {error.strerror}"
        raise EnvironmentFault(message, hint="it was removed, or may not be read; `cd` to another one") from None
    _require(resource.RLIMIT_NOFILE, FILES, "open files", f"ulimit -n {FILES * 16}")
    _require(resource.RLIMIT_AS, ADDRESSES, "bytes of address space", "ulimit -v unlimited")


def _require(limit: int, least: int, unit: str, command: str) -> None:
    """Raise a soft limit of this process to `least`; EnvironmentFault if the hard limit forbids it.

    `command` raises the hard limit.
    """
    soft, hard = resource.getrlimit(limit)
    if soft == resource.RLIM_INFINITY or soft >= least:
        return
    if hard != resource.RLIM_INFINITY and hard < least:
        raise EnvironmentFault(
            f"this process may have {hard:,} {unit}, and needs {least:,}", hint=f"`{command}` in the shell, before"
        )
    resource.setrlimit(limit, (least, hard))
