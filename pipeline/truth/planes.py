"""Tangent planes at target points, vision frame, as kernels read them: rows point, first axis, second axis, normal."""

import numpy as np

from pipeline.records.shapes import Float64


def tangent_planes(
    vision_from_target: Float64[np.ndarray, "4 4"],
    points_mm: Float64[np.ndarray, "p 3"],
    axes: Float64[np.ndarray, "p 3 3"] | None = None,
) -> np.ndarray:
    """Tangent planes for the kernels, (p, 4, 3), at points of a target; by default those of a flat one."""
    planes = np.empty((len(points_mm), 4, 3))
    planes[:, 0] = points_mm @ vision_from_target[:3, :3].T + vision_from_target[:3, 3]
    turn = vision_from_target[:3, :3]
    planes[:, 1:] = turn.T if axes is None else (turn @ axes).transpose(0, 2, 1)
    return planes


def faces_camera(planes: Float64[np.ndarray, "n 4 3"]) -> np.ndarray:
    """Whether the front of each plane (p, 4, 3) faces the centre of the aperture stop, (p,) bool."""
    return np.einsum("pi,pi->p", planes[:, 0], planes[:, 3]) < 0


def plane_name(target: str, number: int, planes: int) -> str:
    """Name of the position image of a tangent plane: that of the target, with a number if it has several."""
    return target if planes == 1 else f"{target}.{number}"
