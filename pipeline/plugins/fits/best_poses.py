"""Information that poses of a target give a calibration of cameras, and selection of the most informative ones.

A set of poses is rated by the mean variance of projections over image and depth of field (I-optimality), by OpenCV's
five coefficients, or by a fisheye model for very wide lenses. Poses are exchanged one by one while that gains, as by
Cook and Nachtsheim, Technometrics 22 (1980) 315, but each gain is taken at once.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.app.authoring.poses import BoardPose, CameraField
from pipeline.camera.figures.equivalent_pinhole import pinhole
from pipeline.camera.focusing.depth_of_field import focused
from pipeline.errors import UsageError
from pipeline.fits.field import field_rays
from pipeline.fits.fitting import CENTRE, MODELS, fitted
from pipeline.plugins.fits.information import Information, View, derivatives
from pipeline.results.opening import ready

NOISE_PX = 0.05
"""Standard deviation of a detected corner along x and y [px]: good detectors on sharp images of real boards."""
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Uncertainty:
    """Standard deviations of the results of a calibration, with `NOISE_PX` in each coordinate."""

    principal_distance_px: float
    principal_point_px: tuple[float, float]


class _Judge:
    """Information about a camera by each candidate, and the points by whose projections sets of them are rated."""

    def __init__(self, field: CameraField, number: int, poses: Sequence[BoardPose]) -> None:
        """The camera is the one of this number among those of the poses."""
        camera = ready(replace(field.camera, microlenses=None))
        rays = field_rays(camera)
        fit = fitted(rays, "fisheye" if field.is_wide else "brown")
        centre, parameters = np.split(fit.parameters, [len(CENTRE)])
        project = MODELS[fit.model.name].of_rows
        model_from_first = field.vision_from_first.copy()
        model_from_first[:3, 3] -= centre
        views = []
        for pose in poses:
            is_visible = np.isfinite(pose.seen_px[number, :, 0])
            model_from_target = model_from_first @ pose.vision_from_target
            views.append(_view(model_from_target, field.points_mm[is_visible], pose.seen_px[number, is_visible]))
        self._all = Information.of(fit.model.parameters[len(CENTRE) :], project, parameters, views, NOISE_PX)
        near, far = field.depth_mm
        distances = (near, 2 / (1 / near + 1 / far), far)
        self._points = np.concatenate([rays.points(z_mm)[::_EVERY] for z_mm in distances]) - centre

        by_parameter, _ = derivatives(project, parameters, self._points, np.zeros((len(self._points), 0)))
        is_coefficient = np.array([name in fit.model.coefficients for name in self._all.names])
        self._prior = np.diag(is_coefficient * (np.abs(by_parameter).max(axis=(0, 1)) / _BENT_PX) ** 2)

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

    def variance_px2(chosen: Sequence[int]) -> float:
        return sum(judge.variance_px2(chosen) for judge in judges)

    chosen = list(range(count))
    least = first = variance_px2(chosen)
    for _ in range(_PASSES):
        before = least
        for slot in range(count):
            for candidate in set(range(len(poses))) - set(chosen):
                exchanged = [*chosen[:slot], candidate, *chosen[slot + 1 :]]
                if (variance := variance_px2(exchanged)) < least * (1 - _GAINS):
                    chosen, least = exchanged, variance
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


def prediction(fields: Sequence[CameraField], poses: Sequence[BoardPose]) -> list[list[str]]:
    """Lines about the uncertainty of each camera's calibration by these poses."""
    return [
        [] if field.camera.microlenses else [_line(field, uncertainty)]
        for field, uncertainty in zip(fields, predicted(fields, poses), strict=True)
    ]


def _line(field: CameraField, uncertainty: Uncertainty | None) -> str:
    if uncertainty is None:
        return "no calibration of f, centre and k1: too few points, or no pinhole fits the lens"
    f_px, (x_px, y_px) = uncertainty.principal_distance_px, uncertainty.principal_point_px
    return (
        f"a calibration (f, centre, k1; corners detected to {NOISE_PX:g} px) knows f to"
        f" {100 * f_px / field.principal_distance_px:.2g} % ({f_px:.1f} px) and the centre to {x_px:.1f} x"
        f" {y_px:.1f} px, one sigma"
    )


def predicted(fields: Sequence[CameraField], poses: Sequence[BoardPose]) -> list[Uncertainty | None]:
    """Uncertainty of each camera's calibration; None with microlenses, without a pinhole, and for too few points."""
    uncertainties = list[Uncertainty | None]()
    for number, field in enumerate(fields):
        fit = None if field.camera.microlenses else pinhole(focused(field.camera))
        if fit is None:
            uncertainties.append(None)
            continue
        pinhole_from_first = field.vision_from_first - np.outer((0, 0, 1, 0), (0, 0, 0, field.pupil_mm))
        views = []
        for pose in poses:
            points_mm = field.points_mm[np.isfinite(pose.seen_px[number, :, 0])]
            views.append(_view(pinhole_from_first @ pose.vision_from_target, points_mm, np.zeros((len(points_mm), 2))))
        k1 = fit.distorted.distortion[0]  # the distortion around a centre tells it, too
        uncertainties.append(_uncertainty(field.principal_distance_px, k1, views))
    return uncertainties


def _view(model_from_target: np.ndarray, points_mm: np.ndarray, x_px: np.ndarray) -> View:
    """A view of a camera without microlenses."""
    return View(model_from_target, points_mm, np.zeros((len(points_mm), 0)), x_px)


def _uncertainty(principal_distance_px: float, k1: float, views: Sequence[View]) -> Uncertainty | None:
    """Uncertainty of a calibration of a pinhole with one focal length and k1; None where there are too few points."""
    values = np.array([principal_distance_px, 0.0, 0.0, k1])
    information = Information.of(("f", "x", "y", "k1"), _simple, values, views, NOISE_PX)
    f_px, x_px, y_px, _ = information.deviations.tolist()
    return Uncertainty(principal_distance_px=f_px, principal_point_px=(x_px, y_px)) if information.rank == 4 else None


def _simple(p: np.ndarray, points: np.ndarray, _: np.ndarray) -> np.ndarray:
    """Projection by one focal length, a centre and k1."""
    u = points[:, :2] / points[:, 2:]
    return np.asarray(p[0] * (1 + p[3] * (u * u).sum(axis=1))[:, None] * u + p[1:3])
