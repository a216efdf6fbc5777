"""Files of other programs to stages: read, written as USD, checked. What is lost on the way is said."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from pipeline.errors import UsageError
from pipeline.files.lenses.read import read_lens
from pipeline.files.lenses.text import UnreadableLens
from pipeline.optics.prescription import PrescriptionError
from pipeline.optics.printed import Lost, PrintedLens
from pipeline.scene.load import load
from pipeline.scene.problems import Problem
from pipeline.scene.writing import lens_text


@dataclass(frozen=True, slots=True, kw_only=True)
class Imported:
    """A lens as a stage.

    Attributes
    ----------
    text : str
        The .usda file.
    warnings : tuple of str
        What the file says and the lens does not, with file and line.
    """

    text: str
    warnings: tuple[str, ...]


def import_lens(path: Path, spacing: str | None = None) -> Imported:
    """The lens of a file as a stage of its own.

    Raises
    ------
    UnreadableLens
        The file cannot be read, or its lens cannot be represented.
    """
    lens = read_lens(path, spacing)
    try:
        text = lens_text(replace(lens, provenance=(*lens.provenance, *_losses(lens))))
    except PrescriptionError as error:
        raise UnreadableLens(path, error.what, hint=error.hint) from None
    return Imported(text=text, warnings=tuple(_warnings(path, lens)))


def write_stage(text: str, out: Path) -> list[Problem]:
    """Write a new stage and check it: its problems."""
    if out.suffix != ".usda":
        raise UsageError(f"{out} must end in .usda")
    try:
        with out.open("x", encoding="utf-8", newline="\n") as stream:
            stream.write(text)
    except FileExistsError:
        raise UsageError(f"{out} exists", hint="choose another name, or remove it") from None
    except OSError as error:
        raise UsageError(f"{out} cannot be written: {error.strerror}") from None
    return load(out).problems


def _losses(lens: PrintedLens) -> Iterator[str]:
    if lens.lost:
        yield "Not part of this lens, or decided on import: " + "; ".join(one.what for one in lens.lost) + "."


def _warnings(path: Path, lens: PrintedLens) -> Iterator[str]:
    for one in lens.lost:
        yield f"{_place(path, one)}: warning: {one.what}"


def _place(path: Path, lost: Lost) -> str:
    return f"{path}:{lost.line}" if lost.line else f"{path}"
