"""The equivalent pinhole of a camera, for programs such as OpenCV that know no lenses. Viewers of USD get
`camera.figures.first_order_figures`.

It is a least-squares fit to mean rays, whose intersection with a plane is J, so to the definition of every exact
position. The paraxial entrance pupil would do for chief rays near the axis; coma moves the mean ray away from them, by
0.18 mm along the axis in the double Gauss at F/7.7, which is 0.1 px of its image.

In OpenCV's equations with C the centre, u = (X - C_x, Y - C_y) / (Z - C_z), r = |u|:

    x = f T(u (1 + k1 r^2 + k2 r^4 + k3 r^6) + tangential(p1, p2; u)) + c

with T(tauX, tauY) the projection onto a tilted sensor. The pinhole has the axes of the vision frame. Behind pupils of
magnification m rays are m times less steep than before them, so to a pinhole a sensor tilted by theta is tilted by tau,
tan tau = tan theta / m.
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
from pipeline.frames import distorted
from pipeline.optics.first_order import first_order
from pipeline.records.shapes import Float64, Num, Shaped

STEPS = 40
"""Most steps of a fit: one that converges needs few."""
SETTLED = 1e-12
"""Convergence: change of the image by the last step over the norm of all image positions [1], thousands of
roundings."""
F, CENTRE, POINT, RADIAL, TANGENTIAL, TILT = 0, (1, 2, 3), (4, 5), (6, 7, 8), (9, 10), (11, 12)
"""Indices of the parameters: f, C, c, (k1, k2, k3), (p1, p2), (tauX, tauY) [rad]."""
PARAMETERS = 13
"""Number of parameters."""
NOTHING_LEFT_PX = 1e-6
"""Residual below which no coefficient is added [px]: a thousandth of the default accuracy of tables."""
ABSURD = 0.02
"""Largest residual over the diagonal of the image beyond which a fit is rejected [1]. Brown's model leaves 0.008 of it
for a fisheye 72 degrees off its axis; a ray from beyond 90 degrees is off by more than its distance from the middle."""
WORTH_IT = 0.9
"""Residual with a further radial coefficient over the one before, below which the coefficient is kept [1]."""
IMAGINARY = 1e-30
"""Length of a complex step, in the unit of the parameter: its square vanishes beside 1, and nothing is subtracted, so
derivatives have neither truncation error nor cancellation."""
BROWN = (*RADIAL[:2], *TANGENTIAL, RADIAL[2])
"""Indices of k1, k2, p1, p2, k3: OpenCV's order."""
_NO_MORE = (0.0,) * 7
"""k4, k5, k6, s1, s2, s3, s4 of OpenCV, zero for every pinhole here."""
_COLUMNS, _ROWS = 17, 13
"""Grid of traced image positions, corners included: 442 coordinates for eleven parameters at most."""
_LEVEL = 2
"""Level of the quadrature: means are right to 1e-8 mm."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Projection:
    """A pinhole's map from directions to the image, and its residuals against the rays of the real camera."""

    principal_distance_px: float
    principal_point_px: tuple[float, float]
    # k1, k2, p1, p2, k3 as OpenCV orders and defines them; of a tilted sensor all 14, the last two tauX and tauY
    distortion: tuple[float, ...]
    # Lengths of the residuals
    rms_px: float
    max_px: float


