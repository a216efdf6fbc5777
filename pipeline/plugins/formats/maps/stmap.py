"""ST maps for compositors: two channels that say for each pixel of a picture where to look in another one.

`undistort` makes the image of an ideal pinhole out of a camera's image, `distort` the reverse. Red is s, green is t. A
pixel without a source has -1. With a shutter `undistort` has a second part: the time at which the camera exposes the
source of a pixel of the ideal image.

Rays of a lens do not meet in one centre, so such a map holds at one distance: the points of the rays of positions on a
plane, seen from the centre of the equivalent pinhole with its principal distance. Between traced positions the map is a
spline; its error at other positions is measured and stated.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.exports.material import ExportCamera, Material
from pipeline.files.exr_bands import BandedPart, Rows, write_bands
from pipeline.formats import Cameras, ExportError, Format, ImageAxes, Origin, Reads
from pipeline.motion import Shutter
from pipeline.results.records import BuiltPinhole

FORMAT = Format(
    consumer="Nuke and other compositors: STMap",
    note="s and t of each pixel in R and G, the top row first",
    source="proof: st_warp of OpenImageIO 3.2 with flip_t. Read: documentation of Foundry Nuke, STMap",
    cameras=Cameras.CONVENTIONAL,
    reads=frozenset({Reads.RAYS}),
    files=("<camera>.undistort.exr", "<camera>.distort.exr"),
    origin=Origin.SHARE,
    axes=ImageAxes.X_UP,
)

Positions = Callable[[np.ndarray], np.ndarray]
"""Function from positions (n, 2) in one picture to positions (n, 2) in the other; NaN where there is none."""
_NOWHERE = -1
"""Value of a pixel without a source: outside of both pictures, and a number, which compositors require."""
_COLUMNS, _ROWS = 49, 37
"""Traced positions along x and y: distortion of lenses is smooth over a cell."""
_MARGIN = 0.05
"""Part of the width and height that is traced beyond the image on each side [1]: corners of ideal images lie there."""
_DEGREE = 5
"""Degree of the splines along x and y: errors fall with the sixth power of the distance of positions."""
_TESTED = 64
"""Positions between the traced ones at which the error is measured."""
_STEPS, _SETTLED_PX = 30, 1e-9
"""Most steps of Newton's method for the inverse, and the length of a step that ends it [px]."""
_FOUND_PX = 1e-6
"""Largest residual of an accepted solution [px]."""


def write(material: Material, folder: Path) -> None:
    """Write both maps of every camera."""
    for camera in material.cameras:
        ideal = _ideal_map(camera)
        x, y = ideal.pinhole.principal_point_px.tolist()
        f = ideal.pinhole.principal_distance_px
        about: dict[str, str | float | int] = {f"remark{number}": line for number, line in enumerate(material.remarks)}
        about |= {"plane_mm": ideal.z_mm, "error_px": _error_px(camera, ideal)}
        about |= {"pinhole_f_px": f, "pinhole_x": x, "pinhole_y": y}
        for name, mapped in (("undistort", ideal.to_real), ("distort", ideal.to_ideal)):
            parts = [_part(camera, name, ("R", "G"), partial(_rows, camera, mapped), about)]
            if name == "undistort" and camera.built.shutter:
                parts.append(_part(camera, "time", ("Y",), partial(_times, camera, camera.built.shutter, mapped), {}))
            write_bands(folder / f"{camera.name}.{name}.exr", parts)


def _part(
    camera: ExportCamera, name: str, channels: tuple[str, ...], rows: Rows, about: dict[str, str | float | int]
) -> BandedPart:
    return BandedPart(name=name, shape=camera.size_px[::-1], channels=channels, rows=rows, attributes=about)


def _times(camera: ExportCamera, shutter: Shutter, mapped: Positions, first: int, end: int) -> np.ndarray:
    """Mid-exposure times [s] of the sources of the pixels of rows; NaN where there is none."""
    return shutter.middle_s(mapped(_pixels(camera, first, end)), camera.size_px).reshape(end - first, -1)


def _pixels(camera: ExportCamera, first: int, end: int) -> np.ndarray:
    """Positions (n, 2) of the pixels of rows."""
    y, x = np.mgrid[first:end, 0 : camera.size_px[0]].reshape(2, -1)
    return np.stack([x, y], axis=1).astype(float)


def _rows(camera: ExportCamera, mapped: Positions, first: int, end: int) -> np.ndarray:
    """Rows of a map: s and t of each pixel's source."""
    shares = camera.rays.positions(mapped(_pixels(camera, first, end)))
    return np.where(np.isnan(shares), _NOWHERE, shares).reshape(end - first, -1, 2)


