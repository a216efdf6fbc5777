"""Rays of all pixels: EXR for pictures, npz in double precision. A band of rows is in memory at a time."""

import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.exports.material import ExportCamera, Material
from pipeline.exports.writers.maps.traced import TracedPixels, about, traced
from pipeline.files.exr_bands import BandedPart, write_bands
from pipeline.formats import Cameras, Format, Microlenses, Origin, Reads, Unit

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

_VECTORS = ("origin", "direction")


def write(material: Material, folder: Path) -> None:
    """Write both files of every camera."""
    for camera in material.cameras:
        with traced(camera, folder) as pixels:
            _write_npz(folder / f"{camera.name}.rays.npz", material, camera, pixels)
            _write_exr(folder / f"{camera.name}.rays.exr", material, camera, pixels)


def _write_npz(path: Path, material: Material, camera: ExportCamera, pixels: TracedPixels) -> None:
    """Write arrays without pickles, the large ones row by row; `np.load` opens them."""
    small: dict[str, Any] = {"remarks": np.array(material.remarks), "ends_px": camera.rays.ends}
    if pixels.microlenses is not None:
        small["microlenses"] = pixels.microlenses
    with zipfile.ZipFile(path, "w") as archive:
        for name, array in small.items():
            with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w") as stream:
                np.lib.format.write_array(stream, array, allow_pickle=False)
        for name in _VECTORS:
            header = {"descr": "<f8", "fortran_order": False, "shape": (*pixels.rays.shape[:2], 3)}
            with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as stream:
                np.lib.format.write_array_header_1_0(stream, header)
                for row in pixels.rays:
                    stream.write(np.ascontiguousarray(_vector(camera, row, name), "<f8").tobytes())


def _write_exr(path: Path, material: Material, camera: ExportCamera, pixels: TracedPixels) -> None:
    names = tuple(f"{name}.{axis}" for name in _VECTORS for axis in "XYZ")
    if pixels.microlenses is not None:
        names = (*names, "microlens.k", "microlens.l")

    def rows(first: int, end: int) -> np.ndarray:
        band = slice(first, end)
        columns = [_vector(camera, pixels.rays[band], name) for name in _VECTORS]
        if pixels.microlenses is not None:
            columns.append(pixels.microlenses[band])
        return np.concatenate(columns, axis=-1)

    shape, attributes = pixels.rays.shape[:2], about(material, camera)
    write_bands(path, [BandedPart(name="rays", shape=shape, channels=names, rows=rows, attributes=attributes)])


def _vector(camera: ExportCamera, rays: np.ndarray, name: str) -> np.ndarray:
    """Origins in the unit of the format, or directions, of rays (..., 6)."""
    return rays[..., :3] * camera.rays.convention.scale if name == "origin" else rays[..., 3:]
