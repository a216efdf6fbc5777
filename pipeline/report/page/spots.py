"""Bundles of some field positions, seen in the image: spots, geometric MTF, and where along the axis they are thinnest.

A spot is the crossings of a bundle with an object plane, as displacements in the image to first order: with J(x) the
mean of the crossings of position x, light that crosses at p reaches x - (dJ/dx)^-1 (p - J(x)).
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from pipeline.camera.bundle import Bundle, bundle_behind
from pipeline.camera.focusing.depth_of_field import foci, middle_focus
from pipeline.camera.parts.camera import Camera
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.report.page.records import Chart, Line, Spot
from pipeline.report.page.tables import drawn

_FIELDS = ((0.0, "centre"), (0.5, "0.5 of the way to the corner"), (0.75, "0.75 of the way"), (1.0, "corner"))
_RAYS = 256
"""Rays of a spot: enough to show its shape, few enough for a page."""
_STEP_PX = 0.05
"""Half the distance of positions between which J is differentiated: bundles hardly change over a tenth of a pixel."""
_FARTHEST_MM = 1e6
"""Distance that stands for infinity: a kilometre."""
_NYQUIST, _FREQUENCIES = 0.5, 26
"""Highest frequency of the MTF [cycles/px], which pixels can still tell apart, and how many there are."""
_HEIGHTS = 9
"""Heights of the curve of field curvature."""


@dataclass(frozen=True, slots=True)
class FieldBundle:
    """A bundle with the place of its position, and those of two neighbours along x and two along y."""

    place: str
    x_px: float
    y_px: float
    bundle: Bundle
    around: tuple[Bundle, Bundle, Bundle, Bundle]

    def spot(self, distance_mm: float) -> np.ndarray:
        """Displacements in the image, (n, 2) [px]; NaN where the bundle is empty."""
        left, right, above, below = (one.mean_at(distance_mm) for one in self.around)
        slope = np.stack([right - left, below - above], axis=1) / (2 * _STEP_PX)
        miss = self.bundle.at_distance(distance_mm) - self.bundle.mean_at(distance_mm)
        if not np.isfinite(slope).all() or abs(np.linalg.det(slope)) < 1e-12:
            return np.full_like(miss, np.nan)
        return -np.linalg.solve(slope, miss.T).T


def field_bundles(camera: Camera) -> list[FieldBundle]:
    """Bundles from the centre of the image to the corner that is farthest from the axis."""
    tracer, sensor = Tracer(camera), camera.sensor
    middle = np.array([sensor.width_px - 1, sensor.height_px - 1]) / 2
    corner = np.where(tracer.pixels_at(sensor.farthest_corner_mm[None])[0] < middle, 0.0, 2 * middle)
    found = []
    for share, place in _FIELDS:
        x_px, y_px, microlens = _nearest_light(tracer, middle + share * (corner - middle))
        shifts = ((0, 0), (-_STEP_PX, 0), (_STEP_PX, 0), (0, -_STEP_PX), (0, _STEP_PX))
        own, *around = (bundle_behind(tracer, x_px + u, y_px + v, microlens, _RAYS) for u, v in shifts)
        found.append(FieldBundle(place, x_px, y_px, own, (around[0], around[1], around[2], around[3])))
    return found


def _nearest_light(tracer: Tracer, position_px: np.ndarray) -> tuple[float, float, int]:
    """The pixel at a position and no microlens; or the middle pixel behind the nearest microlens of the middle type."""
    if tracer.lattice is None:
        x, y = np.round(position_px).tolist()
        return x, y, NO_MICROLENS
    from pipeline.camera.micro_images.centres import micro_images

    centres = tracer.pixels_at(micro_images(tracer).centre_mm)
    away = np.hypot(*(centres - position_px).T)
    away[tracer.lattice.type != _middle_type(tracer.camera)] = math.inf
    size = np.array([tracer.camera.sensor.width_px, tracer.camera.sensor.height_px])
    away[(centres < 0).any(axis=1) | (centres > size - 1).any(axis=1)] = math.inf
    row = int(np.argmin(away))
    x, y = np.round(centres[row]).tolist()
    return x, y, row


def _middle_type(camera: Camera) -> int:
    distances = [focus.focus_distance_mm for focus in foci(camera)]
    return distances.index(middle_focus(camera))


def spots(camera: Camera, bundles: list[FieldBundle]) -> tuple[Spot, ...]:
    """Spots of every place at the distance in focus and at both ends of the depth of field."""
    middle = min(middle_focus(camera), _FARTHEST_MM)
    depth = foci(camera)[_middle_type(camera)].depth_of_field_mm
    distances = [depth[0], middle, *([depth[1]] if depth[1] < _FARTHEST_MM else [])]
    return tuple(_spot(one, distance) for distance in distances for one in bundles)


def _spot(field: FieldBundle, distance_mm: float) -> Spot:
    shown = field.spot(distance_mm)
    rms = None
    if len(shown) and np.isfinite(shown).all():
        rms = float(np.sqrt(np.average((shown**2).sum(axis=1), weights=field.bundle.weight_sr)))
    return Spot(
        place=field.place,
        x_px=field.x_px,
        y_px=field.y_px,
        distance_mm=distance_mm,
        dx_px=drawn(shown[:, 0]),
        dy_px=drawn(shown[:, 1]),
        rms_px=rms,
    )


def transfer(camera: Camera, bundles: list[FieldBundle]) -> Chart:
    """Geometric MTF of the spots in focus, along x and y of the image."""
    frequency = np.linspace(0.0, _NYQUIST, _FREQUENCIES)
    distance = min(middle_focus(camera), _FARTHEST_MM)
    lines = []
    for field in bundles:
        shown, weight = field.spot(distance), field.bundle.weight_sr
        for axis, name in enumerate("xy"):
            waves = (
                np.exp(2j * np.pi * np.outer(frequency, shown[:, axis])) if weight.any() else np.full((26, 1), np.nan)
            )
            contrast = np.abs(waves @ weight) / weight.sum() if weight.any() else np.full(len(frequency), np.nan)
            lines.append(Line(name=f"{field.place}, {name}", y=drawn(contrast), is_dashed=axis == 1))
    remark = "of the rays of one position in focus: without diffraction and without the pixel's own size"
    return Chart(
        title="Geometric MTF",
        remark=remark,
        x_name="frequency [cycles/px]",
        y_name="contrast",
        x=drawn(frequency),
        lines=tuple(lines),
    )


def field_curvature(camera: Camera) -> Chart:
    """Distances at which bundles of the main lens are thinnest, along and across the radius of the image."""
    tracer, sensor = Tracer(replace(camera, microlenses=None)), camera.sensor
    reach_mm = float(np.hypot(*sensor.farthest_corner_mm))
    heights = np.linspace(0.0, reach_mm, _HEIGHTS)
    positions = tracer.pixels_at(np.column_stack([heights, np.zeros(_HEIGHTS)]))
    found = [bundle_behind(tracer, x, y, NO_MICROLENS, 4 * _RAYS) for x, y in positions.tolist()]
    names = ("tangential: along the radius", "sagittal: across it")
    lines = tuple(
        Line(name=name, y=drawn(np.array([_thinnest_mm(one, axis) for one in found])), is_dashed=axis == 1)
        for axis, name in enumerate(names)
    )
    return Chart(
        title="Field curvature",
        remark="where the bundle of a height on the sensor is thinnest in the scene; main lens, without microlenses",
        x_name="height on the sensor [mm]",
        y_name="distance from the stop [mm]",
        x=drawn(heights),
        lines=lines,
    )


def _thinnest_mm(bundle: Bundle, axis: int) -> float:
    """Vision z of the least variance of the crossings along an axis: -cov(a, s) / var(s) of the lines a + s z."""
    weight = bundle.weight_sr
    if np.count_nonzero(weight) < 2:
        return math.nan
    slope = bundle.direction[:, axis] / bundle.direction[:, 2]
    start = bundle.origin_mm[:, axis] - slope * bundle.origin_mm[:, 2]
    steepness = slope - np.average(slope, weights=weight)
    variance = float(np.average(steepness**2, weights=weight))
    if variance == 0:
        return math.nan
    distance = -float(np.average(start * steepness, weights=weight)) / variance
    return distance if 0 < distance < _FARTHEST_MM else math.nan
