"""Photons per pixel from the radiance of the scene, and the transmission of a lens.

The radiance L of a scene that fills the aperture gives a pixel of area A the power L A W T: W is the integral of
cos(theta) d omega over the bundle, the projected solid angle of the traced pupil (with the acceptance of pixels), and T
the share of its light that surfaces and glass of the main lens transmit. Each photon has the energy h c / wavelength. A
channel is the weighted sum of W T over its wavelengths.

Over the image, T is the mean over the rays that leave the camera from a pixel, each weighted as images weigh it. It is
smooth over the field, so that it is traced at a few nodes, with cubic splines between them. Nodes lie at heights above
the axis where the lens is symmetric about it, and in a grid over the sensor otherwise.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pipeline.camera.bundle import Bundle, bundle, bundle_behind
from pipeline.camera.parts.camera import Camera
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.optics.table import EDGES, towards_sensor
from pipeline.optics.transmission import Losses, transmitted
from pipeline.records.declared import settle
from pipeline.records.shapes import Float64
from pipeline.render.sensor.response import Radiance, SensorError

RAYS = 4096
"""Rays of a bundle whose mean transmission is taken: it varies by percents over a pupil, and they err by 1e-5."""
_FIRST_NODES, _MOST_NODES = 5, (65, 33)
"""Initial nodes along an axis, and the most along one axis and two: steps are halved until splines are right."""
_ERROR = 1e-4
"""Relative error of a spline at new nodes below which the spline through those, too, is right."""
_BISECTIONS = 12
"""Bisections for the height at which light ends: below a pixel on any sensor."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldTransmission:
    """Transmission of the lens of a conventional camera over the image."""

    # share of light that passes on the axis, and its image position x, y
    axis: float
    axis_px: tuple[float, float]
    # places of nodes, ascending: heights above the axis alone, or rows and columns [px]
    places: tuple[tuple[float, ...], ...]
    shares: tuple[tuple[float, ...], ...]  # share that passes there, in rows: a single one where places are heights
    error: float  # largest relative error of the next coarser spline at nodes new to it: that of this one is smaller

    def __post_init__(self) -> None:
        settle(self, SensorError)

    def relative_rows(self, first: int, end: int, width: int) -> np.ndarray:
        """Transmission of the pixels of some rows over that of the axis, (end - first, width)."""
        columns = np.arange(width, dtype=float)
        rows = np.arange(first, end, dtype=float)
        nodes = tuple(np.array(axis_nodes) for axis_nodes in self.places)
        shares = np.array(self.shares)
        if len(nodes) == 2:
            transmission = _between(nodes, shares, (rows, columns))
        else:
            heights_px = np.hypot(columns - self.axis_px[0], rows[:, None] - self.axis_px[1])
            inside = np.minimum(heights_px, nodes[0][-1]).ravel()
            transmission = _between(nodes, shares[0], (inside,)).reshape(heights_px.shape)
        return np.asarray(np.clip(transmission, 0.0, 1.0) / self.axis)


def field_transmission(camera: Camera, losses_of_each: tuple[Losses | None, ...]) -> FieldTransmission | None:
    """Transmission of a lens over the image, by the losses at each wavelength of the light.

    None where the value on the axis holds everywhere, because the lens is lossless, or where it is unavailable: behind
    microlenses. Nodes lie along heights if lens and stop are symmetric about the axis, else in a grid.
    """
    if camera.microlenses is not None or not any(losses_of_each):
        return None
    # As on the axis: the same random numbers for all wavelengths, whose errors then go together.
    lights = zip(Tracer(camera).lights, losses_of_each, strict=True)
    parts = [(light.share, Tracer(light.tracer.camera), losses) for light, losses in lights]
    tracer = parts[0][1]
    table = towards_sensor(parts[0][1].camera.prescription)

    axis_px = tracer.pixels_at(np.zeros((1, 2)))[0]
    drawn_at = round(axis_px[0]), round(axis_px[1])

    @functools.cache  # finer nodes are the coarser ones and those between
    def share(x_px: float, y_px: float) -> float:
        """The mean over all wavelengths, by their signals; NaN where there is no light."""
        total = passed = 0.0
        for signal_share, tracer, losses in parts:
            rays = bundle_behind(tracer, float(x_px), float(y_px), NO_MICROLENS, RAYS, drawn_at)
            weight = signal_share * float(rays.weight_sr.sum())
            if weight > 0:
                total = total + weight
                passed = passed + weight * _passed(rays, tracer, losses)
        return passed / total if total > 0 else np.nan

    if camera.is_centred and not table[:, EDGES].any():
        nodes = _along_heights(tracer, axis_px, share)
    else:
        ends = camera.sensor.height_px - 1.0, camera.sensor.width_px - 1.0
        places = tuple(np.linspace(0.0, max(end, 1.0), _FIRST_NODES) for end in ends)
        nodes = _refined(places, lambda grid: np.array([[share(x_px, y_px) for x_px in grid[1]] for y_px in grid[0]]))
    return FieldTransmission(
        axis=share(*axis_px),
        axis_px=(axis_px[0], axis_px[1]),
        places=tuple(tuple(axis_nodes) for axis_nodes in nodes.places),
        shares=tuple(tuple(row) for row in np.atleast_2d(nodes.shares)),
        error=nodes.error,
    )


