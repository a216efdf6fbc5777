"""A thin lens before an array of pinholes, fitted to exact positions: what libpleno and its relatives assume.

The lens stands at z = L on the axis and has the focal length F; D and d are the distances from lens to array and from
array to sensor. A point at Z before the lens has its image at q = - p F / (Z - F), b = Z F / (Z - F) behind it. Radial
distortion acts there, q (1 + A0 r^2 + A1 r^4 + A2 r^6), r in mm. The straight line from q through the centre v meets
the sensor at v - (v - q) d / (b - D). comsee-research/libpleno: pleno/geometry/camera/camera.cpp.

The pitch of the array is that of the camera. A calibration that frees it, too, finds another F, L and D by tens of
millimetres for a residual that is smaller by less than a thousandth: positions hardly determine it. Positions in the
penumbra are not fitted: there a part of the bundle is missing, and no straight line through a centre explains that.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.camera.figures.first_order_figures import report
from pipeline.fits.field import FitError, field_rays
from pipeline.fits.fitting import least, rms
from pipeline.fits.thin_lens import thin_lens
from pipeline.results.ready_camera import ReadyCamera

PARAMETERS = (
    "focal_mm",
    "lens_z_mm",
    "main_lens_mm",
    "sensor_mm",
    "turn_rad",
    "array_x_mm",
    "array_y_mm",
    "sensor_x_mm",
    "sensor_y_mm",
    "a0",
    "a1",
    "a2",
)
"""F, L, D, d; turn and shift of the array; shift of the sensor; radial distortion."""
_EVERY, _POINTS = 137, (10, 40, 160)
"""Step through the rays of the field that choose scene points, and points at each distance [1]: a prime, so that they
lie all over the image; more points where few positions are in full light.
"""
FULL = 0.9
"""Hit fraction from which a position counts as in full light [1]."""
_LEAST_ROWS = 100
"""Fewest positions that are fitted: twelve parameters are determined many times."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ThinPlenopticFit:
    """The thin-lens plenoptic camera that explains exact positions best."""

    parameters: np.ndarray  # (12,), in the order of `PARAMETERS`
    residual_px: np.ndarray  # (n, 2), of the positions in full light, to which it was fitted
    dim_px: np.ndarray  # (m, 2), of the positions in the penumbra, for the same camera
    points: int  # scene points whose positions they are

    @property
    def values(self) -> dict[str, float]:
        return dict(zip(PARAMETERS, self.parameters.tolist(), strict=True))

    @property
    def rms_px(self) -> float:
        """Root mean square of the lengths of the residuals in full light."""
        return rms(self.residual_px)

    @property
    def dim_rms_px(self) -> float | None:
        """The same in the penumbra; None where nothing lies there."""
        return rms(self.dim_px) if len(self.dim_px) else None

    @property
    def max_px(self) -> float:
        """Length of the largest residual in full light."""
        return float(np.hypot(*self.residual_px.T).max())


def thin_plenoptic(camera: ReadyCamera) -> ThinPlenopticFit:
    """Fit to the positions of points all over the image, at distances from the near to the far plane.

    Raises FitError: it has no microlenses, or too few of them see points.
    """
    lattice = camera.rig.tracer.lattice
    if lattice is None:
        raise FitError(f"{camera.name or 'the camera'} has no microlenses", hint="choose a model of a pinhole")
    for count in _POINTS:
        points = _scene_points(camera, count)
        images = camera.project(points)
        is_full = images.hit_fraction >= FULL
        if is_full.sum() >= _LEAST_ROWS:
            break
    else:
        raise FitError(
            f"{is_full.sum()} positions in full light of {len(points)} points are too few to fit a thin lens"
        )
    assert images.microlens is not None
    vertices = camera.rig.tracer.vertices_mm[lattice.rows(*images.microlens.T)]
    points_mm, x_px = points[images.point], np.stack([images.x_px, images.y_px], axis=1)

    def residual_px(p: np.ndarray, rows: np.ndarray = is_full) -> np.ndarray:
        return on_sensor_px(camera, p, points_mm[rows], vertices[rows]) - x_px[rows]

    ranges = np.array([(-np.inf, 0.0 if name in ("a0", "a1", "a2") else np.nan, np.inf) for name in PARAMETERS])
    parameters = least(lambda p: residual_px(p).ravel(), _start(camera), ranges)
    return ThinPlenopticFit(
        parameters=parameters,
        residual_px=residual_px(parameters),
        dim_px=residual_px(parameters, ~is_full),
        points=len(points),
    )


def on_sensor_px(camera: ReadyCamera, p: np.ndarray, points_mm: np.ndarray, vertices_mm: np.ndarray) -> np.ndarray:
    """Image positions of points (n, 3) through microlenses (n, 2), as `Tracer.pixels_at`, analytic, (n, 2)."""
    on_sensor_mm = positions_mm(p, points_mm, vertices_mm) - p[7:9]  # the sensor is shifted
    return np.asarray(camera.rig.tracer.pixels_at(np.zeros((1, 2))) - on_sensor_mm / camera.camera.sensor.pitch_mm)


def positions_mm(p: np.ndarray, points_mm: np.ndarray, vertices_mm: np.ndarray) -> np.ndarray:
    """Points of the sensor where a thin-lens camera images points (n, 3) through microlenses (n, 2), vision frame."""
    focal, lens_z, main_lens, sensor, turn, x, y = p[:7]
    a0, a1, a2 = p[9:]
    # The thin lens images points at a depth behind it, where radial distortion acts.
    object_distance = points_mm[:, 2] - lens_z
    image_distance = object_distance * focal / (object_distance - focal)
    image = points_mm[:, :2] * (-focal / (object_distance - focal))[:, None]
    r2 = (image * image).sum(axis=1)
    image = image * (1 + r2 * (a0 + r2 * (a1 + r2 * a2)))[:, None]
    # A straight line from there through the centre of a microlens meets the sensor.
    rotated = vertices_mm @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    vertex = rotated + np.array([x, y])
    return np.asarray(vertex - (vertex - image) * (sensor / (image_distance - main_lens))[:, None])


def _scene_points(camera: ReadyCamera, count: int) -> np.ndarray:
    """Points on rays of the main lens all over the image, (5 count, 3); each distance has others."""
    field = field_rays(camera)
    points = []
    for number, z_mm in enumerate(field.between_mm):
        rows = (np.arange(count) * _EVERY + number) % len(field.x_px)
        points.append(field.points(z_mm)[rows])
    return np.concatenate(points)


def _start(camera: ReadyCamera) -> np.ndarray:
    figures = report(camera.camera)
    focal_mm = np.array([kind["focal_length_mm"] for kind in figures["mla"]["types"]])
    lens, start = thin_lens(figures, focal_mm), np.zeros(len(PARAMETERS))
    front_mm = figures["lens"]["principal_planes_mm"][0]
    start[:4] = lens.focal_mm, front_mm, lens.main_lens_mm, lens.sensor_mm
    return start
