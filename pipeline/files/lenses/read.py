"""Import of a lens from the file of another program, chosen by the suffix of its name."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from pipeline.files.lenses.blender import is_blender, read_blender
from pipeline.files.lenses.codev import read_codev
from pipeline.files.lenses.pbrt import read_pbrt
from pipeline.files.lenses.sizing import Beam, sized
from pipeline.files.lenses.table import read_table
from pipeline.files.lenses.text import UnreadableLens, read_lines
from pipeline.files.lenses.zemax import read_zemax
from pipeline.optics.printed import PrintedLens

_READERS: dict[str, tuple[str, Callable[[str | Path], PrintedLens]]] = {
    ".zmx": ("a Zemax lens file", read_zemax),
    ".seq": ("a CODE V sequence", read_codev),
    ".dat": ("a lens table of pbrt", read_pbrt),
}
_TABLES = (".csv", ".tsv", ".txt")


def read_lens(
    path: str | Path,
    spacing: str | None = None,
    *,
    f_number: float | None = None,
    half_field_deg: float | None = None,
) -> PrintedLens:
    """A lens, with the file it comes from as its provenance.

    Parameters
    ----------
    path : path
    spacing : {"before", "after"}, optional
        Only for pbrt: the meaning of its thicknesses.
    f_number, half_field_deg : float, optional
        Only for tables: the beam for which semi-diameters that are missing are computed; they override those of the
        file.

    Raises
    ------
    UnreadableLens
        The format is unknown, or the lens cannot be represented.
    """
    suffix = Path(path).suffix.lower()
    if suffix == ".js":
        raise UnreadableLens(path, "is a camera of libpleno", hint="pipeline import camera FILE")
    if suffix not in (*_READERS, *_TABLES):
        kinds = ", ".join(f"{ending} ({what})" for ending, (what, _) in _READERS.items())
        kinds += f", {', '.join(_TABLES)} (a plain table, or one of the Blender add-on)"
        raise UnreadableLens(path, f'lens files do not end in "{suffix}"', hint=f"known are {kinds}")
    if spacing and suffix != ".dat":
        raise UnreadableLens(path, "--spacing is for lens tables of pbrt (.dat)")
    if suffix in _TABLES:
        what, lens = _from_table(path, f_number, half_field_deg)
    elif f_number is not None or half_field_deg is not None:
        raise UnreadableLens(path, "--f-number and --half-field are for tables (.csv, .tsv, .txt)")
    else:
        what, reader = _READERS[suffix]
        lens = read_pbrt(path, spacing) if suffix == ".dat" else reader(path)
    origin = f"Imported from {Path(path).name}, {what}."
    return replace(lens, provenance=(origin, *lens.provenance))


def _from_table(path: str | Path, f_number: float | None, half_field_deg: float | None) -> tuple[str, PrintedLens]:
    """A lens from a table of the Blender add-on or a plain table, with all semi-diameters known."""
    if is_blender(read_lines(path)):
        what, lens, beam = "a lens table of the Blender add-on", read_blender(path), Beam()
    else:
        what, (lens, beam) = "a table", read_table(path)
    if f_number is not None:
        beam.f_number = f_number
    if half_field_deg is not None:
        beam.fields = [0.0, half_field_deg]
    if beam.f_number is not None and not beam.f_number > 0:
        raise UnreadableLens(path, f"the F-number must be above 0, not {beam.f_number:g}")
    if any(not 0 <= angle < 90 for angle in beam.fields):
        raise UnreadableLens(path, f"the half field must be at least 0 and below 90 degrees, not {beam.fields[-1]:g}")
    return what, sized(path, lens, beam, 1.0)
