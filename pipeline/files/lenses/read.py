"""A lens from the file of another program, by the ending of its name."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from pipeline.files.lenses.blender import read_blender
from pipeline.files.lenses.codev import read_codev
from pipeline.files.lenses.pbrt import read_pbrt
from pipeline.files.lenses.text import UnreadableLens
from pipeline.files.lenses.zemax import read_zemax
from pipeline.optics.printed import PrintedLens

_READERS: dict[str, tuple[str, Callable[[str | Path], PrintedLens]]] = {
    ".zmx": ("a Zemax lens file", read_zemax),
    ".seq": ("a CODE V sequence", read_codev),
    ".dat": ("a lens table of pbrt", read_pbrt),
    ".csv": ("a lens table of the Blender add-on", read_blender),
}


def read_lens(path: str | Path, spacing: str | None = None) -> PrintedLens:
    """A lens, with the file it comes from as its provenance.

    Parameters
    ----------
    path : path
    spacing : {"before", "after"}, optional
        Only for pbrt: what its thicknesses are.

    Raises
    ------
    UnreadableLens
        The file is of no known kind, or its lens cannot be represented.
    """
    suffix = Path(path).suffix.lower()
    if suffix == ".js":
        raise UnreadableLens(path, "is a camera of libpleno", hint="pipeline import camera FILE")
    if suffix not in _READERS:
        kinds = ", ".join(f"{ending} ({what})" for ending, (what, _) in _READERS.items())
        raise UnreadableLens(path, f'lens files do not end in "{suffix}"', hint=f"known are {kinds}")
    if spacing and suffix != ".dat":
        raise UnreadableLens(path, "--spacing is for lens tables of pbrt (.dat)")
    what, reader = _READERS[suffix]
    lens = read_pbrt(path, spacing) if suffix == ".dat" else reader(path)
    origin = f"Imported from {Path(path).name}, {what}."
    return replace(lens, provenance=(origin, *lens.provenance))
