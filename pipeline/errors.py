"""Base classes of the errors that users see, and warnings. Each error carries its facts and says how to mend it.

Each room derives its own errors from these, where it raises them; this module does not grow with them.
"""

import functools
import sys
from enum import IntEnum


class Exit(IntEnum):
    """Exit codes of the command; docs/engine.md tabulates their meaning."""

    DONE = 0
    FAILED = 1
    USAGE = 2
    WORK = 3
    OTHER_BYTES = 4
    MACHINE = 5
    NOT_CONFIRMED = 6
    BUG = 70
    HUNG_UP = 129
    INTERRUPTED = 130
    READER_GONE = 141
    TERMINATED = 143


class PipelineError(Exception):
    """An error that a user can mend.

    `message` is one sentence with the offending value, `hint` says how to mend it, and `code` is the stable name of the
    kind of mistake, under which `check` reports it; by default that of the class.
    """

    exit_code = Exit.FAILED
    code = ""

    def __init__(self, message: str, *, hint: str | None = None, code: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint
        self.code = code or type(self).code

    @property
    def as_text(self) -> str:
        """The error as the command prints it."""
        return f"error: {self}"

    def __str__(self) -> str:
        return f"{self.message}\n    hint: {self.hint}" if self.hint else self.message


class UsageError(PipelineError):
    """A wrong argument, or a stage that does not pass `check` (exit code 2)."""

    exit_code = Exit.USAGE


class EnvironmentFault(PipelineError):
    """A fault of the machine: full disk, read-only folder, other versions (exit code 5)."""

    exit_code = Exit.MACHINE


@functools.cache
def warn_once(text: str) -> None:
    """Warn on stderr, once in a process: of a command, or in the log of the task that met the damage."""
    print(f"warning: {text}", file=sys.stderr, flush=True)
