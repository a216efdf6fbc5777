"""Radiance of the scene along rays: flat targets before a uniform background.

Embree says which target a ray meets first; the hit is recomputed in double on that target's plane, and the pattern is
evaluated there by its formula. No texture, no filter.
"""

from collections.abc import Sequence

import numpy as np

from pipeline.frames import apply
from pipeline.render.embree import PlanarScene
from pipeline.target.checkerboard import Checkerboard
from pipeline.target.kernels import checkerboard_light


class TargetLight:
    """Targets that radiate like their artwork, equally into all directions, from their front; their back is black.

    Parameters
    ----------
    targets : sequence of (Checkerboard, (4, 4) float64)
        Each with its pose vision_from_target.
    background : float
        Radiance where no target is.
    """

    def __init__(self, targets: Sequence[tuple[Checkerboard, np.ndarray]], background: float) -> None:
        self._targets = list(targets)
        self._background = background
        self._scene = PlanarScene([_corners(board, pose) for board, pose in self._targets])

    def radiance(self, origin_mm: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Radiance that arrives along each ray, (n,); origins and directions (n, 3), vision frame."""
        first = self._scene.first_hit(origin_mm, direction)
        light = np.full(len(first), self._background)
        for index, (board, pose) in enumerate(self._targets):
            checkerboard_light(*board.artwork, pose, first == index, origin_mm, direction, light)
        return light


def _corners(board: Checkerboard, vision_from_target: np.ndarray) -> np.ndarray:
    """Corners of the board with its margin: top left, top right, bottom right, bottom left, (4, 3) vision frame."""
    x, y = board.half_extent_mm
    corners = np.array([[-x, y, 0.0], [x, y, 0.0], [x, -y, 0.0], [-x, -y, 0.0]])
    return apply(vision_from_target, corners)
