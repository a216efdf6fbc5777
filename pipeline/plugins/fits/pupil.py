"""The entrance pupil of each ray of a field: where it passes the axis."""

from dataclasses import dataclass

import numpy as np

from pipeline.fits.field import FieldRays

_STEEP = 1e-4
"""Slope below which a ray has no point where it passes the axis [1]: it would be a quotient of small numbers."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PupilCurve:
    """Points where rays pass the axis, from the middle of the field to its edge: the entrance pupil of each, (m,)."""

    angle_deg: np.ndarray  # angle of the ray with the axis
    z_mm: np.ndarray  # vision z of the point of the ray that is nearest to the axis
    aside_mm: np.ndarray  # distance of that point from the axis


def pupil_curve(field: FieldRays) -> PupilCurve:
    """Find where the rays pass the axis, sorted by their angle."""
    across = np.hypot(*field.rays.direction[:, :2].T)
    angle = np.arctan2(across, field.rays.direction[:, 2])
    rows = np.flatnonzero(angle > np.arctan(_STEEP))
    rows = rows[np.argsort(angle[rows], kind="stable")]
    origin, direction = field.rays.origin_mm[rows], field.rays.direction[rows]
    along = -np.einsum("ni,ni->n", origin[:, :2], direction[:, :2]) / across[rows] ** 2
    nearest = origin + along[:, None] * direction
    return PupilCurve(angle_deg=np.degrees(angle[rows]), z_mm=nearest[:, 2], aside_mm=np.hypot(*nearest[:, :2].T))
