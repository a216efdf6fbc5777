"""The writers of all formats, by name."""

from collections.abc import Callable
from pathlib import Path

from pipeline.exports.material import Material
from pipeline.exports.writers import colmap, deltille, kalibr, libpleno, mrcal, opencv, puzzlepaint, tables

Writer = Callable[[Material, Path], None]
WRITERS: dict[str, Writer] = {
    "opencv": opencv.write,
    "mrcal": mrcal.write,
    "kalibr": kalibr.write,
    "colmap": colmap.write,
    "puzzlepaint": puzzlepaint.write,
    "deltille": deltille.write,
    "libpleno": libpleno.write,
    "parquet": tables.write_parquet,
    "npz": tables.write_npz,
}
"""Format -> what writes its files into a folder, of a material in its conventions; as many as in CONVENTIONS."""
