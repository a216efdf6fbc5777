"""Common parts of the readers of lens files: text in any encoding, numbers, glasses, the error with file and line."""

import codecs
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from pipeline.errors import PipelineError, UsageError
from pipeline.optics.glass import catalogue
from pipeline.optics.printed import Lost

_MARKS = {codecs.BOM_UTF8: "utf-8-sig", codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}
_PLANE_PER_MM = 1e-12
"""Curvature below which a surface is a plane [1/mm]: its sag at 100 mm from the axis is 5e-9 mm."""


class UnreadableLens(UsageError):
    """A lens file cannot be read, or its lens cannot be represented."""

    def __init__(self, path: str | Path, reason: str, *, line: int | None = None, hint: str | None = None) -> None:
        where = f"{path}:{line}" if line is not None else f"{path}"
        super().__init__(f"{where}: {reason}", hint=hint)


@contextmanager
def computing(path: str | Path) -> Iterator[None]:
    """Context of a reader: numbers with which nothing can be computed are an error of the file."""
    try:
        yield
    except ArithmeticError as error:
        raise UnreadableLens(path, f"holds numbers from which no lens can be computed ({error})") from error


def read_lines(path: str | Path) -> list[str]:
    """Lines of a text in UTF-16 with a byte-order mark, in UTF-8, or in latin-1; UnreadableLens if it is no text."""
    try:
        raw = Path(path).read_bytes()
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


def radius_mm(curvature_per_mm: float) -> float:
    """Radius of a curvature [mm]; that of a plane for one that rounding has left over."""
    return math.inf if abs(curvature_per_mm) < _PLANE_PER_MM else 1 / curvature_per_mm


def other_wavelengths(wavelengths_nm: Sequence[float], of_lens_nm: float | None = None) -> list[Lost]:
    """The loss of wavelengths of a design, if any of them is not that of the lens, by default the d line."""
    if all(abs(wavelength - (of_lens_nm or 587.6)) <= 0.1 for wavelength in wavelengths_nm):
        return []
    shown = ", ".join(f"{wavelength:g}" for wavelength in wavelengths_nm)
    at = "the d line" if of_lens_nm is None else f"{of_lens_nm:g} nm, the primary wavelength"
    loss = f"wavelengths {shown} nm: the lens has its indices at {at}, the camera its wavelength"
    return [Lost(what=loss)]


class Medium(NamedTuple):
    """Index at the d line, Abbe number and name of what is behind a surface."""

    nd: float
    vd: float | None
    name: str


AIR = Medium(1.0, None, "")


def glass_of(path: str | Path, line: int, surface: int, name: str, vendors: Sequence[str]) -> Medium:
    """A glass of these vendors, or of any; UnreadableLens if it is unknown: a guessed index makes another lens."""
    listed = in_catalogue(name, vendors)
    if isinstance(listed, Medium):
        return listed
    shown = f"{name} of {', '.join(vendors)}" if vendors else name
    hint = listed.hint or "write nd and Vd into the file, as a model or fictitious glass"
    reason = f"surface {surface}: the file gives no index of glass {shown}, and {listed.what}"
    raise UnreadableLens(path, reason, line=line, hint=hint)


def in_catalogue(name: str, vendors: Sequence[str]) -> Medium | PipelineError:
    """A glass of the shipped catalogue, or the error with similar names: the only access of lens files to it."""
    error = PipelineError(f"the catalogue knows no index of {name} at the d line")
    # With vendors stated, the same name at another vendor would be another glass.
    for full in [f"{vendor.casefold()}:{name}" for vendor in vendors] or [name]:
        try:
            glass = catalogue.find(_spelt(full))
        except PipelineError as unknown:
            error = unknown
            continue
        if glass.nd is not None:
            return Medium(glass.nd, glass.vd, glass.label)
    return error


def _spelt(full: str) -> str:
    """A name without its hyphens, as in NSSK2 of CODE V, with those of the only matching glass."""
    vendor, _, bare = full.rpartition(":")
    entries = [entry for entry in catalogue.catalogue() if vendor in ("", entry.vendor)]
    if any(entry.name.casefold() == bare.casefold() for entry in entries):
        return full
    plain = bare.replace("-", "").casefold()
    same = {entry.label for entry in entries if entry.name.replace("-", "").casefold() == plain}
    return same.pop() if len(same) == 1 else full
