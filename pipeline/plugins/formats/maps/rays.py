"""Rays of all pixels: EXR for pictures, npz in double precision. A band of rows is in memory at a time."""

from pathlib import Path

import numpy as np

from pipeline.exports.material import ExportCamera, Material
from pipeline.files.exr_bands import BandedPart, write_bands
from pipeline.files.npy import write_npz
from pipeline.formats import Cameras, Format, Microlenses, Origin, Reads, Unit
from pipeline.plugins.formats.maps.traced import TracedPixels, about, traced

FORMAT = Format(
    consumer="ray tracers and robotics simulators; NumPy, OpenEXR",
    note="origin and direction of the ray of each pixel, the top row first, in the vision frame",
    source="CONVENTIONS.md, The ray of a position",
    cameras=Cameras.ANY,
    reads=frozenset({Reads.RAYS}),
    files=("<camera>.rays.npz", "<camera>.rays.exr"),
    origin=Origin.ZERO,
    unit=Unit.MM,
    microlenses=Microlenses.AXIAL,
)

_VECTORS = {"origin": slice(0, 3), "direction": slice(3, 6)}


def write(material: Material, folder: Path) -> None:
    """Write both files of every camera."""
    for camera in material.cameras:
        with traced(camera, folder) as pixels:
            pixels.rays[..., _VECTORS["origin"]] *= camera.rays.convention.scale
            numbers = {} if pixels.microlenses is None else {"microlenses": pixels.microlenses}
            vectors = {name: pixels.rays[..., axes] for name, axes in _VECTORS.items()}  # NumPy writes them in pieces
            arrays = {"ends_px": camera.rays.ends, **numbers, **vectors}
            write_npz(folder / f"{camera.name}.rays.npz", material.remarks, arrays)
            _write_exr(folder / f"{camera.name}.rays.exr", material, camera, pixels)


def _write_exr(path: Path, material: Material, camera: ExportCamera, pixels: TracedPixels) -> None:
    """Write rays, and numbers of microlenses, as channels of an EXR file."""
    names = tuple(f"{name}.{axis}" for name in _VECTORS for axis in "XYZ")
    if pixels.microlenses is not None:
        names = (*names, "microlens.k", "microlens.l")

    def rows(first: int, end: int) -> np.ndarray:
        parts = [part[first:end] for part in (pixels.rays, pixels.microlenses) if part is not None]
        return np.concatenate(parts, axis=-1)

    shape = pixels.rays.shape[:2]
    attributes = about(material, camera)
    write_bands(path, [BandedPart(name="rays", shape=shape, channels=names, rows=rows, attributes=attributes)])
