"""Spot diagrams of a camera: bundles at several field positions, mapped to the image, as numbers and as a picture.

A spot is the set of intersections of a bundle with an object plane, as displacements in the image to first order: with
J(x) the mean of the intersections of position x, light that meets the plane at p reaches x - (dJ/dx)^-1 (p - J(x)).
"""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pipeline.camera.bundle import Bundle, bundle_behind
from pipeline.camera.focusing.depth_of_field import foci, middle_focus, view_of
from pipeline.camera.parts.camera import Camera
from pipeline.camera.pupil.from_stop import WIDE_RAD
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.results.notebook import figure, svg_of

Numbers = tuple[float | None, ...]

_FINE = 3
"""Decimals of numbers that are only drawn: a thousandth of a pixel."""
_FIELDS = ((0.0, "centre"), (0.5, "0.5 of the way to the corner"), (0.75, "0.75 of the way"), (1.0, "corner"))
RAYS = 256
"""Rays of a spot: enough to show its shape, few enough for a page."""
_STEP_PX = 0.05
"""Half the distance of the positions between which J is differentiated: bundles hardly change over a tenth of a
pixel.
"""
FARTHEST_MM = 1e6
"""Distance that stands for infinity: a kilometre."""
_CELL_IN, _HEAD_IN = 1.9, 0.5
"""Edge of a spot's square in the picture, and the height of the words above it [inch]."""
_LEAST_PX = 0.6
"""Least half width of a square [px]: the outline of the pixel fits into it."""
_INK, _PIXEL = "#2f7fe0", "#e8702a"
_PIXEL_PX = ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5))
"""Outline of the pixel [px]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Spot:
    """Intersections of a bundle with an object plane, as displacements of the image of their mean [px]."""

    place: str
    x_px: float
    y_px: float
    distance_mm: float
    dx_px: Numbers
    dy_px: Numbers
    rms_px: float | None


@dataclass(frozen=True, slots=True)
class FieldBundle:
    """A bundle with the name of its field position, and the bundles of two neighbours along x and two along y."""

    name: str
    x_px: float
    y_px: float
    bundle: Bundle
    around: tuple[Bundle, Bundle, Bundle, Bundle]

    def spot(self, distance_mm: float) -> np.ndarray:
        """Displacements in the image, (n, 2) [px]; NaN where the bundle is empty."""
        left, right, above, below = (neighbour.mean_at(distance_mm) for neighbour in self.around)
        slope = np.stack([right - left, below - above], axis=1) / (2 * _STEP_PX)
        miss = self.bundle.at_distance(distance_mm) - self.bundle.mean_at(distance_mm)
        if not np.isfinite(slope).all() or abs(np.linalg.det(slope)) < 1e-12:
            return np.full_like(miss, np.nan)
        return -np.linalg.solve(slope, miss.T).T


def field_bundles(camera: Camera) -> list[FieldBundle]:
    """Bundles from the centre of the image to the corner that is farthest from the axis.

    Bundles that leave farther from the axis than `WIDE_RAD` are omitted: planes across the axis do not describe them.
    """
    tracer = Tracer(camera)
    sensor = camera.sensor
    middle = (np.array(sensor.size_px) - 1) / 2
    corner = np.where(tracer.pixels_at(sensor.farthest_corner_mm[None])[0] < middle, 0.0, 2 * middle)
    bundles = []
    for share, name in _FIELDS:
        x_px, y_px, microlens = _nearest_light(tracer, middle + share * (corner - middle))
        shifts = ((0, 0), (-_STEP_PX, 0), (_STEP_PX, 0), (0, -_STEP_PX), (0, _STEP_PX))
        middle_bundle, *around = (bundle_behind(tracer, x_px + u, y_px + v, microlens, RAYS) for u, v in shifts)
        if len(middle_bundle.direction) and middle_bundle.direction[:, 2].mean() < math.cos(WIDE_RAD):
            continue
        bundles.append(FieldBundle(name, x_px, y_px, middle_bundle, (around[0], around[1], around[2], around[3])))
    return bundles


def _nearest_light(tracer: Tracer, position_px: np.ndarray) -> tuple[float, float, int]:
    """The pixel at a position and no microlens; or the middle pixel behind the nearest microlens of the middle type."""
    if tracer.lattice is None:
        x, y = np.round(position_px).tolist()
        return x, y, NO_MICROLENS
    from pipeline.camera.micro_images.centres import micro_images

    centres = tracer.pixels_at(micro_images(tracer).centre_mm)
    away = np.hypot(*(centres - position_px).T)
    away[tracer.lattice.type != _middle_type(tracer.camera)] = math.inf
    last = np.array(tracer.camera.sensor.size_px) - 1
    away[(centres < 0).any(axis=1) | (centres > last).any(axis=1)] = math.inf
    row = int(np.argmin(away))
    x, y = np.round(centres[row]).tolist()
    return x, y, row


def _middle_type(camera: Camera) -> int:
    distances = [focus.focus_distance_mm for focus in foci(camera)]
    return distances.index(middle_focus(camera))


def spots(camera: Camera, bundles: list[FieldBundle]) -> tuple[Spot, ...]:
    """Spots of every field position at the distance in focus and at both ends of the depth of field."""
    middle = min(middle_focus(camera), FARTHEST_MM)
    depth = foci(camera)[_middle_type(camera)].depth_of_field_mm
    distances = [depth[0], middle, *([depth[1]] if depth[1] < FARTHEST_MM else [])]
    return tuple(_spot(bundle, distance) for distance in distances for bundle in bundles)


def _spot(field: FieldBundle, distance_mm: float) -> Spot:
    """The spot of a field position at a distance, and its rms radius; None without light."""
    displacements = field.spot(distance_mm)
    rms = None
    if len(displacements) and np.isfinite(displacements).all():
        rms = float(np.sqrt(np.average((displacements**2).sum(axis=1), weights=field.bundle.weight_sr)))
    return Spot(
        place=field.name,
        x_px=field.x_px,
        y_px=field.y_px,
        distance_mm=distance_mm,
        dx_px=drawn(displacements[:, 0]),
        dy_px=drawn(displacements[:, 1]),
        rms_px=rms,
    )


def drawn(values: np.ndarray) -> Numbers:
    """Numbers rounded for a drawing; None where they are not finite."""
    return tuple(value if math.isfinite(value) else None for value in np.round(values, _FINE).tolist())


@dataclass(frozen=True, slots=True, kw_only=True)
class SpotDiagram:
    """Spots from the centre to the corner of the image, at the ends and in the middle of the depth of field."""

    name: str
    spots: tuple[Spot, ...] = field(repr=False)

    @property
    def rows(self) -> list[list[Spot]]:
        """The spots of each distance, from the centre to the corner."""
        distances = dict.fromkeys(spot.distance_mm for spot in self.spots)
        return [[spot for spot in self.spots if spot.distance_mm == distance] for distance in distances]

    @property
    def reach_px(self) -> float:
        """Half width of the squares in which all spots are drawn [px]."""
        parts = (value for spot in self.spots for value in (*spot.dx_px, *spot.dy_px) if value is not None)
        return 1.1 * max(_LEAST_PX, *map(abs, parts), 0.0)

    def _repr_svg_(self) -> str:
        """The picture, for a notebook; UsageError: matplotlib is not installed."""
        return svg_of(self.figure())

    def figure(self) -> Any:
        """The picture as a figure of matplotlib: a row of axes for each distance, in px, y down."""
        rows = self.rows
        reach = self.reach_px
        page = figure(_CELL_IN * len(rows[0]), (_CELL_IN + _HEAD_IN) * len(rows))
        cells = page.subplots(len(rows), len(rows[0]), squeeze=False)
        for spot, axes in zip(self.spots, cells.flat, strict=True):
            size = "no light" if spot.rms_px is None else f"{spot.rms_px:.3g} px rms"
            axes.set_title(f"{spot.place}\n{spot.distance_mm:.5g} mm: {size}", fontsize=7, loc="left")
            axes.plot(*zip(*_PIXEL_PX, strict=True), color=_PIXEL, linewidth=1)
            axes.plot(*np.array([spot.dx_px, spot.dy_px], float), ".", color=_INK, markersize=2)
            axes.set(xlim=(-reach, reach), ylim=(reach, -reach), aspect="equal", xticks=(), yticks=())
        return page


def spot_diagram(camera: Camera, name: str) -> SpotDiagram:
    """Trace the spots of a focused camera; of an unfocused plenoptic camera, those of its middle view."""
    camera = view_of(camera)
    return SpotDiagram(name=name, spots=spots(camera, field_bundles(camera)))
