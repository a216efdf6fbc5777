"""ST maps for compositors: two channels that say for each pixel of a picture where in another one to look.

`undistort` makes the image of an ideal pinhole of a camera's image, `distort` the other way round. Red is s, green is
t. A pixel for which there is no light has -1.
"""

from pathlib import Path

import numpy as np

from pipeline.exports.cameras import ExportCamera
from pipeline.exports.material import Material
from pipeline.files.exr_bands import BandedPart, write_bands

_NOWHERE = -1
"""Value of a pixel that has no place in the other picture: outside of both, and a number, which compositors want."""


def write(material: Material, folder: Path) -> None:
    """Write both maps of every camera.

    Raises
    ------
    ExportError
        No pinhole fits, or light does not reach all of the image.
    """
    for camera in material.cameras:
        for name in ("undistort", "distort"):
            _write(folder / f"{camera.name}.{name}.exr", material, camera, name)


def _write(path: Path, material: Material, camera: ExportCamera, name: str) -> None:
    width, height = camera.size_px
    ideal = camera.rays.ideal
    there = ideal.real if name == "undistort" else ideal.ideal

    def rows(first: int, end: int) -> dict[str, np.ndarray]:
        y, x = np.mgrid[first:end, 0:width].reshape(2, -1)
        found = camera.rays.positions(there(np.stack([x, y], axis=1).astype(float)))
        s, t = np.where(np.isnan(found), _NOWHERE, found).T.reshape(2, end - first, width)
        return {"R": s, "G": t}

    about: dict[str, str | float | int] = {f"remark{number}": line for number, line in enumerate(material.remarks)}
    (x, y), f = ideal.pinhole.principal_point_px.tolist(), ideal.pinhole.principal_distance_px
    about |= {"plane_mm": ideal.z_mm, "error_px": ideal.error_px, "pinhole_f_px": f, "pinhole_x": x, "pinhole_y": y}
    write_bands(path, [BandedPart(name=name, shape=(height, width), channels=("R", "G"), rows=rows, attributes=about)])
