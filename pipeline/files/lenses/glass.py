"""The index of a glass that a lens file only names: as the catalogue has it, and never a guess."""

import importlib
from collections.abc import Sequence
from pathlib import Path

from pipeline.errors import PipelineError
from pipeline.files.lenses.text import UnreadableLens


def medium(
    path: str | Path, line: int, surface: int, name: str, vendors: Sequence[str]
) -> tuple[float, float | None, str]:
    """Index at the d line, Abbe number and full name of a glass, at these vendors or, if none is stated, at any.

    Raises
    ------
    UnreadableLens
        Nobody knows the glass: a lens with a guessed index would be another lens.
    """
    found = known(name, vendors)
    if found and not isinstance(found, PipelineError):
        return found
    shown = f"{name} of {', '.join(vendors)}" if vendors else name
    reason = found.what if found else "no catalogue is at hand"
    hint = found.hint if found and found.hint else "write nd and Vd into the file, as a model or fictitious glass"
    what = f"surface {surface}: the file gives no index of glass {shown}, and {reason}"
    raise UnreadableLens(path, what, line=line, hint=hint)


def known(name: str, vendors: Sequence[str]) -> tuple[float, float | None, str] | PipelineError | None:
    """A glass of the shipped catalogue, or the error with near names; None where there is no catalogue.

    The one place where lens files meet the catalogue.
    """
    try:
        catalogue = importlib.import_module("pipeline.optics.glass.catalogue")
    except ModuleNotFoundError:
        return None
    error: PipelineError | None = None
    # With vendors stated, the same name at another vendor would be another glass.
    for full in [f"{vendor.casefold()}:{name}" for vendor in vendors] or [name]:
        try:
            glass = catalogue.find(_spelt(catalogue, full))
        except PipelineError as found:
            error = found
            continue
        if glass.nd is not None:
            return glass.nd, glass.vd, glass.label
    return error


def _spelt(catalogue: object, full: str) -> str:
    """A name that has lost its hyphens, as in NSSK2 of CODE V, with those of the only glass that it can be."""
    vendor, _, bare = full.rpartition(":")
    entries = [one for one in catalogue.catalogue() if vendor in ("", one.vendor)]  # type: ignore[attr-defined]
    if any(one.name.casefold() == bare.casefold() for one in entries):
        return full
    plain = bare.replace("-", "").casefold()
    same = {one.label for one in entries if one.name.replace("-", "").casefold() == plain}
    return same.pop() if len(same) == 1 else full
