"""Selection of the most informative poses for a calibration of cameras.

A set of poses is rated by the mean variance of projections over image and depth of field (I-optimality), by OpenCV's
five coefficients, or by a fisheye model for very wide lenses. Poses are exchanged one by one while that gains, as by
Cook and Nachtsheim, Technometrics 22 (1980) 315, but each gain is taken at once.
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
"""Candidate poses per selected pose: with twice as many the best are better by a few percent."""
_EVERY = 29
"""Step through the grid of the field [1]: some thirty projections at each distance, all over the image, because no row
is a multiple of this prime.
"""
_BENT_PX = 5.0
"""Prior standard deviation of an undetermined coefficient, as bending of the image [px]: programs start at 0."""
_PASSES = 4
"""Most rounds of exchanges: each tries every candidate in every slot."""
_GAINS = 1e-3
"""Least relative decrease of the variance that justifies an exchange."""


class _Judge:
    """A camera before all candidates."""

    def __init__(self, field: CameraField, number: int, poses: Sequence[BoardPose]) -> None:
        camera = ready(replace(field.camera, microlenses=None))
        rays = field_rays(camera)
        fit = fitted(rays, "fisheye" if field.is_wide else "brown")
        centre, own = np.split(fit.parameters, [len(CENTRE)])
        project = MODELS[fit.model.name].of_rows
        moved = field.vision_from_first.copy()
        views = []
        moved[:3, 3] -= centre
        for pose in poses:
            visible = np.isfinite(pose.seen_px[number, :, 0])
            points = field.points_mm[visible]
            views.append(
                View(moved @ pose.vision_from_target, points, np.zeros((len(points), 0)), pose.seen_px[number, visible])
            )
        self._all = Information.of(fit.model.parameters[len(CENTRE) :], project, own, views, NOISE_PX)
        near, far = field.depth_mm
        distances = (near, 2 / (1 / near + 1 / far), far)
        self._points = np.concatenate([rays.points(z_mm)[::_EVERY] for z_mm in distances]) - centre

        by_own, _ = derivatives(project, own, self._points, np.zeros((len(self._points), 0)))
        bends = np.array([name in fit.model.coefficients for name in self._all.names])
        self._prior = np.diag(bends * (np.abs(by_own).max(axis=(0, 1)) / _BENT_PX) ** 2)

    def variance_px2(self, chosen: Sequence[int]) -> float:
        """Mean variance of projections by these candidates; infinite if they leave something undetermined."""
        information = self._all.only(chosen)
        information = replace(information, matrix=information.matrix + self._prior)
        covariance = information.of_projections(self._points, np.zeros((len(self._points), 0)))
        return float(np.trace(covariance, axis1=1, axis2=2).mean())


def best_of(
    fields: Sequence[CameraField], poses: Sequence[BoardPose], count: int, tell: Callable[[str], None]
) -> list[BoardPose]:
    """The best `count` of the poses, in their order. UsageError if no such set determines the cameras."""
    judges = [_Judge(field, number, poses) for number, field in enumerate(fields)]

    def worth(chosen: Sequence[int]) -> float:
        return sum(judge.variance_px2(chosen) for judge in judges)

    chosen = list(range(count))
    least = first = worth(chosen)
    for _ in range(_PASSES):
        before = least
        for slot in range(count):
            for other in set(range(len(poses))) - set(chosen):
                tried = [*chosen[:slot], other, *chosen[slot + 1 :]]
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
