"""The entrance pupil as seen from any direction: real chief rays from the centre of the stop out into the scene.

The paraxial entrance pupil is the image of the stop from near the axis. In front of a fisheye the pupil moves forward
and to the side with the direction, and rays from beyond 90 degrees come from behind the plane of the first vertex: an
aim at the paraxial pupil misses the lens. A fan of rays that starts at the stop needs no aim.

Displaced surfaces count as centred: the fan only guides a search, and is no result.
"""

import functools
from dataclasses import dataclass

import numpy as np

from pipeline.optics.prescription import Prescription
from pipeline.optics.rays import traced
from pipeline.optics.table import POSE, enclosing, towards_scene
from pipeline.records.shapes import Bool, Float64

_RAYS = 1024
"""Rays of the fan between the axis and 90 degrees at the stop: neighbours leave a fisheye some tenths of a degree apart
at the edge of its field."""
_SPREAD = 1.5
"""Semi-axes of aims around a chief ray over those of its pencil, which varies across it."""
_GRID = np.stack(np.meshgrid(*[np.linspace(-1, 1, 12)] * 2), axis=-1).reshape(-1, 2)
_DISC = _GRID[np.hypot(*_GRID.T) <= 1]
"""Aims around a chief ray over their semi-axes: in the meridional plane, and across."""
WIDE_RAD = np.radians(80.0)
"""Angle with the axis at which a ray hardly meets planes across the axis, and beyond which a camera is wide."""


@dataclass(frozen=True, slots=True)
class PupilFan:
    """Chief rays from the axis to the edge of the field, half of the meridional plane, vision frame."""

    # Exit from the first surface: distance from the axis, vision z; angle with the axis in the scene
    height_mm: Float64[np.ndarray, "n"]
    z_mm: Float64[np.ndarray, "n"]
    angle_rad: Float64[np.ndarray, "n"]
    # Semi-axes of the pencil around each, in the meridional plane and across it
    along_mm: Float64[np.ndarray, "n"]
    across_mm: Float64[np.ndarray, "n"]

    @property
    def widest_rad(self) -> float:
        """Angle with the axis at the edge of the field, regardless of the sensor."""
        return float(self.angle_rad[-1])

    @property
    def is_wide(self) -> bool:
        """Whether points beside the lens may be visible; a stop in front of all surfaces does not tell: false."""
        return bool(self.height_mm[-1] > 0 and self.widest_rad > WIDE_RAD)

    def past_mm(self, points_mm: Float64[np.ndarray, "n 3"], ray: slice = slice(None)) -> np.ndarray:
        """Distance of points from each ray, (n, rays) [mm], in the half plane of point and axis; positive: outwards."""
        across = np.hypot(points_mm[:, 0], points_mm[:, 1])[:, None] - self.height_mm[ray]
        ahead = points_mm[:, 2:] - self.z_mm[ray]
        return np.asarray(across * np.cos(self.angle_rad[ray]) - ahead * np.sin(self.angle_rad[ray]))

    def in_field(self, points_mm: Float64[np.ndarray, "n 3"]) -> np.ndarray:
        """Whether points outside of the lens have a chief ray, (n,) bool."""
        return self.past_mm(points_mm, slice(-1, None))[:, 0] <= 0

    def may_see(self, points_mm: Float64[np.ndarray, "n 3"]) -> np.ndarray:
        """Whether points lie before the first vertex, or beside the lens where a chief ray still passes, (n,) bool."""
        beside = np.hypot(points_mm[:, 0], points_mm[:, 1]) > self.height_mm[-1]
        return (points_mm[:, 2] > self.z_mm[0]) | (beside & self.in_field(points_mm))

    def aims(self, point_mm: Float64[np.ndarray, "3"]) -> np.ndarray:
        """Points around the chief ray of a point, across it where it leaves the lens, (n, 3) vision frame."""
        # Interpolate between the two rays of the fan on either side of the point.
        past = self.past_mm(point_mm[None])[0]
        row = int(np.argmax(past <= 0)) if (past <= 0).any() else len(past) - 1
        share = past[row - 1] / (past[row - 1] - past[row]) if row and past[row] <= 0 else 1.0
        columns = (self.height_mm, self.z_mm, self.angle_rad, self.along_mm, self.across_mm)
        height, z, angle, *semi_mm = ((1 - share) * column[row - 1] + share * column[row] for column in columns)
        # Turn the ray to the azimuth of the point, and spread the disc across it.
        off_axis = np.hypot(*point_mm[:2])
        outward = point_mm[:2] / off_axis if off_axis > 0 else np.array([1.0, 0.0])
        meridional = np.append(np.cos(angle) * outward, -np.sin(angle))
        sagittal = np.array([-outward[1], outward[0], 0.0])
        return np.append(height * outward, z) + _DISC * semi_mm @ np.stack([meridional, sagittal])


@functools.lru_cache(maxsize=64)
def pupil_fan(prescription: Prescription) -> PupilFan:
    """Trace the fan of a lens; rays of a stop in front leave as they start."""
    # Trace rays from the centre of the stop through the surfaces in front of it, as far as they pass.
    table = enclosing(towards_scene(prescription))[len(prescription.surfaces) - prescription.stop_index :].copy()
    table[:, POSE] = 0.0
    start = np.pi / 2 * np.arange(_RAYS) / _RAYS
    direction = np.column_stack([np.sin(start), np.zeros(_RAYS), np.cos(start)])
    position, direction, passes = traced(table, np.zeros((_RAYS, 3)), direction)
    count = _RAYS if passes.all() else max(2, int(np.argmin(passes)))  # a stop without light still has an axis
    start = start[:count]
    angle = np.arctan2(direction[:count, 0], direction[:count, 2])
    # Widths of the pencils by the invariant of Lagrange, in the meridional plane and across it.
    index_at_stop = prescription.surfaces[prescription.stop_index - 1].index if prescription.stop_index else 1.0
    semi_mm = _SPREAD * index_at_stop * prescription.stop.semi_diameter_mm
    sine = np.maximum(np.sin(angle), 1e-12)
    with np.errstate(divide="ignore"):  # parallel rays: the pupil of a telecentric lens is as wide as its field
        along = np.cos(start) / np.gradient(angle, start)
    across = np.where(start > 0, np.sin(start) / sine, along)
    return PupilFan(np.abs(position[:count, 0]), position[:count, 2], angle, semi_mm * np.abs(along), semi_mm * across)


def is_steep(prescription: Prescription, points_mm: Float64[np.ndarray, "n 3"]) -> Bool[np.ndarray, "n"]:
    """Whether points are so far off the axis that their vision z is no measure of depth, (n,) bool."""
    fan = pupil_fan(prescription)
    ahead_mm = points_mm[:, 2] - fan.z_mm[0]
    return ahead_mm * np.tan(WIDE_RAD) < np.hypot(points_mm[:, 0], points_mm[:, 1])


def depths_mm(prescription: Prescription, points_mm: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n"]:
    """Depths of points, (n,): vision z, or for steep points that of a point on the axis at their distance."""
    front = np.array([0.0, 0.0, pupil_fan(prescription).z_mm[0]])
    by_distance = front[2] + np.linalg.norm(points_mm - front, axis=1)
    return np.where(is_steep(prescription, points_mm), by_distance, points_mm[:, 2])
