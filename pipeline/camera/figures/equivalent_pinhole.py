"""The pinhole that stands for a camera in programs that know nothing else, as OpenCV; viewers get
`camera.figures.first_order_figures`.

It is fitted to mean rays: those whose crossings with a plane are J, so the same that define every exact position. The
paraxial entrance pupil would do for chief rays near the axis; coma pulls the mean away from them, by 0.18 mm along the
axis in the double Gauss at F/7.7, which is 0.1 px of its image.
"""

import dataclasses
from dataclasses import dataclass

import numpy as np

from pipeline.camera.figures.pinhole_fit import CENTRE, POINT, RADIAL, TANGENTIAL, F, Projection, Sightings
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Pinhole:
    """One centre of projection, with and without distortion."""

    centre_mm: tuple[float, float, float]  # centre of projection, vision frame
    planes_mm: tuple[float, float]  # vision z of the planes between which it was fitted: those of J_near and J_far
    lit_share: float  # share of the image that light reaches; the rest is not fitted
    plain: Projection  # without distortion: the best one over the image
    distorted: Projection  # with distortion, whose principal distance is that on the axis


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
        rays, lit_share = _mean_rays(tracer, (camera.near_mm, camera.far_mm))
    except CameraError:
        return None  # no chief ray from its corners
    centred = camera.prescription.is_centred
    free = (F, CENTRE[2]) if centred else (F, *CENTRE, *POINT, *TANGENTIAL)
    if len(rays.x_px) <= 2 * len(free):
        return None
    ideal = camera.prescription.ideal
    bent = _paraxial(camera) if ideal else rays.with_radial(rays.fitted(_paraxial(camera), free), free)
    bare = bent.copy()
    bare[[*RADIAL, *TANGENTIAL]] = 0.0
    plain = bare if ideal and not ideal.distortion else rays.fitted(bare, (F,) if centred else (F, *POINT))
    if not (np.isfinite(bent).all() and np.isfinite(plain).all() and bent[F] > 0):
        return None
    x, y, z = (bent[list(CENTRE)] + 0.0).tolist()
    return Pinhole(
        centre_mm=(x, y, z),
        planes_mm=(camera.near_mm, camera.far_mm),
        lit_share=lit_share,
        plain=rays.projection(plain),
        distorted=rays.projection(bent),
    )


def _paraxial(camera: Camera) -> np.ndarray:
    """Parameters of the pinhole at the paraxial entrance pupil, with the distortion that an ideal lens has."""
    parameters = np.zeros(11)
    parameters[[F, *POINT, CENTRE[2]]] = paraxial_pinhole(camera)
    if camera.prescription.ideal and camera.prescription.ideal.distortion:
        k1, k2, p1, p2, k3 = camera.prescription.ideal.distortion
        parameters[[*RADIAL, *TANGENTIAL]] = k1, k2, k3, p1, p2
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


def _mean_rays(tracer: Tracer, planes_mm: tuple[float, float]) -> tuple[Sightings, float]:
    """Mean rays where they cross two planes, and the share of the image that has light."""
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
    crossings = np.concatenate([mean[lit, :2], mean[lit, 2:]])
    places = np.column_stack([crossings, np.repeat(planes_mm, lit.sum())])
    return Sightings(np.tile(x_px[lit], (2, 1)), places), float(area[lit].sum() / area.sum())
