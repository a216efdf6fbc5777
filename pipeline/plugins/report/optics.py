"""The optical part of a camera on the page: drawing, figures, curves, spots, and shapes for the 3-D view."""

import dataclasses
import math
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from pipeline.app.pages import text
from pipeline.app.pages.text import Figure, Figures
from pipeline.camera.bundle import Bundle, bundle_behind
from pipeline.camera.figures.field_curves import FieldCurves, field_curves
from pipeline.camera.focusing.depth_of_field import middle_focus, view_of
from pipeline.camera.parts.camera import Camera
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.files.jsonfile import Json
from pipeline.plugins.report.records import Chart, Line, Optics
from pipeline.plugins.report.shapes import matrix, ray_fans, sensor_corners_mm, surface_shapes
from pipeline.results import drawing
from pipeline.results.spots import FARTHEST_MM, RAYS, FieldBundle, drawn, field_bundles, spots

_ROWS = 21
"""Heights of the field curves: a smooth line on a page."""
_NYQUIST, _FREQUENCIES = 0.5, 26
"""Highest frequency of the MTF, that of Nyquist [cycles/px], and the number of frequencies."""
_HEIGHTS = 9
"""Heights of the curve of field curvature."""


def optics(camera: Camera, name: str, record: Json) -> Optics:
    """Drawing, figures and curves of a focused camera in the light of its channel, traced now; `record` is
    camera.json.
    """
    curves = field_curves(camera, middle_focus(camera), _ROWS)
    view = view_of(camera)
    values = _with_infinities(record)
    bundles = field_bundles(view)
    return Optics(
        drawing=drawing.svg(camera, f"{name}: {record['lens']['name']}"),
        figures=(*text.figures(values, curves), *_types(values)),
        charts=(*_over_height(curves), field_curvature(camera), transfer(view, bundles)),
        spots=spots(view, bundles),
        surfaces=surface_shapes(camera.prescription),
        sensor_mm=matrix(sensor_corners_mm(camera)),
        fans=ray_fans(camera),
    )


def _with_infinities(value: Any) -> Any:
    """A record of a JSON file with its infinities, there words, as numbers."""
    if isinstance(value, dict):
        return {name: _with_infinities(item) for name, item in value.items()}
    if isinstance(value, list):
        return [_with_infinities(item) for item in value]
    return float(value) if value in ("inf", "-inf") else value


def _types(record: Json) -> Iterable[Figures]:
    rows = []
    for number, kind in enumerate(record.get("mla", {}).get("types", ())):
        near, far = kind["depth_of_field_mm"]
        remark = f"in focus at {kind['focus_distance_mm']:.1f} mm, sharp from {near:.1f} to {far:.1f} mm"
        rows.append(Figure(name=f"type {number}", value=f"f = {kind['focal_length_mm']:.6g} mm", remark=remark))
    if rows:
        yield Figures(heading="types of microlenses", rows=tuple(rows))


def _over_height(curves: FieldCurves) -> Iterator[Chart]:
    distance = "infinity" if math.isinf(curves.object_mm) else f"{curves.object_mm:.1f} mm"
    light = "weight of the bundle over that on the axis: vignetting, cosine and pupil"
    for title, remark, y_name, y in (
        ("Distortion", f"of chief rays, for objects at {distance}", "distortion [%]", 100 * curves.distortion),
        ("Relative illumination", light, "share", curves.relative_illumination),
    ):
        lines = (Line(name=title.lower(), y=tuple(value if math.isfinite(value) else None for value in y.tolist())),)
        x = drawn(curves.height_mm)
        yield Chart(title=title, remark=remark, x_name="height on the sensor [mm]", y_name=y_name, x=x, lines=lines)


def transfer(camera: Camera, bundles: list[FieldBundle]) -> Chart:
    """Geometric MTF of the spots in focus, |sum w exp(2 pi i f x)| / sum w, along x and y of the image."""
    frequency = np.linspace(0.0, _NYQUIST, _FREQUENCIES)
    distance = min(middle_focus(camera), FARTHEST_MM)
    lines = []
    for field in bundles:
        positions = field.spot(distance)
        weight = field.bundle.weight_sr
        for axis, name in enumerate("xy"):
            phases = np.exp(2j * np.pi * np.outer(frequency, positions[:, axis]))
            contrast = np.abs(phases @ weight) / weight.sum() if weight.any() else np.full(len(frequency), np.nan)
            lines.append(Line(name=f"{field.name}, {name}", y=drawn(contrast), is_dashed=axis == 1))
    remark = "of the rays of one position in focus: without diffraction and without the pixel's own size"
    return Chart(
        title="Geometric MTF",
        remark=remark,
        x_name="frequency [cycles/px]",
        y_name="contrast",
        x=drawn(frequency),
        lines=tuple(lines),
        y_range=(0.0, 1.0),
    )


def field_curvature(camera: Camera) -> Chart:
    """Distances at which bundles of the main lens are narrowest, sagittally and tangentially."""
    tracer = Tracer(dataclasses.replace(camera, microlenses=None))
    sensor = camera.sensor
    reach_mm = float(np.hypot(*sensor.farthest_corner_mm))
    heights = np.linspace(0.0, reach_mm, _HEIGHTS)
    positions = tracer.pixels_at(np.column_stack([heights, np.zeros(_HEIGHTS)]))
    bundles = [bundle_behind(tracer, x, y, NO_MICROLENS, 4 * RAYS) for x, y in positions.tolist()]
    names = ("tangential: along the radius", "sagittal: across it")
    lines = tuple(
        Line(name=name, y=drawn(np.array([_thinnest_mm(bundle, axis) for bundle in bundles])), is_dashed=axis == 1)
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
    """Vision z of the least variance of the intersections along an axis: -cov(a, s) / var(s) of the lines a + s z."""
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
    return distance if 0 < distance < FARTHEST_MM else math.nan
