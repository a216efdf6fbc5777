"""Shared parts of the readers of lens files: text in any encoding, numbers, glasses, the error with file and line."""

import codecs
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from pipeline.errors import UsageError
from pipeline.optics.printed import Lost

_MARKS = {codecs.BOM_UTF8: "utf-8-sig", codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}
_PLANE_PER_MM = 1e-12
"""Curvature below which a surface is a plane [1/mm]: its sag at 100 mm from the axis is 5e-9 mm."""


class UnreadableLens(UsageError):
    """A lens file cannot be read, or its lens cannot be represented."""

    def __init__(self, path: str | Path, reason: str, *, line: int | None = None, hint: str | None = None) -> None:
        location = f"{path}:{line}" if line is not None else f"{path}"
        super().__init__(f"{location}: {reason}", hint=hint)


@contextmanager
def computing(path: str | Path) -> Iterator[None]:
    """Context of a reader that reports impossible numbers as an error of the file."""
    try:
        yield
    except ArithmeticError as error:
        raise UnreadableLens(path, f"holds numbers from which no lens can be computed ({error})") from error


def read_lines(path: str | Path, raw: bytes | None = None) -> list[str]:
    """Lines of a text in UTF-16 with a byte-order mark, in UTF-8, or in latin-1; UnreadableLens if it is no text."""
    try:
        raw = Path(path).read_bytes() if raw is None else raw
    except OSError as error:
        raise UnreadableLens(path, error.strerror or "cannot be read") from None
    encoding = next((name for mark, name in _MARKS.items() if raw.startswith(mark)), None)
    try:
        text = raw.decode(encoding or "utf-8")
    except UnicodeDecodeError as error:
        if encoding:
            raise UnreadableLens(path, f"is not the {encoding} text that its first bytes announce: {error}") from None
        text = raw.decode("latin-1")
    if "\0" in text:
        raise UnreadableLens(path, "is no text", hint="archives end in .zar; UTF-16 needs its mark")
    return text.splitlines()


def number(path: str | Path, line: int, text: str, quantity: str) -> float:
    """A finite number as written by Fortran, C or Python."""
    try:
        value = float(text.replace("D", "E").replace("d", "e"))
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise UnreadableLens(path, f'{quantity} must be a number, not "{text}"', line=line)
    return value


def radius_mm(curvature_per_mm: float) -> float:
    """Radius of a curvature [mm]; that of a plane for a curvature that is only rounding."""
    return math.inf if abs(curvature_per_mm) < _PLANE_PER_MM else 1 / curvature_per_mm


def other_wavelengths(wavelengths_nm: Sequence[float], of_lens_nm: float | None = None) -> list[Lost]:
    """Loss of the design's other wavelengths, if any differs from that of the lens, by default the d line."""
    if all(abs(wavelength - (of_lens_nm or 587.6)) <= 0.1 for wavelength in wavelengths_nm):
        return []
    listed = ", ".join(f"{wavelength:g}" for wavelength in wavelengths_nm)
    at = "the d line" if of_lens_nm is None else f"{of_lens_nm:g} nm, the primary wavelength"
    loss = f"wavelengths {listed} nm: the lens has its indices at {at}, the camera its wavelength"
    return [Lost(loss)]