@dataclass(frozen=True, slots=True)
class Sightings:
    """Image positions (n, 2) and the points of the vision frame that they see, (n, 3)."""

    x_px: Float64[np.ndarray, "n 2"]
    points_mm: Num[np.ndarray, "n 3"]

    def residuals(self, p: Shaped[np.ndarray, "13"]) -> np.ndarray:
        """Image of the points in a pinhole minus their positions, (n, 2) [px]; analytic in `p`."""
        coefficients = np.concatenate([p[list(BROWN)], _NO_MORE, p[list(TILT)]])
        from_centre = self.points_mm - p[list(CENTRE)]
        x, y = distorted(coefficients, *(from_centre[:, :2] / from_centre[:, 2:]).T)
        return np.asarray(p[F] * np.stack([x, y], axis=1) + p[list(POINT)] - self.x_px)

    def slopes(self, p: Float64[np.ndarray, "13"], free: tuple[int, ...]) -> np.ndarray:
        """Jacobian of the residuals by the parameters in `free`, (2 n, free), by complex steps."""
        stepped = p + IMAGINARY * 1j * np.eye(len(p))[list(free)]
        with np.errstate(over="ignore", invalid="ignore"):  # a fit that runs away ends as NaN
            derivatives = np.array([self.residuals(row).imag.ravel() for row in stepped]) / IMAGINARY
        return derivatives.reshape(len(free), self.x_px.size).T

    def fitted(self, start: Float64[np.ndarray, "13"], free: tuple[int, ...]) -> np.ndarray:
        """Parameters at least squares over those in `free`, by Gauss-Newton steps; an exact start is kept."""
        p = start.copy()
        if self.rms_px(p) < NOTHING_LEFT_PX:
            return p
        for _ in range(STEPS):
            # Scale the parameters so that each moves the image equally.
            jacobian = self.slopes(p, free)
            with np.errstate(over="ignore", invalid="ignore"):
                scale = np.linalg.norm(jacobian, axis=0)
            if not (np.isfinite(scale).all() and scale.all()):
                return np.full_like(p, math.nan)
            step = np.linalg.lstsq(jacobian / scale, -self.residuals(p).ravel(), rcond=None)[0]
            p[list(free)] += step / scale
            if np.linalg.norm(step) < SETTLED * np.linalg.norm(self.x_px):
                break
        return p

    def with_radial(self, p: Float64[np.ndarray, "13"], free: tuple[int, ...]) -> np.ndarray:
        """Parameters fitted again with the radial coefficients that lower the residual enough."""
        for count in range(1, len(RADIAL) + 1):
            finer = self.fitted(p, (*free, *RADIAL[:count]))
            if self.rms_px(finer) < WORTH_IT * self.rms_px(p):
                p = finer
        return p

    def rms_px(self, p: Float64[np.ndarray, "13"]) -> float:
        """Root mean square of the lengths of the residuals."""
        return float(np.sqrt(np.mean(np.sum(self.residuals(p) ** 2, axis=1))))

    def projection(self, p: Float64[np.ndarray, "13"]) -> Projection:
        """The projection of these parameters, with its residuals."""
        x, y = p[list(POINT)].tolist()
        brown = p[list(BROWN)].tolist()
        tau = p[list(TILT)].tolist()
        return Projection(
            principal_distance_px=float(p[F]),
            principal_point_px=(x, y),
            distortion=(*brown, *((*_NO_MORE, *tau) if any(tau) else ())),
            rms_px=self.rms_px(p),
            max_px=float(np.hypot(*self.residuals(p).T).max()),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Pinhole:
    """One centre of projection, with and without distortion."""

    centre_mm: tuple[float, float, float]  # centre of projection, vision frame
    planes_mm: tuple[float, float]  # vision z of the planes between which it was fitted: those of J_near and J_far
    lit_share: float  # share of the image that light reaches; the rest is not fitted
    plain: Projection  # without distortion and tilt: the best one over the image
    distorted: Projection  # with distortion, whose principal distance is that on the axis


def pinhole(camera: Camera) -> Pinhole | None:
    """Fit a pinhole to the main lens and the sensor of a focused camera, without its microlenses.

    A radial coefficient, up to the third, is kept if it lowers the rms residual by a tenth; tangential ones are for
    lenses with displaced surfaces. The centre of a centred lens lies on its axis. An ideal thin lens in its stop keeps
    its own distortion. None: no pinhole fits, because the field is too wide, or because light reaches too little of the
    sensor.
    """
    if camera.near_mm is None or camera.far_mm is None:
        raise CameraError(
            "near and far plane are not settled", hint="camera.focusing.depth_of_field.focused settles them"
        )
    tracer = Tracer(dataclasses.replace(camera, microlenses=None))
    try:
        rays, lit_share = _mean_rays(tracer, (camera.near_mm, camera.far_mm))
    except CameraError:
        return None  # no chief ray from its corners
    # Choose the parameters to fit by the symmetry of the lens.
    is_centred = camera.prescription.is_centred
    free = (F, CENTRE[2]) if is_centred else (F, *CENTRE, *POINT, *TANGENTIAL)
    if any(camera.sensor.tilt_deg):
        free = (*free, *TILT)
    if len(rays.x_px) <= 2 * len(free):
        return None
    # Fit with distortion, then, at the same centre, without.
    with_distortion = rays.fitted(_paraxial(camera), free)
    if not camera.prescription.ideal:
        with_distortion = rays.with_radial(with_distortion, free)
    plain = with_distortion.copy()
    plain[[*BROWN, *TILT]] = 0.0
    if not (plain == with_distortion).all():
        plain = rays.fitted(plain, (F,) if camera.is_centred else (F, *POINT))
    # Reject fits that represent no camera.
    if not (np.isfinite([with_distortion, plain]).all() and min(with_distortion[F], plain[F]) > 0):
        return None
    if is_absurd(rays.projection(with_distortion).max_px, camera.sensor.size_px):
        return None
    x, y, z = (with_distortion[list(CENTRE)] + 0.0).tolist()
    return Pinhole(
        centre_mm=(x, y, z),
        planes_mm=(camera.near_mm, camera.far_mm),
        lit_share=lit_share,
        plain=rays.projection(plain),
        distorted=rays.projection(with_distortion),
    )


def is_absurd(residual_px: float, size_px: tuple[int, int]) -> bool:
    """Whether a fit with this largest residual represents no camera with an image of that size."""
    return not residual_px < ABSURD * math.hypot(*size_px)


def _paraxial(camera: Camera) -> np.ndarray:
    """Parameters of the pinhole at the paraxial entrance pupil, with the distortion of an ideal lens."""
    parameters = np.zeros(PARAMETERS)
    slopes = np.tan(np.radians(camera.sensor.tilt_deg))
    parameters[list(TILT)] = np.arctan(slopes / first_order(camera.prescription).pupil_magnification)
    parameters[[F, *POINT, CENTRE[2]]] = paraxial_pinhole(camera)
    if camera.prescription.ideal and camera.prescription.ideal.distortion:
        parameters[list(BROWN)] = camera.prescription.ideal.distortion
    return parameters


def paraxial_pinhole(camera: Camera) -> np.ndarray:
    """The pinhole in the paraxial entrance pupil: principal distance, principal point x and y [px], vision z [mm]."""
    lens = first_order(camera.prescription)
    principal_mm = lens.principal_distance_mm(camera.sensor_distance_mm)
    return np.array([principal_mm / camera.sensor.pitch_mm, *camera.sensor.axis_px, lens.entrance_pupil.z_mm])


def _mean_rays(tracer: Tracer, planes_mm: tuple[float, float]) -> tuple[Sightings, float]:
    """Intersections of mean rays with two planes, and the share of the image that has light."""
    size_px = tracer.camera.sensor.size_px
    across, down = (np.linspace(-0.5, n - 0.5, count) for n, count in zip(size_px, (_COLUMNS, _ROWS), strict=True))
    x_px = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
    planes = np.repeat(parallel_planes(*planes_mm)[None], len(x_px), axis=0)
    mean = integrals(tracer, Bundles(x_px, np.full(len(x_px), NO_MICROLENS), planes), _LEVEL).moments[:, :4]
    lit = np.isfinite(mean).all(axis=1)
    # By the trapezoidal rule: positions on an edge of the image have half the weight.
    area = np.where((x_px == x_px.min(axis=0)) | (x_px == x_px.max(axis=0)), 0.5, 1.0).prod(axis=1)
    crossings = np.concatenate([mean[lit, :2], mean[lit, 2:]])
    points = np.column_stack([crossings, np.repeat(planes_mm, lit.sum())])
    return Sightings(np.tile(x_px[lit], (2, 1)), points), float(area[lit].sum() / area.sum())