@dataclass(frozen=True, kw_only=True)
class _IdealMap:
    """Image positions of a camera and of an ideal pinhole, both with (0, 0) in the centre of the top-left pixel."""

    pinhole: BuiltPinhole  # its distortion does not count
    z_mm: float  # vision z of the plane on which the map holds
    low: np.ndarray  # (2,), corners of the area that was traced
    high: np.ndarray
    splines: tuple[Any, ...]  # shifts along x and y from a position of the camera to that of the ideal image

    def to_ideal(self, x_px: np.ndarray) -> np.ndarray:
        """Positions in the ideal image of positions (n, 2) of the camera; NaN outside of the traced area."""
        inside = np.all((x_px >= self.low) & (x_px <= self.high), axis=1, keepdims=True)
        return np.where(inside, x_px + self._shift(x_px), np.nan)

    def to_real(self, u_px: np.ndarray) -> np.ndarray:
        """Positions in the camera of positions (n, 2) of the ideal image, by Newton's method; NaN if there is none."""
        x = np.clip(u_px, self.low, self.high)
        rows = np.arange(len(u_px))
        for _ in range(_STEPS):
            current_px = x[rows]
            off_px = current_px + self._shift(current_px) - u_px[rows]
            slopes = np.stack([self._shift(current_px, dx=1), self._shift(current_px, dy=1)], axis=2) + np.eye(2)
            x[rows] = np.clip(current_px - np.linalg.solve(slopes, off_px[:, :, None])[:, :, 0], self.low, self.high)
            rows = rows[np.abs(x[rows] - current_px).max(axis=1) > _SETTLED_PX]  # those at the edge stay there, too
            if not len(rows):
                break
        is_solved = np.abs(x + self._shift(x) - u_px).max(axis=1) < _FOUND_PX
        return np.where(is_solved[:, None], x, np.nan)

    def _shift(self, x_px: np.ndarray, **derivative: int) -> np.ndarray:
        return np.stack([spline.ev(x_px[:, 0], x_px[:, 1], **derivative) for spline in self.splines], axis=1)


def _ideal_map(camera: ExportCamera) -> _IdealMap:
    """The map of a camera, from rays over its image."""
    from scipy.interpolate import RectBivariateSpline

    pinhole = camera.built.pinhole_with_distortion
    if pinhole is None:
        raise ExportError(
            f"no pinhole fits {camera.name}, and this format bends its image into that of one",
            hint="choose other cameras with --only; beyond 90 degrees `rays` has the line of every pixel",
        )
    near_mm, far_mm = map(float, camera.built.record["near_far_mm"])
    z_mm = 2 / (1 / near_mm + 1 / far_mm)
    size = np.array(camera.size_px, float)
    for margin in (_MARGIN, 0.0):
        low, high = -0.5 - margin * size, size - 0.5 + margin * size
        x, y = (np.linspace(low[axis], high[axis], count) for axis, count in enumerate((_COLUMNS, _ROWS)))
        x_px = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
        shift = _traced(camera, pinhole, z_mm, x_px) - x_px
        if np.isfinite(shift).all():
            break
    else:
        raise ExportError(f"light does not reach all of the image of {camera.name}, so it has no map to a pinhole's")
    shifts = shift.reshape(len(x), len(y), 2)
    splines = tuple(RectBivariateSpline(x, y, shifts[..., axis], kx=_DEGREE, ky=_DEGREE) for axis in range(2))
    return _IdealMap(pinhole=pinhole, z_mm=z_mm, low=low, high=high, splines=splines)


def _traced(camera: ExportCamera, pinhole: BuiltPinhole, z_mm: float, x_px: np.ndarray) -> np.ndarray:
    """Exact positions in the ideal image, (n, 2) [px]."""
    points = camera.rays.sight.rays(x_px[:, 0], x_px[:, 1]).at_distance(z_mm) - pinhole.centre_mm
    return np.asarray(pinhole.principal_distance_px * points[:, :2] / points[:, 2:] + pinhole.principal_point_px)


def _error_px(camera: ExportCamera, ideal: _IdealMap) -> float:
    """Largest difference of the map from traced rays at positions between those that made it."""
    size = np.array(camera.size_px, float)
    x_px = np.random.default_rng(1).uniform(np.full(2, -0.5), size - 0.5, (_TESTED, 2))
    difference = ideal.to_ideal(x_px) - _traced(camera, ideal.pinhole, ideal.z_mm, x_px)
    return float(np.hypot(*difference.T).max())
