"""Rays of all pixels: EXR for pictures, npz in double precision. A band of rows is in memory at a time."""

import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.exports.cameras import ExportCamera
from pipeline.exports.material import Material
from pipeline.exports.ray_patches import bands
from pipeline.exports.writers.maps.header import about
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

_AT_ONCE = 1 << 16
"""Pixels of a band, unless the rows of its patches are more: their rays take some megabytes."""
_VECTORS = ("origin", "direction")


def write(material: Material, folder: Path) -> None:
    """Write both files of every camera."""
    for camera in material.cameras:
        scratch = folder / f"{camera.name}.scratch.npy"
        rays, microlenses = _traced(camera, scratch)
        try:
            _write_npz(folder / f"{camera.name}.rays.npz", material, camera, rays, microlenses)
            _write_exr(folder / f"{camera.name}.rays.exr", material, camera, rays, microlenses)
        finally:
            del rays
            scratch.unlink()


def _traced(camera: ExportCamera, scratch: Path) -> tuple[np.ndarray, np.ndarray | None]:
    """Rays (h, w, 6) in a file, and microlenses (h, w, 2) of a plenoptic camera."""
    width, height = camera.size_px
    rays = np.lib.format.open_memmap(scratch, "w+", np.float64, (height, width, 6))
    microlenses = None if camera.micro_images is None else np.zeros((height, width, 2), np.int32)
    for first, end in bands(height, _AT_ONCE // width):
        band = camera.rays.band(first, end)
        rays[first:end, :, :3] = band.origin_mm * camera.rays.convention.scale
        rays[first:end, :, 3:] = band.direction
        if microlenses is not None and band.microlenses is not None:
            microlenses[first:end] = band.microlenses
    return rays, microlenses


def _write_npz(
    path: Path, material: Material, camera: ExportCamera, rays: np.ndarray, microlenses: np.ndarray | None
) -> None:
    """Write arrays without pickles, the large ones row by row; `np.load` opens them."""
    small: dict[str, Any] = {"remarks": np.array(material.remarks), "ends_px": camera.rays.ends}
    if microlenses is not None:
        small["microlenses"] = microlenses
    with zipfile.ZipFile(path, "w") as archive:
        for name, array in small.items():
            text = io.BytesIO()
            np.lib.format.write_array(text, array, allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy"), text.getvalue())
        for number, name in enumerate(_VECTORS):
            part = slice(3 * number, 3 * number + 3)
            header = {"descr": "<f8", "fortran_order": False, "shape": (*rays.shape[:2], 3)}
            with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as stream:
                np.lib.format.write_array_header_1_0(stream, header)
                for row in rays:
                    stream.write(np.ascontiguousarray(row[:, part], "<f8").tobytes())


def _write_exr(
    path: Path, material: Material, camera: ExportCamera, rays: np.ndarray, microlenses: np.ndarray | None
) -> None:
    names = [f"{vector}.{axis}" for vector in _VECTORS for axis in "XYZ"]
    numbers = () if microlenses is None else ("microlens.k", "microlens.l")

    def rows(first: int, end: int) -> dict[str, np.ndarray]:
        found = {name: rays[first:end, :, number] for number, name in enumerate(names)}
        if microlenses is not None:
            found |= {name: microlenses[first:end, :, number] for number, name in enumerate(numbers)}
        return found

    part = BandedPart(
        name="rays", shape=rays.shape[:2], channels=(*names, *numbers), rows=rows, attributes=about(material, camera)
    )
    write_bands(path, [part])
