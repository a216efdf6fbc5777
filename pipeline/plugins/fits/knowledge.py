"""Knowledge of a calibration by a build: the views of a camera, a named model at them, and what it then predicts."""

from dataclasses import dataclass
from functools import partial

import numpy as np

from pipeline.fits.field import FieldRays, FitError, field_rays
from pipeline.fits.fitting import CENTRE, MODELS, fitted, rms
from pipeline.plugins.fits.information import Information, Project, View, information
from pipeline.plugins.fits.result import THIN_LENS
from pipeline.plugins.fits.splined import EXAMPLE, Splined
from pipeline.plugins.fits.thin_plenoptic import FULL, PARAMETERS, on_sensor_px, thin_plenoptic
from pipeline.results.output import Output
from pipeline.results.ready_camera import ReadyCamera
from pipeline.results.records import BuiltCamera
from pipeline.spelling import did_you_mean

_LEAST_POINTS = 4
"""Fewest points of a view: three leave its pose nearly open."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Prediction:
    """Standard deviation of projections over the image at one distance: the longer axis of the ellipse, (n,) [px]."""

    z_mm: float
    x_px: np.ndarray  # (n, 2)
    deviation_px: np.ndarray


@dataclass(frozen=True, slots=True, kw_only=True)
class Knowledge:
    """Information of a data set about a camera, and predictions by it, through a model."""

    camera: str
    model: str
    size_px: tuple[int, int]
    information: Information
    predictions: tuple[Prediction, ...]

    @property
    def rms_px(self) -> float:
        """Root mean square of what the model leaves of the exact rows: no noise."""
        return rms(self.information.residual_px)


def knowledge_of(output: Output, camera: BuiltCamera, ready: ReadyCamera, model: str, noise_px: float) -> Knowledge:
    """Fit a model and all poses to the rows of a build, and take the information and predictions there.

    Raises FitError: there is no such model, it cannot stand for the camera, or too few points are seen.
    """
    field = field_rays(ready)
    f_px, *middle_px, centre_z_mm = field.start.tolist()
    splined = Splined.named(model, np.array([f_px, f_px, *middle_px]))
    models = [THIN_LENS] if camera.is_plenoptic else [*MODELS, EXAMPLE]
    if model not in models and (splined is None or camera.is_plenoptic):
        hint = did_you_mean(model, models) or f"models for it: {', '.join(models)}"
        raise FitError(f"{camera.name} has no model {model!r}", hint=hint)
    parameters: tuple[str, ...]
    project: Project
    if splined is not None:
        if splined.columns * splined.rows > sum(len(view.correspondences.point_id) for view in camera.views):
            raise FitError(f"{camera.name} sees too few points for {model}")
        parameters, project = splined.parameters, splined.project
        centre = np.array([0.0, 0.0, centre_z_mm])
        start = splined.nearest(field.points(field.between_mm[2]) - centre, field.x_px)
    elif model == THIN_LENS:
        parameters, start = PARAMETERS, thin_plenoptic(ready).parameters
        project, centre = partial(on_sensor_px, ready), np.zeros(3)
    else:
        pinhole = fitted(field, model)
        centre, start = np.split(pinhole.parameters, [len(CENTRE)])
        project, parameters = pinhole.model.of_rows, pinhole.model.parameters[len(CENTRE) :]

    views = views_of(output, camera, ready, centre)
    if sum(2 * len(view.x_px) for view in views) < len(parameters) + 6 * len(views):
        raise FitError(f"{camera.name} sees too few points for {model} and {len(views)} poses")
    fit = information(parameters, project, start, views, noise_px)
    distances = (field.planes_mm[0], *field.between_mm[2:3], field.planes_mm[1], 10 * field.planes_mm[1])
    predictions = tuple(_predicted(fit, field, ready, centre, z_mm) for z_mm in distances)
    return Knowledge(camera=camera.name, model=model, size_px=camera.size_px, information=fit, predictions=predictions)


def views_of(output: Output, camera: BuiltCamera, ready: ReadyCamera, centre_mm: np.ndarray) -> list[View]:
    """The views of a camera, one for each target in each frame that shows enough points of it."""
    lattice, views = ready.rig.tracer.lattice, []
    for view in camera.views:
        rows = view.correspondences
        if lattice is not None:
            rows = rows[rows.hit_fraction >= FULL]
        for name, pose in view.poses.camera_from_target.items():
            of_target = rows[rows.target == name]
            if len(np.unique(of_target.point_id)) < _LEAST_POINTS:
                continue
            vertices = np.zeros((len(of_target), 0))
            if lattice is not None:
                vertices = ready.rig.tracer.vertices_mm[lattice.rows(of_target.microlens_k, of_target.microlens_l)]
            model_from_target = pose.copy()
            model_from_target[:3, 3] -= centre_mm
            x_px = np.stack([of_target.x_px, of_target.y_px], axis=1).astype(float)
            points_mm = output.targets[name].points_mm[of_target.point_id]
            views.append(View(model_from_target, points_mm, vertices, x_px))
    if not views:
        raise FitError(f"{camera.name} sees nothing that tells about it", hint="a view needs four points of a target")
    return views


def _predicted(
    fit: Information, field: FieldRays, ready: ReadyCamera, centre_mm: np.ndarray, z_mm: float
) -> Prediction:
    """Predict points on rays of the main lens all over the image, behind microlenses through that of each position."""
    points, vertices = field.points(z_mm) - centre_mm, np.zeros((len(field.x_px), 0))
    tracer = ready.rig.tracer
    if tracer.lattice is not None:
        vertices = tracer.vertices_mm[ready.rig.microlens_at(tracer.positions_mm(*field.x_px.T))]
    covariance = fit.of_projections(points, vertices)
    is_open = ~np.isfinite(covariance).all(axis=(1, 2))
    largest = np.linalg.eigvalsh(np.where(is_open[:, None, None], 0.0, covariance))[:, -1]
    return Prediction(z_mm=z_mm, x_px=field.x_px, deviation_px=np.where(is_open, np.inf, np.sqrt(largest)))
