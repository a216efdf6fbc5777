"""Standard streams of a command in any state: closed, full, or on a terminal that does not exist any more.

A closed stream is opened as /dev/null; otherwise the next opened file would get its number and receive the output of
libraries. Messages on stderr are for people: if they cannot be written they are lost, without further effect.
"""

import io
import os
import sys


class Stderr(io.TextIOWrapper):
    """A stream of messages. Writing to it never fails."""

    def write(self, text: str) -> int:
        """Write the text if possible."""
        try:
            return super().write(text)
        except OSError:
            return len(text)

    def flush(self) -> None:
        """Flush the stream if possible."""
        try:
            super().flush()
        except OSError:
            return


def mend() -> None:
    """Open closed streams, and make stderr tolerant."""
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
    raw = os.fdopen(2, "wb", buffering=0, closefd=False)
    sys.stderr = Stderr(raw, errors="backslashreplace", write_through=True)  # type: ignore[type-var]
