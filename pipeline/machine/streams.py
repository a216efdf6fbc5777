"""Standard streams of a command as they may be: closed, full, on a terminal that is gone.

One that is closed counts as /dev/null: else the next file that is opened takes its number, and what a library prints
ends up in there. On stderr stands what a person reads: where it cannot be written it is lost, and changes nothing.
"""

import io
import os
import sys


class Stderr(io.TextIOWrapper):
    """A stream for people. Writing to it never fails."""

    def write(self, text: str) -> int:
        """Write what can be written."""
        try:
            return super().write(text)
        except OSError:
            return len(text)

    def flush(self) -> None:
        """Write what can be written."""
        try:
            super().flush()
        except OSError:
            return


def mend() -> None:
    """Open what is closed, and make stderr forgiving."""
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number: this one
            os.set_inheritable(number, True)
    if sys.stdin is None:
        sys.stdin = os.fdopen(0, encoding="utf-8", closefd=False)
    if sys.stdout is None:
        sys.stdout = os.fdopen(1, "w", encoding="utf-8", closefd=False)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="surrogateescape")  # a path comes out as it came in
    raw = os.fdopen(2, "wb", buffering=0, closefd=False)
    sys.stderr = Stderr(raw, errors="backslashreplace", write_through=True)  # type: ignore[type-var]
