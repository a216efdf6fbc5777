"""The writers of all formats, by name."""

from collections.abc import Callable
from pathlib import Path

from pipeline.exports.material import Material
from pipeline.exports.writers import (
    colmap,
    kalibr,
    lensboy,
    mrcal,
    opencv,
    tables,
    vision_calibration,
)
from pipeline.exports.writers.maps import depth, lightfield, omni_lut, rays, stmap
from pipeline.exports.writers.plenoptic import bok, lftoolbox, libpleno, pip, plenopticam, raytrix

Writer = Callable[[Material, Path], None]
WRITERS: dict[str, Writer] = {
    "opencv": opencv.write,
    "opencv-multiview": opencv.write_multiview,
    "mrcal": mrcal.write,
    "kalibr": kalibr.write,
    "colmap": colmap.write,
    "lensboy": lensboy.write,
    "vision-calibration": vision_calibration.write,
    "libpleno": libpleno.write,
    "raytrix": raytrix.write,
    "pip": pip.write,
    "bok": bok.write,
    "lftoolbox": lftoolbox.write,
    "plenopticam": plenopticam.write,
    "parquet": tables.write_parquet,
    "npz": tables.write_npz,
    "rays": rays.write,
    "stmap": stmap.write,
    "omni-lut": omni_lut.write,
    "depth": depth.write,
    "lightfield": lightfield.write,
}
"""Format -> what writes its files into a folder, of a material in its conventions; as many as in CONVENTIONS."""
