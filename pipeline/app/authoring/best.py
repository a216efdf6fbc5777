"""The poses of many that tell most about cameras: chosen by what a calibration by them would then predict.

What a set of poses is worth is the mean variance of projections over image and depth of field, by OpenCV's five
coefficients, or a fisheye where a lens sees beside itself. Poses are exchanged one by one as long as that gains.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from pipeline.app.authoring.poses import NOISE_PX, BoardPose, CameraField
from pipeline.errors import UsageError
from pipeline.fits.field import field_rays
from pipeline.fits.fitting import CENTRE, MODELS, fitted
from pipeline.fits.information import Information, View, derivatives
from pipeline.results.opening import ready

CANDIDATES = 12
"""Poses of which one is chosen: of twice as many the best are better by a few percent."""
_EVERY = 29
"""Step through the grid of the field [1]: some thirty projections at each distance, all over the image, as it is a
prime that divides no row of it."""
_BENT_PX = 5.0
"""What a coefficient that views do not tell may bend the image by [px]: programs start at 0, and stay near there."""
_PASSES = 4
"""Most rounds of exchanges: each tries every candidate in every place."""
_GAINS = 1e-3
"""Share of the variance by which an exchange has to gain."""


class _Judge:
    """A camera before all candidates."""

    def __init__(self, field: CameraField, number: int, poses: Sequence[BoardPose]) -> None:
        camera = ready(replace(field.camera, microlenses=None))
        rays = field_rays(camera)
        fit = fitted(rays, "fisheye" if field.is_wide else "brown")
        centre, own = np.split(fit.parameters, [len(CENTRE)])
        project = MODELS[fit.model.name].of_rows
        moved, views = field.vision_from_first.copy(), []
        moved[:3, 3] -= centre
        for pose in poses:
            seen = np.isfinite(pose.seen_px[number, :, 0])
            points = field.points_mm[seen]
            views.append(
                View(moved @ pose.vision_from_target, points, np.zeros((len(points), 0)), pose.seen_px[number, seen])
            )
        self._all = Information.of(fit.model.parameters[len(CENTRE) :], project, own, views, NOISE_PX)
        near, far = field.depth_mm
        distances = (near, 2 / (1 / near + 1 / far), far)
        self._points = np.concatenate([rays.points(z_mm)[::_EVERY] for z_mm in distances]) - centre

        by_own, _ = derivatives(project, own, self._points, np.zeros((len(self._points), 0)))
        bends = np.array([name in fit.model.coefficients for name in self._all.names])
        self._prior = np.diag(bends * (np.abs(by_own).max(axis=(0, 1)) / _BENT_PX) ** 2)

    def variance_px2(self, chosen: Sequence[int]) -> float:
        """Mean variance of projections by some of the candidates; infinite where they leave something open."""
        known = self._all.only(chosen)
        known = replace(known, matrix=known.matrix + self._prior)
        covariance = known.of_projections(self._points, np.zeros((len(self._points), 0)))
        return float(np.trace(covariance, axis1=1, axis2=2).mean())


def best_of(
    fields: Sequence[CameraField], poses: Sequence[BoardPose], count: int, tell: Callable[[str], None]
) -> list[BoardPose]:
    """So many of the poses, in their order. UsageError if no such set determines the cameras."""
    judges = [_Judge(field, number, poses) for number, field in enumerate(fields)]

    def worth(chosen: Sequence[int]) -> float:
        return sum(judge.variance_px2(chosen) for judge in judges)

    chosen = list(range(count))
    least = first = worth(chosen)
    for _ in range(_PASSES):
        before = least
        for place in range(count):
            for other in set(range(len(poses))) - set(chosen):
                tried = [*chosen[:place], other, *chosen[place + 1 :]]
                if (value := worth(tried)) < least * (1 - _GAINS):
                    chosen, least = tried, value
        if not least < before * (1 - _GAINS):
            break
    if not np.isfinite(least):
        hint = "take more poses, or a target of more points"
        raise UsageError(f"no {count} of {len(poses)} poses determine the camera", hint=hint)
    gain = f" instead of {np.sqrt(first / len(fields)):.3g} px by the first" if np.isfinite(first) else ""
    tell(
        f"chosen of {len(poses)} poses: a calibration by them projects to {np.sqrt(least / len(fields)):.3g} px{gain},"
        f" one sigma over image and depth of field, with corners detected to {NOISE_PX:g} px"
    )
    return [poses[i] for i in sorted(chosen)]
