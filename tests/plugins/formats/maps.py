"""A small pinhole with distortion whose rays are known, and readers of files that hold rays and maps.

Each `check_<format>` asserts that a folder says what the camera is, by that consumer's rules. Nothing here comes from
the table of conventions.
"""

import functools
import json
from pathlib import Path

import numpy as np
import OpenEXR
from fits.pixel_rays import lit_rays
from plugins.formats.pretended import DISTORTION, STOP_MM, projected, same, slopes_seen, write_camera, write_manifest

from pipeline.exports.gathering import gather
from pipeline.exports.material import Material
from pipeline.results.answers import PixelRays
from pipeline.results.output import Output

SIZE_PX, F_PX, CENTRE_PX = (64, 48), 100.0, np.array([30.25, 20.75])
MATRIX = np.array([[F_PX, 0, CENTRE_PX[0]], [0, F_PX, CENTRE_PX[1]], [0, 0, 1]])
SHUTTER = {"scan_order": "bottomToTop", "opens_s": -0.01, "line_offset_s": 1e-3, "exposure_s": 4e-3}
PIXEL, Z_MM = (10, 7), 400.0
"""A pixel, column and row, and the distance of a point that it sees in its middle."""


def undistorted(pixels: np.ndarray) -> np.ndarray:
    """Slopes that pixels (n, 2) see, solved once: every export of the camera asks for the same ones."""
    return _undistorted(np.ascontiguousarray(pixels, float).tobytes())


@functools.cache
def _undistorted(pixels: bytes) -> np.ndarray:
    return slopes_seen(np.frombuffer(pixels).reshape(-1, 2), MATRIX)


def point() -> np.ndarray:
    return np.append(undistorted(np.array([PIXEL]))[0], 1) * Z_MM


class PinholeSight:
    """The camera made ready: all rays meet in its centre of projection."""

    def rays(self, x_px, y_px) -> PixelRays:
        x, y = np.broadcast_arrays(np.asarray(x_px, float), np.asarray(y_px, float))
        ahead = np.column_stack([undistorted(np.stack([x, y], 1)), np.ones(len(x))])
        return lit_rays(x, y, STOP_MM - STOP_MM[2] * ahead, ahead)


PLANE, EDGE_MM = (np.array([0.3, -0.2, 1.0]), 410.0), 50.0
"""A plane of the vision frame, n . X = d, and the x where its surface ends."""


class SlantedScene:
    def distance_mm(self, frame, camera, origin_mm, direction, only=None):
        along = (PLANE[1] - origin_mm @ PLANE[0]) / (direction @ PLANE[0])
        return np.where((origin_mm + along[:, None] * direction)[:, 0] < EDGE_MM, along, np.nan)


def gathered(output: Output) -> Material:
    return gather(output, lambda name: PinholeSight(), SlantedScene)


def write_small_build(folder: Path) -> Path:
    write_camera(folder / "cameras/Left", SIZE_PX, F_PX, CENTRE_PX, DISTORTION)
    record = json.loads((folder / "cameras/Left/camera.json").read_text())
    (folder / "cameras/Left/camera.json").write_text(json.dumps(record | {"shutter": SHUTTER}))
    view = folder / "frames/0001/Left"
    view.mkdir(parents=True)
    (view / "poses.json").write_text("{}")
    write_manifest(folder)
    return folder


def channels(path: Path, *names: str) -> np.ndarray:
    """Channels of the part of an EXR file that has them, (h, w, n), by the library alone."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        found = next(part.channels for part in file.parts if set(names) <= set(part.channels))
        return np.stack([found[name].pixels for name in names], axis=-1)


def check_rays(folder: Path) -> None:
    """The ray of the known pixel passes the point that it sees; the stop is 6 mm behind the centre of projection."""
    data = np.load(folder / "Left.rays.npz")
    origin, direction = data["origin"], data["direction"]
    assert origin.dtype == direction.dtype == np.float64 and origin.shape == direction.shape == (48, 64, 3)
    same(data["ends_px"], [[0, 0], [SIZE_PX[0] - 1, SIZE_PX[1] - 1]], 0)
    column, row = PIXEL
    start, way = origin[row, column], direction[row, column]
    same(start[2], 0, 1e-12)
    same(np.cross(point() + STOP_MM - start, way), np.zeros(3), 1e-8)
    same(np.linalg.norm(direction, axis=2), np.ones((48, 64)), 1e-12)
    names = [f"{vector}.{axis}" for vector in ("origin", "direction") for axis in "XYZ"]
    same(channels(folder / "Left.rays.exr", *names), np.concatenate([origin, direction], axis=2), 1e-5)


def check_stmap(folder: Path) -> None:
    """Nuke: the value of a pixel is where to look, (0, 0) in the bottom left corner and (1, 1) in the top right one."""
    size = np.array(SIZE_PX)
    undistort, distort = (channels(folder / f"Left.{name}.exr", "R", "G") for name in ("undistort", "distort"))
    assert undistort.shape == distort.shape == (48, 64, 2)
    row, column = np.mgrid[2:46:4, 2:62:6].reshape(2, -1)
    for table, name in ((undistort, "undistort"), (distort, "distort")):
        shares = (looked_at(name, row, column) + 0.5) / size
        same(table[row, column], np.column_stack([shares[:, 0], 1 - shares[:, 1]]), 1e-6)
    times = channels(folder / "Left.undistort.exr", "Y")[row, column, 0]
    same(times, -0.01 + 1e-3 * (47 - looked_at("undistort", row, column)[:, 1]) + 2e-3, 1e-8)


def looked_at(name: str, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Where a map of pixels looks in the other picture, (n, 2) [px]."""
    if name == "distort":
        return undistorted(np.stack([column, row], axis=1)) * F_PX + CENTRE_PX
    ahead = np.column_stack([(column - CENTRE_PX[0]) / F_PX, (row - CENTRE_PX[1]) / F_PX, np.ones(len(row))])
    return projected(np.eye(4), ahead, MATRIX)


def check_depth(folder: Path) -> None:
    """A slanted plane before the pinhole, cut off at the right: from the equation of the plane."""
    depth = channels(folder / "Left/0001.depth.exr", "Z")[..., 0]
    row, column = np.mgrid[0:48, 0:64].reshape(2, -1)
    ahead = np.column_stack([undistorted(np.stack([column, row], axis=1)), np.ones(len(row))])
    z = STOP_MM[2] + (PLANE[1] - PLANE[0] @ STOP_MM) / (ahead @ PLANE[0])
    is_hit = (ahead * (z - STOP_MM[2])[:, None])[:, 0] < EDGE_MM
    assert 0 < is_hit.sum() < len(z)
    same(depth.ravel()[is_hit], z[is_hit], 1e-4)
    assert np.isnan(depth.ravel()[~is_hit]).all()
    with OpenEXR.File(str(folder / "Left/0001.depth.exr")) as file:
        ends = [float(file.header()[name]) for name in ("first_x", "first_y", "last_x", "last_y")]
    same(ends, [0, 0, 63, 47], 0)


CHECKS = {
    "depth": check_depth,
    "rays": check_rays,
    "stmap": check_stmap,
}
"""Format with rays or maps -> its check."""
