"""The pinhole that stands for a camera in programs that know nothing else, as OpenCV; viewers get
`camera.figures.viewfinder`.

It is fitted to mean rays: those whose crossings with a plane are J, so the same that define every exact position. The
paraxial entrance pupil would do for chief rays near the axis; coma pulls the mean away from them, by 0.18 mm along the
axis in the double Gauss at F/7.7, which is 0.1 px of its image. In the equations of OpenCV with C the centre,
u = (X - C_x, Y - C_y) / (Z - C_z), r = |u|:

    x = f (u (1 + k1 r^2 + k2 r^4 + k3 r^6) + tangential(p1, p2; u)) + c

The image plane is parallel to the sensor, so a pinhole has the axes of the vision frame.
"""

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from pipeline.camera.integrals import Bundles, integrals
from pipeline.camera.parts.camera import Camera
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.optics.first_order import first_order

_COLUMNS, _ROWS = 17, 13
"""Image positions that are traced, the corners of the image among them: 442 coordinates for eleven parameters at
most."""
_LEVEL = 2
"""Level of the quadrature: means are right to 1e-8 mm."""
_STEPS = 40
"""Steps of a fit at most: a fit that settles needs few, and one that does not has to end."""
_SETTLED = 1e-12
"""Change of the image by the last step over the norm of all image positions [1]: thousands of roundings of a double."""
_F, _CENTRE, _POINT, _RADIAL, _TANGENTIAL = 0, (1, 2, 3), (4, 5), (6, 7, 8), (9, 10)
"""Places of the parameters: f, C, c, (k1, k2, k3), (p1, p2)."""
_NOTHING_LEFT_PX = 1e-6
"""Residual below which no coefficient is added [px]: a thousandth of the accuracy that tables claim by default."""
_WORTH_IT = 0.9
"""Residual that a further radial coefficient may leave, over the one before [1]: with less gain than a tenth it would
stand for nothing in the lens."""
_IMAGINARY = 1e-30
"""Length of a complex step, in the unit of the parameter: its square vanishes beside 1, and no difference is taken, so
derivatives have neither truncation errors nor cancelled digits."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Projection:
    """A pinhole's image of directions, and how far the rays of the real camera differ from it.

    Attributes
    ----------
    principal_distance_px : float
    principal_point_px : (float, float)
    distortion : tuple of float
        k1, k2, p1, p2, k3 as OpenCV orders and defines them.
    rms_px, max_px : float
        Lengths of the differences to the mean rays, over the image and both planes.
    """

    principal_distance_px: float
    principal_point_px: tuple[float, float]
    distortion: tuple[float, float, float, float, float]
    rms_px: float
    max_px: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Pinhole:
    """One centre of projection, with and without distortion.

    Attributes
    ----------
    centre_mm : (float, float, float)
        Centre of projection, vision frame.
    planes_mm : (float, float)
        Vision z of the planes between which it was fitted: those of J_near and J_far.
    lit_share : float
        Share of the image that light reaches; the rest is not fitted.
    plain : Projection
        Without distortion: the best one over the image.
    distorted : Projection
        With distortion: what a calibration finds, whose principal distance is that on the axis.
    """

    centre_mm: tuple[float, float, float]
    planes_mm: tuple[float, float]
    lit_share: float
    plain: Projection
    distorted: Projection


def pinhole(camera: Camera) -> Pinhole | None:
    """Fit a pinhole to the main lens and the sensor of a focused camera, microlenses left out.

    A radial coefficient is used, up to the third, where it lowers the rms of what is left by a tenth; tangential ones
    are for lenses with displaced surfaces. The centre of any other lens lies on its axis. An ideal thin lens in its
    stop is not fitted: the pinhole is its centre, with its own distortion. None: no pinhole fits, because the field is
    too wide, or because light reaches too little of the sensor.
    """
    if camera.near_mm is None or camera.far_mm is None:
        raise CameraError(
            "near and far plane are not settled", hint="camera.focusing.depth_of_field.focused settles them"
        )
    tracer = Tracer(dataclasses.replace(camera, microlenses=None))
    try:
        rays = _mean_rays(tracer, (camera.near_mm, camera.far_mm))
    except CameraError:
        return None  # no chief ray from its corners
    centred = camera.prescription.is_centred
    free = (_F, _CENTRE[2]) if centred else (_F, *_CENTRE, *_POINT, *_TANGENTIAL)
    if len(rays.x_px) <= len(free):
        return None
    ideal = camera.prescription.ideal
    found = _paraxial(camera) if ideal else _with_radial(rays, rays.fitted(_paraxial(camera), free), free)
    bare = found.copy()
    bare[[*_RADIAL, *_TANGENTIAL]] = 0.0
    plain = bare if ideal and not ideal.distortion else rays.fitted(bare, (_F,) if centred else (_F, *_POINT))
    if not (np.isfinite(found).all() and np.isfinite(plain).all() and found[_F] > 0):
        return None
    x, y, z = (found[list(_CENTRE)] + 0.0).tolist()
    return Pinhole(
        centre_mm=(x, y, z),
        planes_mm=(camera.near_mm, camera.far_mm),
        lit_share=rays.lit_share,
        plain=rays.projection(plain),
        distorted=rays.projection(found),
    )


def _with_radial(rays: "_Rays", found: np.ndarray, free: tuple[int, ...]) -> np.ndarray:
    """Parameters fitted again with those radial coefficients that are worth it."""
    for count in range(1, len(_RADIAL) + 1):
        if rays.rms_px(found) < _NOTHING_LEFT_PX:
            break
        finer = rays.fitted(found, (*free, *_RADIAL[:count]))
        if rays.rms_px(finer) < _WORTH_IT * rays.rms_px(found):
            found = finer
    return found


def _paraxial(camera: Camera) -> np.ndarray:
    """Parameters of the pinhole at the paraxial entrance pupil, with the distortion that an ideal lens has."""
    parameters = np.zeros(11)
    parameters[[_F, *_POINT, _CENTRE[2]]] = paraxial_pinhole(camera)
    if camera.prescription.ideal and camera.prescription.ideal.distortion:
        k1, k2, p1, p2, k3 = camera.prescription.ideal.distortion
        parameters[[*_RADIAL, *_TANGENTIAL]] = k1, k2, k3, p1, p2
    return parameters


def paraxial_pinhole(camera: Camera) -> np.ndarray:
    """The pinhole in the paraxial entrance pupil: principal distance, principal point x and y [px], vision z [mm]."""
    lens, sensor = first_order(camera.prescription), camera.sensor
    principal_mm = lens.principal_distance_mm(camera.sensor_distance_mm)
    x, y = (
        offset_mm / sensor.pitch_mm + (size - 1) / 2
        for offset_mm, size in ((sensor.offset_x_mm, sensor.width_px), (sensor.offset_y_mm, sensor.height_px))
    )
    return np.array([principal_mm / sensor.pitch_mm, x, y, lens.entrance_pupil.z_mm])


@dataclass(frozen=True, slots=True)
class _Rays:
    """Mean rays of image positions (n, 2) by their crossings with two planes, (n, 2) each."""

    x_px: np.ndarray
    crossings_mm: tuple[np.ndarray, np.ndarray]
    planes_mm: tuple[float, float]
    lit_share: float

    def residuals(self, p: np.ndarray) -> np.ndarray:
        """Differences of a pinhole's images of the crossings from their positions, (2 n, 2) [px]; analytic in `p`."""
        (k1, k2, k3), (p1, p2) = p[list(_RADIAL)], p[list(_TANGENTIAL)]
        off = []
        for crossing, z_mm in zip(self.crossings_mm, self.planes_mm, strict=True):
            u, v = ((crossing - p[list(_CENTRE[:2])]) / (z_mm - p[_CENTRE[2]])).T
            square = u * u + v * v
            radial = 1 + square * (k1 + square * (k2 + square * k3))
            x = u * radial + 2 * p1 * u * v + p2 * (square + 2 * u * u)
            y = v * radial + p1 * (square + 2 * v * v) + 2 * p2 * u * v
            off.append(p[_F] * np.stack([x, y], axis=1) + p[list(_POINT)] - self.x_px)
        return np.concatenate(off)

    def fitted(self, start: np.ndarray, free: tuple[int, ...]) -> np.ndarray:
        """The parameters with those in `free` at least squares: Gauss and Newton, derivatives by complex steps."""
        p = start.copy()
        for _ in range(_STEPS):
            tilted = p + _IMAGINARY * 1j * np.eye(len(p))[list(free)]
            with np.errstate(over="ignore", invalid="ignore"):  # a fit that runs away ends as NaN
                slopes = np.stack([self.residuals(row).imag.ravel() for row in tilted], axis=1) / _IMAGINARY
                scale = np.linalg.norm(slopes, axis=0)
            if not (np.isfinite(scale).all() and scale.all()):
                return np.full_like(p, math.nan)
            step = np.linalg.lstsq(slopes / scale, -self.residuals(p).ravel(), rcond=None)[0]
            p[list(free)] += step / scale
            if np.linalg.norm(step) < _SETTLED * np.linalg.norm(self.x_px):
                break
        return p

    def rms_px(self, p: np.ndarray) -> float:
        """Root mean square of the lengths of the residuals."""
        return float(np.sqrt(np.mean(np.sum(self.residuals(p) ** 2, axis=1))))

    def projection(self, p: np.ndarray) -> Projection:
        """The part of the parameters that makes the image."""
        k1, k2, k3, p1, p2 = p[[*_RADIAL, *_TANGENTIAL]].tolist()
        x, y = p[list(_POINT)].tolist()
        return Projection(
            principal_distance_px=float(p[_F]),
            principal_point_px=(x, y),
            distortion=(k1, k2, p1, p2, k3),
            rms_px=self.rms_px(p),
            max_px=float(np.hypot(*self.residuals(p).T).max()),
        )


def _mean_rays(tracer: Tracer, planes_mm: tuple[float, float]) -> _Rays:
    sensor = tracer.camera.sensor
    across, down = (
        np.linspace(-0.5, size - 0.5, count) for size, count in ((sensor.width_px, _COLUMNS), (sensor.height_px, _ROWS))
    )
    x_px = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
    planes = np.repeat(parallel_planes(*planes_mm)[None], len(x_px), axis=0)
    mean = integrals(tracer, Bundles(x_px, np.full(len(x_px), NO_MICROLENS), planes), _LEVEL).moments[:, :4]
    lit = np.isfinite(mean).all(axis=1)
    # By the trapezoidal rule: positions on an edge of the image stand for half as much of it.
    area = np.where((x_px == x_px.min(axis=0)) | (x_px == x_px.max(axis=0)), 0.5, 1.0).prod(axis=1)
    return _Rays(x_px[lit], (mean[lit, :2], mean[lit, 2:]), planes_mm, float(area[lit].sum() / area.sum()))
