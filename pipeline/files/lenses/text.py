"""Common parts of the readers of lens files: text in any encoding, numbers, and the error with file and line."""

import codecs
import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pipeline.errors import UsageError

_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)


class UnreadableLens(UsageError):
    """A lens file cannot be read, or its lens cannot be represented.

    Parameters
    ----------
    path : path
        The file.
    reason : str
        Description of the problem, with the offending value.
    line : int, optional
        Line, counted from 1.
    hint : str, optional
        A way to mend it.
    """

    def __init__(self, path: str | Path, reason: str, *, line: int | None = None, hint: str | None = None) -> None:
        where = f"{path}:{line}" if line is not None else f"{path}"
        super().__init__(f"{where}: {reason}", hint=hint)
        self.path = Path(path)
        self.reason = reason
        self.line = line


@contextmanager
def computing(path: str | Path) -> Iterator[None]:
    """Context of a reader: numbers with which nothing can be computed are an error of the file."""
    try:
        yield
    except ArithmeticError as error:
        raise UnreadableLens(path, f"holds numbers from which no lens can be computed ({error})") from error


def read_lines(path: str | Path) -> list[str]:
    """Lines of a text in UTF-16 with a byte-order mark, in UTF-8, or else in latin-1.

    Raises
    ------
    UnreadableLens
        The file does not exist or is not text.
    """
    try:
        raw = Path(path).read_bytes()
    except OSError as error:
        raise UnreadableLens(path, error.strerror or "cannot be read") from None
    encoding = next((name for mark, name in _MARKS if raw.startswith(mark)), None)
    try:
        text = raw.decode(encoding or "utf-8")
    except UnicodeDecodeError as error:
        if encoding:
            raise UnreadableLens(path, f"is not the {encoding} text that its first bytes announce: {error}") from None
        text = raw.decode("latin-1")
    if "\0" in text:
        raise UnreadableLens(path, "is no text", hint="an archive (.zar) must be unpacked; UTF-16 needs its mark")
    return text.splitlines()


def number(path: str | Path, line: int, text: str, what: str) -> float:
    """A finite number as written by Fortran, C or Python."""
    try:
        value = float(text.replace("D", "E").replace("d", "e"))
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise UnreadableLens(path, f'{what} must be a number, not "{text}"', line=line)
    return value


def radius_of(curvature: float) -> float:
    """1 / curvature; infinite for a plane."""
    return 1 / curvature if curvature else math.inf
