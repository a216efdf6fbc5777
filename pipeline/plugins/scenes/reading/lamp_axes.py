"""Axes and scales of the transforms of lamps, which may scale, but have poses without scales."""

import math
from collections.abc import Sequence

import numpy as np
from pxr import Usd, UsdGeom

from pipeline.scene.usd.poses import is_visible, world_from

EVEN = 1e-6
"""Accepted deviation of scales from each other, and of axes from a right angle [1]: of single precision."""
_FLAT = 1e-12
"""Volume of the box of unit axes up to which a transform flattens [1]: rounding leaves 1e-16 of axes in a plane."""
LENGTHS = 1e-30, 1e30
"""Lengths of unit axes under a transform that does not flatten [1]: volumes of others may underflow or overflow."""
_POLE_Z = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
"""Rotation of a dome from the pole +Y to +Z."""


def axes_and_scales(matrix: np.ndarray) -> tuple[np.ndarray, tuple[float, float, float]]:
    """Unit axes of a transform, the columns (3, 3), at right angles with z kept, and its scales along x, y and z.

    An even transform has three equal scales, which callers compare exactly. One that flattens has no such axes: its
    scales are 0, and it is an error of the lamp.
    """
    axes = matrix[:3, :3]
    if not _volume(matrix) > _FLAT:
        return axes, (0.0, 0.0, 0.0)
    mean_scale = float(abs(np.linalg.det(axes)) ** (1 / 3))
    if np.abs(axes.T @ axes / mean_scale**2 - np.eye(3)).max() <= EVEN:
        return axes / mean_scale, (mean_scale, mean_scale, mean_scale)
    x_length, y_length, z_length = (float(np.linalg.norm(axes[:, k])) for k in range(3))
    forward = axes[:, 2] / z_length
    right = axes[:, 0] - forward * (forward @ axes[:, 0])
    right = right / np.linalg.norm(right)
    up = np.cross(forward, right) * math.copysign(1.0, float(np.linalg.det(axes)))
    return np.stack([right, up, forward], axis=1), (x_length, y_length, z_length)


def _volume(matrix: np.ndarray) -> float:
    """Volume of the box of unit vectors along the axes of a transform [1]: 0 if it flattens, 1 at right angles."""
    shortest, longest = LENGTHS
    lengths = np.linalg.norm(matrix[:3, :3], axis=0)
    if not ((lengths >= shortest) & (lengths <= longest)).all():
        return 0.0
    return abs(float(np.linalg.det(matrix[:3, :3] / lengths)))


def world_from_lamp(prim: Usd.Prim, times: Sequence[float], unit_mm: float) -> np.ndarray:
    """Poses of a lamp at times, without the scale, (n, 4, 4) [mm]."""
    stack = np.array(world_from(prim, times, unit_mm))
    stack[:, :3, :3] = [axes_and_scales(matrix)[0] for matrix in stack]
    return stack @ _POLE_Z if _has_pole_z(prim) else stack


def _has_pole_z(prim: Usd.Prim) -> bool:
    """Whether the pole of the picture of a dome is its Z axis."""
    pole = (
        prim.GetAttribute("poleAxis").Get(Usd.TimeCode.EarliestTime()) if prim.GetTypeName() == "DomeLight_1" else "Y"
    )
    up = UsdGeom.GetStageUpAxis(prim.GetStage())
    return bool(pole == "Z" or (pole == "scene" and up == UsdGeom.Tokens.z))


def flattened_at(prim: Usd.Prim, frames: tuple[int, ...]) -> list[int]:
    """Frames with a light whose transform flattens it; the first one counts always, for its size is read there."""
    stack = world_from(prim, frames, 1.0)
    flat = [frame for frame, matrix in zip(frames, stack, strict=True) if _volume(matrix) <= _FLAT]
    return [frame for frame in flat if frame == frames[0] or is_visible(prim, frame)]
