"""Lookup tables of OmniLensDistortionLutAPI: from image positions to directions, and back, for renderers of Omniverse.

`ray_enter` has a direction for each pixel. `ray_exit` has an image position for each direction: a square that holds the
sphere unfolded to an octahedron, with the view ahead in its middle. Positions are shares of width and height from the
top left. A direction that falls into no pixel has (-1, -1).
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pipeline.exports.cameras import ExportCamera
from pipeline.exports.material import Material
from pipeline.exports.seen.stated_sight import StatedSight
from pipeline.files.exr_bands import BandedPart, write_bands

_EXIT_PX = 1024
"""Width and height of the table of directions: 0.1 degrees a texel in the middle."""
_NOWHERE = -1
"""Position of a direction that is not in the image."""
_SCHEMA = "OmniLensDistortionLutAPI"
_PREFIX = "omni:lensdistortion"


def write(material: Material, folder: Path) -> None:
    """Write both tables of every camera, and a layer with a camera that uses them.

    Raises
    ------
    ExportError
        No pinhole fits, or light does not reach all of the image.
    """
    for camera in material.cameras:
        about = {f"remark{number}": line for number, line in enumerate(material.remarks)}
        write_tables(camera.rays, folder / camera.name, about)
        (folder / f"{camera.name}.usda").write_text(_layer(material, camera), encoding="utf-8")


def write_tables(rays: StatedSight, stem: Path, about: Mapping[str, str]) -> tuple[Path, Path]:
    """Write both tables beside each other, and return their paths: `stem` with .ray_enter.exr and .ray_exit.exr."""
    width, height = rays.built.size_px
    said: dict[str, str | float | int] = {**about, "plane_mm": rays.ideal.z_mm, "error_px": rays.ideal.error_px}
    paths = []
    for name, shape, rows in (
        ("ray_enter", (height, width), _Enter(rays).rows),
        ("ray_exit", (_EXIT_PX, _EXIT_PX), _Exit(rays).rows),
    ):
        part = BandedPart(name=name, shape=shape, channels=("R", "G", "B"), rows=rows, attributes=said)
        paths.append(stem.with_name(f"{stem.name}.{name}.exr"))
        write_bands(paths[-1], [part])
    return paths[0], paths[1]


class _Enter:
    """Direction of each pixel."""

    def __init__(self, rays: StatedSight) -> None:
        self.rays = rays

    def rows(self, first: int, end: int) -> dict[str, np.ndarray]:
        width, _ = self.rays.built.size_px
        y, x = np.mgrid[first:end, 0:width].reshape(2, -1)
        ideal = self.rays.ideal
        slopes = ideal.slopes(ideal.ideal(np.stack([x, y], axis=1).astype(float)))
        ahead = np.column_stack([slopes, np.ones(len(slopes))])
        found = self.rays.vectors(ahead / np.linalg.norm(ahead, axis=1, keepdims=True))
        return dict(zip("RGB", found.T.reshape(3, end - first, width), strict=True))


class _Exit:
    """Image position of each direction of an octahedron."""

    def __init__(self, rays: StatedSight) -> None:
        self.rays = rays

    def rows(self, first: int, end: int) -> dict[str, np.ndarray]:
        row, column = np.mgrid[first:end, 0:_EXIT_PX].reshape(2, -1)
        x, y, z = self.rays.vectors(octahedral(column, row, _EXIT_PX)).T
        ideal, places = self.rays.ideal, np.full((len(x), 2), np.nan)
        ahead = np.flatnonzero(z > 0)
        u = ideal.seen_at(np.stack([x[ahead] / z[ahead], y[ahead] / z[ahead]], axis=1))
        near = ideal.may_see(u)
        places[ahead[near]] = self.rays.positions(ideal.real(u[near]))
        found = np.where(np.isnan(places), _NOWHERE, places)
        shape = (end - first, _EXIT_PX)
        r, g = found.T.reshape(2, *shape)
        return {"R": r, "G": g, "B": np.zeros(shape)}


def octahedral(column: np.ndarray, row: np.ndarray, size: int) -> np.ndarray:
    """Directions (n, 3) of texels of an octahedral table in the axes of a USD camera, which looks along -z."""
    x, y = ((2 * number + 1) / size - 1 for number in (column, row))
    z = 1 - np.abs(x) - np.abs(y)
    behind = z <= 0
    folded = np.where(x >= 0, 1, -1) * (1 - np.abs(y)), np.where(y >= 0, 1, -1) * (1 - np.abs(x))
    x, y = np.where(behind, folded[0], x), np.where(behind, folded[1], y)
    found = np.stack([x, y, -z], axis=1)
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))


def _layer(material: Material, camera: ExportCamera) -> str:
    width, height = camera.size_px
    middle_x, middle_y = width / 2, height / 2  # the place of the axis is in the tables: it must not count twice
    centre = ", ".join(f"{value:.9g}" for value in camera.rays.ideal.pinhole.centre_mm.tolist())
    remarks = "\n".join(material.remarks).replace('"', "'")
    return f'''#usda 1.0
(
    defaultPrim = "Camera"
    doc = """{camera.name}: rays on the plane {camera.rays.ideal.z_mm:.6g} mm before the stop, as tables of directions.
They are seen from ({centre}) mm of the vision frame, whose origin is the centre of the stop.
{remarks}"""
    metersPerUnit = 0.001
    upAxis = "Y"
)

def Camera "Camera" (
    prepend apiSchemas = ["{_SCHEMA}"]
)
{{
    custom token {_PREFIX}:model = "lut"
    custom float {_PREFIX}:lut:nominalHeight = {height}
    custom float {_PREFIX}:lut:nominalWidth = {width}
    custom float2 {_PREFIX}:lut:opticalCenter = ({middle_x:g}, {middle_y:g})
    custom asset {_PREFIX}:lut:rayEnterDirectionTexture = @./{camera.name}.ray_enter.exr@
    custom asset {_PREFIX}:lut:rayExitPositionTexture = @./{camera.name}.ray_exit.exr@
}}
'''
