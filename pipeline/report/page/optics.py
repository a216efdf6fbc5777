"""The optical part of a camera on the page: drawing, figures, curves, spots, and shapes for the 3-D view."""

import math
import re
from collections.abc import Iterable
from typing import Any

import numpy as np

from pipeline.camera.figures.field_curves import FieldCurves, field_curves
from pipeline.camera.focusing.depth_of_field import middle_focus
from pipeline.camera.parts.camera import Camera
from pipeline.report import drawing, text
from pipeline.report.page.records import Chart, Figure, Figures, Line, Optics
from pipeline.report.page.shapes import ray_fans, surface_shapes
from pipeline.report.page.spots import field_bundles, field_curvature, spots, transfer
from pipeline.report.page.tables import drawn

_REMARK = re.compile(r"^(.*?)(?:  \((.*)\))?$")
"""Value and remark of a row of `pipeline show`."""
_CURVES = "real rays"
"""Beginning of the heading of the field curves, which the page draws."""
_ROWS = 21
"""Heights of the field curves: a smooth line on a page."""


def optics(camera: Camera, name: str, record: dict[str, Any]) -> Optics:
    """All of it, traced now.

    Parameters
    ----------
    camera : Camera
        The focused camera, of a channel in its light.
    record : dict
        Content of camera.json.
    """
    curves = field_curves(camera, middle_focus(camera), _ROWS)
    bundles, sensor, shown = field_bundles(camera), camera.sensor, _with_infinities(record)
    return Optics(
        drawing=drawing.svg(camera, f"{name}: {record['lens']['name']}"),
        figures=(*_figures(text.page(name, shown, curves)), *_types(shown)),
        charts=(_distortion(curves), _illumination(curves), field_curvature(camera), transfer(camera, bundles)),
        spots=spots(camera, bundles),
        surfaces=surface_shapes(camera.prescription),
        sensor_z_mm=-camera.sensor_distance_mm,
        sensor_mm=sensor.size_mm,
        sensor_offset_mm=(sensor.offset_x_mm, sensor.offset_y_mm),
        fans=ray_fans(camera),
    )


def _with_infinities(value: Any) -> Any:
    """A record of a JSON file with infinities as numbers, which are words there."""
    if isinstance(value, dict):
        return {name: _with_infinities(one) for name, one in value.items()}
    if isinstance(value, list):
        return [_with_infinities(one) for one in value]
    return float(value) if value in ("inf", "-inf") else value


def _figures(lines: Iterable[str]) -> Iterable[Figures]:
    """The page of `pipeline show`, cut into rows: it alone chooses and rounds what people read. Its tables are left
    out.
    """
    heading, rows = "", list[Figure]()
    for line in [*lines, ""]:
        if heading and line.startswith("  "):
            value, remark = _REMARK.fullmatch(line[2 + text.WIDTH :]).groups()  # type: ignore[union-attr]
            rows.append(Figure(name=line[2 : 2 + text.WIDTH].strip(), value=value, remark=remark or ""))
            continue
        if rows:
            yield Figures(heading=heading, rows=tuple(rows))
        heading, rows = "" if line.startswith((" ", _CURVES)) else line, []


def _types(record: dict[str, Any]) -> Iterable[Figures]:
    """The types of microlenses, where there are some."""
    rows = []
    for number, kind in enumerate(record.get("mla", {}).get("types", ())):
        near, far = kind["depth_of_field_mm"]
        remark = f"in focus at {kind['focus_distance_mm']:.1f} mm, sharp from {near:.1f} to {far:.1f} mm"
        rows.append(Figure(name=f"type {number}", value=f"f = {kind['focal_length_mm']:.6g} mm", remark=remark))
    if rows:
        yield Figures(heading="types of microlenses", rows=tuple(rows))


def _distortion(curves: FieldCurves) -> Chart:
    place = "infinity" if math.isinf(curves.object_mm) else f"{curves.object_mm:.1f} mm"
    return _over_height(
        "Distortion", f"of chief rays, for objects at {place}", "distortion [%]", curves, 100 * curves.distortion
    )


def _illumination(curves: FieldCurves) -> Chart:
    remark = "weight of the bundle over that on the axis: vignetting, cosine and pupil"
    return _over_height("Relative illumination", remark, "share", curves, curves.relative_illumination)


def _over_height(title: str, remark: str, y_name: str, curves: FieldCurves, y: np.ndarray) -> Chart:
    lines = (Line(name=title.lower(), y=tuple(value if math.isfinite(value) else None for value in y.tolist())),)
    x = drawn(curves.height_mm)
    return Chart(title=title, remark=remark, x_name="height on the sensor [mm]", y_name=y_name, x=x, lines=lines)
