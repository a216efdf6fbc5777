"""puzzlepaint camera_calibration: NoncentralGenericModel, two grids of B-splines for the rays of a camera.

Values of a grid are control points of a uniform cubic B-spline, no rays. Grid coordinate 1 is the left or upper end of
the calibrated area and `size` - 2 the other one, so that a cell lies outside on each side: central_grid.h, b_spline.h.
"""

from pathlib import Path

import numpy as np

from pipeline.exports.cameras import ExportCamera
from pipeline.exports.errors import ExportError
from pipeline.exports.material import Material

_CELLS = 24
"""Cells of the grid along the longer side of the image: splines then miss rays of lenses by far less than detectors."""
_PER_CELL = 2
"""Rays per cell and direction that are traced: twice as many as there are control points."""
_OUTSIDE = 3
"""Control points more than cells: a cubic spline reaches over one and a half cells on each side."""


def write(material: Material, folder: Path) -> None:
    """Write a file per camera.

    Raises
    ------
    ExportError
        Light does not reach all of the image.
    """
    for camera in material.cameras:
        (folder / f"{camera.name}.yaml").write_text(_text(material, camera), encoding="utf-8")


def _text(material: Material, camera: ExportCamera) -> str:
    width, height = camera.size_px
    cell = max(width, height) / _CELLS
    columns, rows = (max(1, round(size / cell)) for size in (width, height))
    points, directions, worst = _grids(camera, columns, rows)
    lines = [f"# {line}" for line in material.remarks]
    lines += [f"# between the traced rays the splines miss directions by {worst:.1e} rad at most"]
    lines += ["type : NoncentralGenericModel", f"width : {width}", f"height : {height}"]
    lines += ["calibration_min_x : 0", "calibration_min_y : 0"]
    lines += [f"calibration_max_x : {width - 1}", f"calibration_max_y : {height - 1}"]
    lines += [f"grid_width : {columns + _OUTSIDE}", f"grid_height : {rows + _OUTSIDE}"]
    for name, grid in (("point_grid", points), ("direction_grid", directions)):
        lines += [f"{name} : [{', '.join(map(repr, grid.ravel().tolist()))}]"]
    return "\n".join([*lines, ""])


def _grids(camera: ExportCamera, columns: int, rows: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Control points of the points and of the directions, (rows + 3, columns + 3, 3), and the largest error between
    traced rays [rad].
    """
    traced = tuple(np.linspace(0, count, _PER_CELL * count + 1) for count in (columns, rows))
    between = tuple((one[:-1] + one[1:]) / 2 for one in traced)
    points, directions = _rays(camera, traced, (columns, rows))
    across, down = (basis(one, count) for one, count in zip(traced, (columns, rows), strict=True))
    found = [
        np.einsum("ij,jkl,mk->iml", np.linalg.pinv(down), values, np.linalg.pinv(across))
        for values in (points, directions)
    ]
    across, down = (basis(one, count) for one, count in zip(between, (columns, rows), strict=True))
    seen = np.einsum("ji,ikl,mk->jml", down, found[1], across)
    seen /= np.linalg.norm(seen, axis=2, keepdims=True)
    _, exact = _rays(camera, between, (columns, rows))
    return found[0], found[1], float(np.linalg.norm(seen - exact, axis=2).max())


def _rays(
    camera: ExportCamera, cells: tuple[np.ndarray, ...], counts: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Points and directions of rays, (rows, columns, 3), of places counted in cells from the corner of the image."""
    places = np.stack(np.meshgrid(*cells), axis=-1) / counts * camera.size_px
    shape = places.shape[:2]
    x, y = camera.rays.ours(places.reshape(-1, 2)).T
    found = camera.rays.traced(x, y)
    if not np.isfinite(found.direction).all():
        raise ExportError(f"light does not reach all of the image of {camera.name}, so splines cannot hold its rays")
    points = camera.rays.points(found.origin_mm).reshape(*shape, 3)
    return points, camera.rays.vectors(found.direction).reshape(*shape, 3)


def basis(cells: np.ndarray, count: int) -> np.ndarray:
    """Values of the cubic B-splines of `count` cells at places (n,) counted in cells, (n, count + 3)."""
    found = np.zeros((len(cells), count + _OUTSIDE))
    first = np.minimum(cells.astype(int), count - 1)
    t = cells - first
    shares = (1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3
    for number, share in enumerate(shares):
        found[np.arange(len(cells)), first + number] = share / 6
    return found