def _passed(rays: Bundle, tracer: Tracer, losses: Losses | None) -> float:
    """Share of the light of a bundle that surfaces and glass transmit."""
    if losses is None:
        return 1.0
    # Light comes the other way: from the vision frame to the lens frame, whose y and z point against it.
    start = rays.origin_mm * [1.0, -1.0, -1.0]
    direction = rays.direction * [-1.0, 1.0, 1.0]
    passed = transmitted(towards_sensor(tracer.camera.prescription), start - direction, direction, losses)
    return float(np.average(passed, weights=rays.weight_sr))


def axial_transmission(tracer: Tracer, losses: Losses | None) -> float:
    """Share of the light of the reference bundle that surfaces and glass of the main lens transmit."""
    if losses is None:
        return 1.0
    x_px, y_px = tracer.pixels_at(tracer.reference[0])[0]
    return _passed(bundle(tracer.camera, float(x_px), float(y_px), samples=RAYS), tracer, losses)


def photon_rate(camera: Camera, radiance: Radiance) -> float:
    """Photons that hit a pixel in a second where the linear image is 1: on the axis, before a white scene [1/s].

    Behind a medium of index n radiance is n^2 times smaller, as its light fills a wider cone (basic radiance L / n^2 is
    conserved). Behind microlenses the pixel is that on the axis of microlens (0, 0). Photons of a channel count by its
    relative response: pass the camera of that channel.

    Raises SensorError: rays of the camera weigh area, so that its images are not irradiance.
    """
    if camera.weight != "irradiance":
        raise SensorError("radiance gives photons only where rays weigh irradiance, not area")
    area_m2 = (camera.sensor.pitch_mm * 1e-3) ** 2
    rate = 0.0
    for light, losses in zip(Tracer(camera).lights, radiance.losses, strict=True):
        weight_sr = light.tracer.reference_weight_sr
        transmission = axial_transmission(light.tracer, losses)
        radiance_factor = transmission / light.tracer.camera.prescription.index_in_front**2
        rate += light.share * radiance.photons(radiance.w_per_m2_sr * area_m2 * weight_sr * radiance_factor)
    return rate


class _Nodes(NamedTuple):
    """Positions of nodes along one axis or two, shares of light there, and the error of the coarser spline."""

    places: tuple[np.ndarray, ...]
    shares: np.ndarray
    error: float


def _along_heights(tracer: Tracer, axis_px: np.ndarray, share: Callable[[float, float], float]) -> _Nodes:
    """Nodes at heights from the axis to the farthest corner, or to where light ends."""
    corner_px = tracer.pixels_at(tracer.camera.sensor.farthest_corner_mm[None])[0] - axis_px
    farthest_px = float(np.hypot(*corner_px))

    def at(height_px: float) -> float:
        return share(*(axis_px + height_px / farthest_px * corner_px))

    # If the corner is dark, light ends between the axis and the corner: bisect for the height of its end.
    lit = dark = farthest_px
    if np.isnan(at(dark)):
        lit = 0.0
        for _ in range(_BISECTIONS):
            middle = (lit + dark) / 2
            if np.isnan(at(middle)):
                dark = middle
            else:
                lit = middle
    return _refined((np.linspace(0.0, lit, _FIRST_NODES),), lambda nodes: np.array([at(px) for px in nodes[0]]))


def _refined(
    places: tuple[np.ndarray, ...], shares_at: Callable[[tuple[np.ndarray, ...]], Float64[np.ndarray, "..."]]
) -> _Nodes:
    """Nodes whose steps are halved until the spline through the coarser ones is right at the finer ones."""
    shares = shares_at(places)
    while True:
        finer = tuple(np.linspace(nodes[0], nodes[-1], 2 * len(nodes) - 1) for nodes in places)
        coarse = _between(places, _filled(shares), finer)
        places = finer
        shares = shares_at(finer)
        error = float(np.nanmax(np.abs(coarse / shares - 1)))
        if error <= _ERROR or len(places[0]) >= _MOST_NODES[len(places) - 1]:
            return _Nodes(places, _filled(shares), error)


def _filled(shares: np.ndarray) -> np.ndarray:
    """The shares, with those of dark nodes replaced by that of the nearest lit one."""
    from scipy.ndimage import distance_transform_edt

    dark = np.isnan(shares)
    if not dark.any():
        return shares
    return np.asarray(shares[tuple(distance_transform_edt(dark, return_distances=False, return_indices=True))])


def _between(nodes: tuple[np.ndarray, ...], shares: np.ndarray, positions: tuple[np.ndarray, ...]) -> np.ndarray:
    """Cubic splines through the shares at nodes, along one axis after the other, at the tensor product of positions."""
    from scipy.interpolate import CubicSpline

    # By height they are even: no slope on the axis.
    start = (1, np.zeros(())) if len(nodes) == 1 else "not-a-knot"
    for axis, (coarse, fine) in enumerate(zip(nodes, positions, strict=True)):
        shares = CubicSpline(coarse, shares, axis=axis, bc_type=(start, "not-a-knot"))(fine)
    return shares
