"""Index of a glass that a lens file only names: from the catalogue, never guessed."""

from collections.abc import Sequence
from pathlib import Path

from pipeline.errors import PipelineError
from pipeline.files.lenses.text import UnreadableLens
from pipeline.optics.glass import catalogue


def medium(
    path: str | Path, line: int, surface: int, name: str, vendors: Sequence[str]
) -> tuple[float, float | None, str]:
    """Index at the d line, Abbe number and full name of a glass from these vendors or, if none is stated, from any.

    Raises
    ------
    UnreadableLens
        The glass is unknown: a lens with a guessed index would be another lens.
    """
    found = known(name, vendors)
    if not isinstance(found, PipelineError):
        return found
    shown = f"{name} of {', '.join(vendors)}" if vendors else name
    hint = found.hint or "write nd and Vd into the file, as a model or fictitious glass"
    what = f"surface {surface}: the file gives no index of glass {shown}, and {found.what}"
    raise UnreadableLens(path, what, line=line, hint=hint)


def known(name: str, vendors: Sequence[str]) -> tuple[float, float | None, str] | PipelineError:
    """A glass of the shipped catalogue, or the error with similar names: the only access of lens files to the
    catalogue.
    """
    error = PipelineError(f"the catalogue knows no index of {name} at the d line")
    # With vendors stated, the same name at another vendor would be another glass.
    for full in [f"{vendor.casefold()}:{name}" for vendor in vendors] or [name]:
        try:
            glass = catalogue.find(_spelt(full))
        except PipelineError as found:
            error = found
            continue
        if glass.nd is not None:
            return glass.nd, glass.vd, glass.label
    return error


def _spelt(full: str) -> str:
    """A name without its hyphens, as in NSSK2 of CODE V, with those of the only matching glass."""
    vendor, _, bare = full.rpartition(":")
    entries = [one for one in catalogue.catalogue() if vendor in ("", one.vendor)]
    if any(one.name.casefold() == bare.casefold() for one in entries):
        return full
    plain = bare.replace("-", "").casefold()
    same = {one.label for one in entries if one.name.replace("-", "").casefold() == plain}
    return same.pop() if len(same) == 1 else full
