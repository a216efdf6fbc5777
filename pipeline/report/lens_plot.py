"""The drawing of a camera by matplotlib: the section and the real rays of `drawing`, with axes in mm."""

from typing import Any

from pipeline.camera.parts.camera import Camera
from pipeline.camera.parts.lattice import extent_mm
from pipeline.notebook.axes import axes as new_axes
from pipeline.report.drawing import AHEAD, FIELDS, bundle, elements, profiles

_WIDTH_IN, _HEIGHT_IN = 9.0, 4.0
"""Size of the plot [inch]: the width of a notebook's page, and room for a lens half as high as long."""
_GLASS, _EDGE, _DARK, _ARRAY = "#cfe3f2", "#24506e", "#111111", "#8e44ad"


def plot(camera: Camera, title: str, axes: Any = None) -> Any:
    """Plot lens, stop, sensor and rays of three object points in focus.

    Parameters
    ----------
    axes : matplotlib Axes, optional
        The axes to draw on; by default those of a new figure.

    Returns
    -------
    Axes
        x along the axis from the stop, + towards the sensor; y upwards [mm].

    Raises
    ------
    UsageError
        matplotlib is not installed.
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
