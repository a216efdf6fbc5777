"""Answers of a ready camera: image positions of points, rays of image positions, and where such rays end."""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from pipeline.camera.parts.errors import CameraError
from pipeline.channel_names import body_and_channel
from pipeline.records.declared import number

if TYPE_CHECKING:
    from pipeline.render.surroundings import Surroundings  # loads Embree, which only rays that end need


class Fate(StrEnum):
    """Fate of a point: whether it has image positions, and if not, why."""

    SEEN = "seen"
    BEHIND = "behind the camera, or not in front of its lens"
    AWAY = "its surface faces away"
    NO_LIGHT = "outside the field: none of its light passes the lens"
    OUTSIDE = "outside the image, or in no micro-image"
    DARK = "too little light: below the least hit fraction"


@dataclass(frozen=True, slots=True, kw_only=True)
class Projected:
    """Image positions of points: one row per point, or in a plenoptic camera per point and microlens that sees it.

    Rows are sorted by point, l and k.

    `point`: index of the point in the argument, (n,) int64.
    `x_px`, `y_px`: (n,) float64; (0, 0) is the centre of the top-left pixel.
    `error_px`: quadrature error plus the residual of Newton's method, along x and y, (n, 2) float64.
    `hit_fraction`: (n,) float64.
    `rho_px`: radius of the blur, (n,) float64; positive: the point lies beyond best focus.
    `microlens`, `microlens_type`: k and l, (n, 2) int64, and (n,) int64; None for a conventional camera.
    `fates`: one per point.
    `t_s`: mid-exposure time of the position's line relative to the time code, (n,) float64; None without a shutter.
    `blur_px2`: covariance of the bundle at the point, mapped to the image, (n, 2, 2) float64.
    `derivatives`: of (x_px, y_px) by each requested parameter: (n, 2) float64 per unit of a scalar, (n, 2, k) for one
    with k entries; "point": by x, y and z of the point, (n, 2, 3) [px per mm]. NaN where the bundle is in pieces.
    `blur_derivatives`: of `blur_px2` if requested, (n, 2, 2) or (n, 2, 2, k).
    """

    point: np.ndarray
    x_px: np.ndarray
    y_px: np.ndarray
    error_px: np.ndarray
    hit_fraction: np.ndarray
    rho_px: np.ndarray
    microlens: np.ndarray | None
    microlens_type: np.ndarray | None
    fates: tuple[Fate, ...]
    blur_px2: np.ndarray
    t_s: np.ndarray | None = None
    derivatives: dict[str, np.ndarray] = field(default_factory=dict)
    blur_derivatives: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def is_seen(self) -> np.ndarray:
        """Whether each point has a position, (p,) bool."""
        return np.array([fate is Fate.SEEN for fate in self.fates], bool)


@dataclass(frozen=True, slots=True, kw_only=True)
class PixelRays:
    """Rays of image positions, vision frame: the straight line of J; NaN where no light leaves the camera.

    `x_px`, `y_px`, `hit_fraction`: (n,) float64.
    `origin_mm`: intersection of the line with the plane z = 0 through the centre of the aperture stop; for a camera
    that sees 80 degrees or more off its axis, the point of the line where the chief ray leaves the first surface, (n,
    3) float64.
    `direction`: into the scene, of length 1, (n, 3) float64.
    `error_px`: quadrature error as a distance of image positions, (n, 2) float64.
    `microlens`: k and l of the one in whose cell the position lies, (n, 2) int64; None for a conventional camera.
    """

    x_px: np.ndarray
    y_px: np.ndarray
    origin_mm: np.ndarray
    direction: np.ndarray
    error_px: np.ndarray
    hit_fraction: np.ndarray
    microlens: np.ndarray | None

    def at_distance(self, z_mm: float) -> np.ndarray:
        """Intersections with the plane at vision z, (n, 3) [mm]: J there; NaN for rays that lead away from it."""
        z_mm = number("z_mm", z_mm, CameraError)
        along = (z_mm - self.origin_mm[:, 2:]) / self.direction[:, 2:]
        return np.where(self.direction[:, 2:] > 0, self.origin_mm + along * self.direction, np.nan)

    @property
    def nearest_point_mm(self) -> np.ndarray:
        """Point p with the least sum of squared distances from the rays o + t d that carry light, (3,).

        It solves the normal equations (sum P) p = sum P o with P = 1 - d d^T, the projection across a ray.
        """
        is_lit = np.isfinite(self.direction).all(axis=1)
        direction = self.direction[is_lit]
        across = np.eye(3) - direction[:, :, None] * direction[:, None, :]
        return np.linalg.solve(across.sum(axis=0), np.einsum("nij,nj->i", across, self.origin_mm[is_lit]))


@dataclass(eq=False)
class SeenScene:
    """Targets and occluders before the cameras of a build.

    `around`: function that returns them for a frame and a camera without channel: all, or the named target alone.
    """

    around: Callable[[int, str, str | None], "Surroundings"]
    _last: "tuple[tuple[int, str, str | None], Surroundings] | None" = field(default=None, repr=False)

    def distance_mm(
        self, frame: int, camera: str, origin_mm: np.ndarray, direction: np.ndarray, only: str | None = None
    ) -> np.ndarray:
        """Distance along rays (n, 3) of the vision frame, with unit directions, to the first surface, (n,); NaN: none.

        `only`: name of the only target that counts.
        """
        view = frame, body_and_channel(camera)[0], only
        if self._last is None or self._last[0] != view:  # bands of rows of one view are asked for in turn
            self._last = view, self.around(*view)
        return self._last[1].distance_mm(origin_mm, direction)
