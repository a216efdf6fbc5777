"""Import of a lens or a camera from the file of another program, chosen by the suffix of its name."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from pipeline.camera.parts.camera import PrintedCamera
from pipeline.optics.printed import PrintedLens
from pipeline.plugins.lenses.blender import is_blender, read_blender, read_blender_camera
from pipeline.plugins.lenses.codev import read_codev
from pipeline.plugins.lenses.flaresim import read_flaresim
from pipeline.plugins.lenses.glasses import Glasses
from pipeline.plugins.lenses.libpleno import read_libpleno
from pipeline.plugins.lenses.optical_bench import is_optical_bench, read_optical_bench
from pipeline.plugins.lenses.pbrt import read_pbrt
from pipeline.plugins.lenses.sizing import Beam, sized
from pipeline.plugins.lenses.table import read_table
from pipeline.plugins.lenses.text import UnreadableLens, computing, read_lines
from pipeline.plugins.lenses.zar import read_zar
from pipeline.plugins.lenses.zemax import read_zemax

_READERS: dict[str, tuple[str, Callable[..., PrintedLens]]] = {
    ".zmx": ("a Zemax lens file", read_zemax),
    ".zar": ("a Zemax archive", read_zar),
    ".seq": ("a CODE V sequence", read_codev),
    ".dat": ("a lens table of pbrt", read_pbrt),
    ".lens": ("a lens of FlareSim", read_flaresim),
}
_TABLE, _BENCH = "table", "optical bench"
_NAMED = (".zmx", ".zar", ".seq")


def read_lens(
    path: str | Path,
    spacing: str | None = None,
    *,
    apertures: str | None = None,
    scenario: int | None = None,
    catalogues: Sequence[Path] = (),
    replaced: Sequence[str] = (),
    **beam: float | None,
) -> PrintedLens:
    """A lens, with the file it comes from as its provenance.

    `spacing`: only for pbrt: the meaning of its thicknesses.
    `apertures`: only for FlareSim: the meaning of its column semi_ap.
    `scenario`: only for the Optical Bench: which of its focal lengths and focus distances, counted from 1.
    `catalogues`, `replaced`: only for Zemax, CODE V and tables: glasses in place of those that they name.
    `beam`: only for tables, f_number and half_field_deg for which missing semi-diameters are computed; they override
        those of the file.
    Raises UnreadableLens: the lens cannot be represented.
    """
    kind = _kind(path)
    beam_value = next((value for value in beam.values() if value is not None), None)
    for reason, value, kinds in (
        ("--spacing is for lens tables of pbrt (.dat)", spacing, (".dat",)),
        ("--apertures is for lenses of FlareSim (.lens)", apertures, (".lens",)),
        ("--scenario is for texts of the Optical Bench", scenario, (_BENCH,)),
        ("--f-number and --half-field are for tables (.csv, .tsv, .txt)", beam_value, (_TABLE,)),
        ("--glass and --glasses are for Zemax, CODE V and tables", [*catalogues, *replaced] or None, (*_NAMED, _TABLE)),
    ):
        if value is not None and kind not in kinds:
            raise UnreadableLens(path, reason)
    named = Glasses(path, catalogues, replaced)
    with computing(path):
        if kind == _TABLE:
            description, lens = _from_table(path, named, **beam)
        elif kind == _BENCH:
            description = "a text of the Optical Bench"
            lens = read_optical_bench(path, scenario)
        else:
            description, reader = _READERS[kind]
            choices = {".dat": spacing, ".lens": apertures, **dict.fromkeys(_NAMED, named)}
            lens = reader(path, choices[kind]) if kind in choices else reader(path)
    origin = f"Imported from {Path(path).name}, {description}."
    return replace(lens, provenance=(origin, *lens.provenance))


def read_camera_file(path: str | Path, lens: Path | None = None) -> PrintedCamera:
    """A camera with its parts; `lens` is the lens table of a camera of the Blender add-on.

    Raises UnreadableLens: the camera cannot be represented.
    """
    suffix = Path(path).suffix.lower()
    if suffix == ".js" and lens is not None:
        raise UnreadableLens(path, "--lens is for cameras of the Blender add-on (.csv)")
    with computing(path):
        return read_libpleno(path) if suffix == ".js" else read_blender_camera(path, lens)


def _kind(path: str | Path) -> str:
    """The lower-case suffix of the name, or the kind of text or table among those that share a suffix."""
    suffix = Path(path).suffix.lower()
    if suffix not in _READERS:
        return _BENCH if is_optical_bench(read_lines(path)) else _TABLE
    return suffix


def _from_table(
    path: str | Path, glasses: Glasses, f_number: float | None = None, half_field_deg: float | None = None
) -> tuple[str, PrintedLens]:
    """Words that describe a table of the Blender add-on or a plain one, and its lens, with all semi-diameters.

    `f_number` and `half_field_deg` replace those of the file. UnreadableLens where one is out of its range.
    """
    if is_blender(read_lines(path)):
        description = "a lens table of the Blender add-on"
        lens = read_blender(path)
        beam = Beam()  # such a table states none
    else:
        description = "a table"
        lens, beam = read_table(path, glasses)
    if f_number is not None:
        beam.f_number = f_number
    if half_field_deg is not None:
        beam.fields = [0.0, half_field_deg]
    if beam.f_number is not None and not beam.f_number > 0:
        raise UnreadableLens(path, f"the F-number must be above 0, not {beam.f_number:g}")
    for angle in beam.fields:
        if not 0 <= angle < 90:
            raise UnreadableLens(path, f"the half field must be at least 0 and below 90 degrees, not {angle:g}")
    return description, sized(path, lens, beam, unit_mm=1.0)
