"""A camera in a notebook: its section and real rays by matplotlib, with axes in mm, and a card with its key figures."""

import math
from typing import Any

from pipeline.camera.focusing.depth_of_field import middle_focus
from pipeline.camera.parts.camera import Camera
from pipeline.camera.parts.lattice import extent_mm
from pipeline.optics.first_order import first_order
from pipeline.results import drawing
from pipeline.results.drawing import AHEAD, FIELDS, bundle, elements, profiles
from pipeline.results.notebook import axes as new_axes
from pipeline.results.notebook import html_table

_WIDTH_IN, _HEIGHT_IN = 9.0, 4.0
"""Size of the plot [inch]: the width of a notebook's page, and room for a lens half as high as long."""
_GLASS, _EDGE, _DARK, _ARRAY = "#cfe3f2", "#24506e", "#111111", "#8e44ad"


def plot(camera: Camera, title: str, axes: Any = None) -> Any:
    """Plot lens, stop, sensor and rays of three object points in focus.

    `axes`: the axes to draw on; by default those of a new figure.
    Returns Axes: x along the axis from the stop, + towards the sensor; y upwards [mm].
    Raises UsageError: matplotlib is not installed.
    """
    sheet = new_axes(_WIDTH_IN, _HEIGHT_IN) if axes is None else axes
    lens, end = camera.prescription, camera.sensor_distance_mm
    left = lens.vertices_from_stop_mm[0] - AHEAD * (end - lens.vertices_from_stop_mm[0])
    for outline in elements(lens):
        sheet.fill(*zip(*outline, strict=True), facecolor=_GLASS, edgecolor=_EDGE, linewidth=0.6)
    for surface, profile in zip(lens.surfaces, profiles(lens), strict=True):
        if not surface.is_stop:
            sheet.plot(*zip(*profile, strict=True), color=_EDGE, linewidth=1.2)
    for place, colour in FIELDS:
        for ray in bundle(camera, place, left):
            sheet.plot(*zip(*ray, strict=True), color=colour, linewidth=0.6)
    rim = 1.05 * max(surface.semi_diameter_mm for surface in lens.surfaces)
    edge = lens.stop.semi_diameter_mm
    for side in (-1, 1):
        sheet.plot([0, 0], [side * edge, side * max(rim, 1.3 * edge)], color=_DARK, linewidth=2.5)
    half, middle = camera.sensor.size_mm[1] / 2, -camera.sensor.offset_y_mm
    sheet.plot([end, end], [middle - half, middle + half], color=_DARK, linewidth=2.5)
    if camera.microlenses is not None:
        film, reach = end - camera.microlenses.distance_mm, extent_mm(camera.microlenses)[1] / 2
        centre = middle + camera.microlenses.offset_y_mm
        sheet.plot([film, film], [centre - reach, centre + reach], color=_ARRAY, linewidth=1.2, linestyle=":")
    sheet.set(aspect="equal", xlabel="along the axis, from the stop [mm]", ylabel="height [mm]", title=title)
    return sheet


def card(camera: Camera, name: str) -> str:
    """HTML of a focused camera."""
    lens, sensor, focus_mm = first_order(camera.prescription), camera.sensor, middle_focus(camera)
    array = camera.microlenses
    rows = [
        ("focal length", f"{lens.efl_mm:.4g} mm"),
        ("entrance pupil", f"{lens.entrance_pupil.diameter_mm:.4g} mm wide"),
        ("in focus", "infinity" if math.isinf(focus_mm) else f"{focus_mm:.5g} mm before the stop"),
        ("sensor", f"{sensor.width_px} x {sensor.height_px} px of {1000 * sensor.pitch_mm:g} µm"),
    ]
    if array is not None:
        kinds = ", ".join(f"{length:.4g}" for length in array.focal_lengths_mm)
        rows.append(("microlenses", f"{array.pitch_mm:.4g} mm apart, f = {kinds} mm"))
    return html_table(("camera", name), rows) + drawing.svg(camera, name)
