"""Problems of a stage, as data and as text."""

import contextlib
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pipeline.errors import EnvironmentFault, PipelineError, UsageError
from pipeline.spelling import did_you_mean, printable

__all__ = ["Problem", "StageError", "did_you_mean", "shown_path"]

IMPOSSIBLE = "impossible"
"""Code of parts that do not make up what their prim stands for. Where another error is told it follows from that."""
_LONGEST_LINE = 1000
"""Characters in a line of a problem: names and paths of a stage may be of any length, and words of ours stay far
below."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """One finding, with the place in the text where a person can mend it.

    Attributes
    ----------
    severity : str
        `error` or `warning`.
    code : str
        Stable name of the kind of problem: scripts and documentation refer to it.
    message : str
        One sentence: what is wrong, with the offending value.
    file : str or None
        Relative to the working directory where it lies below it, else absolute.
    line, column : int or None
        Counted from 1.
    at : str or None
        Path on the composed stage.
    hint : str or None
        How to mend it.
    """

    severity: str = "error"
    code: str
    message: str
    file: str | None = None
    line: int | None = None
    column: int | None = None
    at: str | None = None
    hint: str | None = None

    @property
    def is_error(self) -> bool:
        """Whether it keeps the stage from being built."""
        return self.severity == "error"

    def to_dict(self) -> dict[str, Any]:
        """Plain values for `--json`, every field present."""
        return asdict(self)

    def __str__(self) -> str:
        place = ":".join(str(part) for part in (self.file, self.line, self.column) if part is not None)
        lines = [f"{place or '<stage>'}: {self.severity}: {self.message} [{self.code}]"]
        if self.at:
            lines.append(f"    at <{self.at}>")
        if self.hint:
            lines.append(f"    hint: {self.hint}")
        # Names and paths of a stage may hold anything, escape sequences of terminals included.
        return "\n".join(printable(shortened(line, _LONGEST_LINE)) for line in lines)


class StageError(UsageError):
    """A stage that does not pass `check`; carries all its problems."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems = list(problems)
        super().__init__("\n".join(map(str, self.problems)))

    @property
    def told(self) -> str:
        """As the command prints it: every problem says itself whether it is an error."""
        return str(self)


@contextlib.contextmanager
def blamed_on(file: str | None, line: int | None, at: str) -> Iterator[None]:
    """An error of what a prim stands for becomes a problem of the stage, at the prim."""
    try:
        yield
    except (UsageError, EnvironmentFault):
        raise
    except PipelineError as error:
        problem = Problem(code=IMPOSSIBLE, message=error.what, file=file, line=line, at=at, hint=error.hint)
        raise StageError([problem]) from error


def shown_path(path: str | Path) -> str:
    """A path as messages print it: relative to the working directory when below it."""
    path = Path(path)
    try:
        return path.relative_to(Path.cwd()).as_posix()
    except ValueError:
        return path.as_posix()


def shortened(text: str, most: int = 100) -> str:
    """A text of a stage as messages quote it: its first characters."""
    return text if len(text) <= most else f"{text[:most]}…"
