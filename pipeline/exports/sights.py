"""Image positions and rays of a camera as a format counts them: the only place where pixels get other numbers."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from pipeline.exports.ray_patches import Sight, rows_of_rays
from pipeline.formats import Convention, ImageAxes, Origin
from pipeline.results.records import BuiltCamera

_FIRST_PIXEL = {Origin.ZERO: 0.0, Origin.HALF: 0.5, Origin.ONE: 1.0}
"""Number of the centre of the top-left pixel [px]; of other origins it depends on the image."""


def positions(places_px: np.ndarray, convention: Convention, size_px: tuple[int, int]) -> np.ndarray:
    """Image positions of ours as a format counts them, (..., 2) [px, or 1]."""
    upwards = convention.axes is ImageAxes.X_UP
    if convention.origin is Origin.SHARE:
        shares = (places_px + _FIRST_PIXEL[Origin.HALF]) / np.array(size_px)
        shifted = np.stack([shares[..., 0], 1 - shares[..., 1]], axis=-1) if upwards else shares
    elif convention.origin is Origin.IMAGE_CENTRE:
        shifted = (places_px - (np.array(size_px) - 1) / 2) * (1, -1 if upwards else 1)
    else:
        shifted = (places_px + _FIRST_PIXEL[convention.origin]) * (1, -1 if upwards else 1)
    return shifted[..., ::-1] if convention.axes is ImageAxes.Y_X else shifted


@dataclass(frozen=True, kw_only=True)
class CameraRays:
    """A camera made ready when its rays are asked for, and its positions as a format counts them."""

    built: BuiltCamera = field(repr=False)
    ready: Callable[[], Sight] = field(repr=False)
    convention: Convention

    @cached_property
    def sight(self) -> Sight:
        """The camera made ready, in our conventions."""
        return self.ready()

    def band(self, first: int, end: int) -> tuple[np.ndarray, np.ndarray | None]:
        """Rays (rows, w, 6) of the pixels of some rows, and the microlenses (rows, w, 2) of a plenoptic camera.

        Origin [mm] and direction, vision frame, the top-left pixel first; NaN where no light leaves. Rays are traced
        behind microlenses, else by patches.
        """
        width, _ = self.built.size_px
        if not self.built.is_plenoptic:
            near_mm, far_mm = map(float, self.built.record["near_far_mm"])
            return np.concatenate(rows_of_rays(self.sight, width, (first, end), (near_mm, far_mm)), axis=-1), None
        y, x = np.mgrid[first:end, 0:width].reshape(2, -1).astype(float)
        rays = self.sight.rays(x, y)
        assert rays.microlens is not None
        lines = np.concatenate([rays.origin_mm, rays.direction], axis=1)
        return lines.reshape(end - first, width, 6), rays.microlens.reshape(end - first, width, 2)

    @property
    def ends(self) -> np.ndarray:
        """Positions of the centres of the first and of the last pixel, (2, 2)."""
        return self.positions(np.array([[0.0, 0.0], np.array(self.built.size_px) - 1.0]))

    def positions(self, places_px: np.ndarray) -> np.ndarray:
        """Image positions (..., 2) of ours as the format counts them."""
        return positions(places_px, self.convention, self.built.size_px)
