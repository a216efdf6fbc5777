"""Drawing of a camera in its vertical plane, as SVG: lens, stop, sensor, and rays clipped as the tracer clips them.

Rays start at object points in focus (for the middle microlens type) whose images lie at the centre of the sensor, at
its upper or lower edge, whichever is farther from the axis, and at 0.7 of that distance; where the edge is dark, near
the rim of the image circle instead. Real rays from the sensor back to the scene locate their bundles. Lengths in mm
from the stop, + towards the sensor, as light travels; the drawing is to scale.
"""

import dataclasses
import math

import numpy as np

from pipeline.camera.figures.first_order_figures import focus_plane_tilt_deg
from pipeline.camera.focusing.depth_of_field import middle_focus
from pipeline.camera.parts.camera import Camera
from pipeline.camera.parts.lattice import Lattice, cell, extent_mm, lattice
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.camera.pupil.outlines import lit_share
from pipeline.files import svg as svg_file
from pipeline.optics.first_order import first_order
from pipeline.optics.kernels import trace, trace_path
from pipeline.optics.prescription import Prescription
from pipeline.optics.rays import directions_to
from pipeline.optics.sections import elements, profiles
from pipeline.optics.table import SEMI_DIAMETER_SQUARED, towards_scene, towards_sensor

FIELDS = ((0.0, "#c0392b"), (0.7, "#27803d"), (1.0, "#1f5fa8"))
"""Sensor heights of the bundles, 0 at the centre and 1 at the farther edge, and their colours."""
_RIM = 0.99
"""Share of the image circle at which its outermost bundle is drawn: at the rim itself the bundle has no width."""
_WIDEST_RAD = math.radians(60)
"""Half field within which the image circle of a bare lens is sought, as if the lens had no distortion."""
_RAYS = 7
"""Rays of a bundle in the drawing of the whole camera: odd, so that one is in the middle; more would fill the lens."""
_FAN = 2001
"""Rays tried across the lens to find those that pass: finer than the pixels of the drawing, odd for the middle."""
AHEAD = 0.35
"""Length drawn before the lens over the length from the first vertex to the sensor."""
_WIDTH_PX, _MARGIN_PX = 1200, 40
"""Width of the drawing and its blank edge [px]: a page of a browser, and room for the words at the edge."""
_INSET_PX, _INSET_RAYS, _INSET_LENSES = 320, 81, 3.4
"""Enlarged microlenses: height of the picture, rays, and how many MLA pitches it shows."""

_GLASS, _EDGE, _DARK, _ARRAY = "#cfe3f2", "#24506e", "#111111", "#8e44ad"

Points = list[svg_file.Point]


def svg(camera: Camera, title: str, film: str = "sensor") -> str:
    """The drawing as the text of an SVG file; `film` is the label of its last plane."""
    first = camera.prescription.vertices_from_stop_mm[0]
    left = first - AHEAD * (camera.sensor_distance_mm - first)
    half = _half_height(camera)
    right = max(x for ends in _films(camera) for x, _ in ends) + 4
    scale = (_WIDTH_PX - 2 * _MARGIN_PX) / (right - left)
    height = 2 * half * scale + 3 * _MARGIN_PX
    sheet = _Sheet(left, scale, _MARGIN_PX + half * scale + _MARGIN_PX / 2)
    sheet.line([(left, 0.0), (right, 0.0)], "#888888", 0.6, dashes="8 3 2 3")
    for points in elements(camera.prescription):
        sheet.area(points, _GLASS)
    for field, colour in FIELDS:
        for ray in bundle(camera, field, left):
            sheet.line(ray, colour, 0.7)
    for surface, profile in zip(camera.prescription.surfaces, profiles(camera.prescription), strict=True):
        if not surface.is_stop:
            sheet.line(profile, _EDGE, 1.2)
    _draw_stop(sheet, camera.prescription, half)
    _draw_film(sheet, camera, film)
    _draw_scale(sheet, left, camera.sensor_distance_mm, half)
    sheet.words((_MARGIN_PX, 22), f"{title}; rays from objects at {focus_in_words(camera)}", 14, "start")
    if camera.microlenses is None:
        return sheet.text(height)
    before = f"{camera.microlenses.distance_mm:g} mm before the sensor"
    words = f"microlenses at the centre of the sensor, {before}; more rays of the point there"
    sheet.words((_MARGIN_PX, height + 20), words, 11, "start")
    sheet.items.append(_inset(camera, camera.microlenses, left, height + 28))
    return sheet.text(height + _INSET_PX + 28 + _MARGIN_PX)


def with_full_field(camera: Camera) -> Camera:
    """The camera with a sensor as high as its image circle; unchanged if light arrives even beyond 60 degrees."""
    focal = first_order(camera.prescription).efl_mm
    farthest = math.tan(_WIDEST_RAD) * focal
    ends = (np.array([0.0, -height, -camera.sensor_distance_mm]) for height in (0.0, farthest))
    share = lit_share(*_rear(camera), *camera.in_vision(np.array(list(ends))))
    if share in (0.0, 1.0):
        return camera
    pitch = 2 * _RIM * share * farthest / camera.sensor.height_px
    return dataclasses.replace(camera, sensor=dataclasses.replace(camera.sensor, pitch_mm=pitch))


def _inset(camera: Camera, array: MicrolensArray, left: float, top_px: float) -> str:
    """Inset of the microlenses at the centre of the sensor, with more rays of the object point there, enlarged."""
    scale = _INSET_PX / (_INSET_LENSES * array.pitch_mm)
    width = (_WIDTH_PX - 2 * _MARGIN_PX) / scale
    end = camera.sensor_distance_mm
    film = end - array.distance_mm
    start = end + 0.05 * width - width
    centre = _height(camera, 0.0)
    low = centre - width
    high = centre + width
    sheet = _Sheet(start + _MARGIN_PX / scale, scale, _INSET_PX / 2 + centre * scale)
    sheet.area([(start, low), (end + width, low), (end + width, high), (start, high)], "#fbfbfb")
    sheet.line([(start, 0.0), (end + width, 0.0)], "#888888", 0.6, dashes="8 3 2 3")
    for ray in bundle(camera, 0.0, left, _INSET_RAYS):
        sheet.line(_turned(camera, ray[-3:], -1), FIELDS[0][1], 0.7)
    if array.disc_diameter_mm is not None:
        half = array.disc_diameter_mm / 2
    elif array.layout == "hexagonal":  # half the distance of rows: cells of neighbouring rows interlock
        half = array.pitch_mm * math.sqrt(3) / 4
    else:
        half = float(cell(array)[:, 1].max())
    vertices = lattice(array)
    # A microlens is drawn at each height at which one stands near the vertical plane.
    x, heights = _about_axis(camera, vertices)
    near_plane = heights[np.abs(x) <= array.pitch_mm]
    for y in np.unique(near_plane[np.abs(near_plane - centre) < _INSET_LENSES * array.pitch_mm].round(6)).tolist():
        row = _row_at(camera, vertices, y)
        bulge = 0.12 * array.pitch_mm
        sheet.area([(film, y + half), (film - bulge, y), (film, y - half), (film + bulge, y)], "#dcc9e8")
        sheet.label(film - 2 * bulge, y, f"type {int(vertices.type[row])}", "end")
    sheet.line([(end, low), (end, high)], _DARK, 3)
    box = {"x": _MARGIN_PX, "y": round(top_px), "width": _WIDTH_PX - 2 * _MARGIN_PX, "height": _INSET_PX}
    return svg_file.element("svg", "", *sheet.items, "", **box)


def bundle(camera: Camera, field: float, left_mm: float, count: int = _RAYS) -> list[Points]:
    """Rays of one object point that pass the lens, from x = `left_mm` to the sensor; (along the axis, height) [mm].

    `field`: 0 for an image at the centre of the sensor, 1 at its farther edge, or at the rim of the image circle.
    `count`: number of rays, evenly spread over those that pass.
    """
    # Find the ray in the middle of the bundle. Light of an image above the axis comes from below it: where it does not,
    # as beyond the edge of a wide field, the image comes nearer to the axis.
    height = _lit_height(camera, field)
    central = _central_ray(camera, height)
    while central and central[1][1] * math.copysign(1, height) < 0 and abs(height) > 1e-9:
        height *= _RIM
        central = _central_ray(camera, height)
    if central is None:
        return []
    # Try rays beside it from its object point, and again among those that pass: the bundle of a narrow stop is a small
    # part of the front surface.
    reach = 1.5 * camera.prescription.surfaces[0].semi_diameter_mm
    offsets = np.linspace(-reach, reach, _FAN)
    for _ in range(2):
        start, directions = _fan(*central, offsets, _in_focus(camera))
        x, y, passes, slopes = _trace(camera.prescription, start, directions)
        indices = np.flatnonzero(passes)
        if not indices.size:
            return []
        step = offsets[1] - offsets[0]
        ends = offsets[indices[[0, -1]]]
        offsets = np.linspace(ends[0] - step, ends[1] + step, _FAN)
    # Draw `count` of those that pass from the edge of the drawing to the sensor.
    chosen = indices[np.round(np.linspace(0, indices.size - 1, count)).astype(int)]
    rays = []
    for i in dict.fromkeys(chosen.tolist()):
        points = list(zip(x[1:, i].tolist(), y[1:, i].tolist(), strict=True))
        first = _entry(points[0], directions[i].tolist(), left_mm, _half_height(camera))
        rays.append([first, *points, *_behind(camera, points[-1], float(slopes[i]))])
    return rays


def _central_ray(camera: Camera, height_mm: float) -> tuple[np.ndarray, np.ndarray] | None:
    """The middle one of the rays that leave the lens from a height on the sensor; None if none does.

    Returns its intersection with the front surface, and its direction in the scene, (2,) along and across the axis.
    """
    table = towards_scene(camera.prescription)
    # Vision y and z are the drawing's height and length with the other sign.
    reach = 1.25 * math.sqrt(table[0, SEMI_DIAMETER_SQUARED])
    aim = np.linspace(-reach, reach, _FAN)
    on_sensor = camera.in_vision(np.array([[0.0, -height_mm, -camera.sensor_distance_mm]]))
    starts = np.tile(on_sensor, (_FAN, 1))
    position, direction, passes = trace(table, starts, directions_to(table, starts, np.stack([0 * aim, aim], axis=1)))
    indices = np.flatnonzero(passes)
    if not indices.size:
        return None
    middle = indices[indices.size // 2]
    _, y, z = position[middle].tolist()
    _, dy, dz = direction[middle].tolist()
    return np.array([-z, -y]), np.array([dz, dy])


def _in_focus(camera: Camera) -> tuple[float, float]:
    """Distance of the plane in focus, and its slope: how much nearer to the sensor it lies per height."""
    distance = middle_focus(camera)
    tilted = camera.film.vision_from_film
    if tilted is None or math.isinf(distance):
        return distance, 0.0
    turned = focus_plane_tilt_deg(tilted, first_order(camera.prescription), distance)
    return distance, math.tan(math.radians(turned[0]))


def _fan(
    entry: np.ndarray, along: np.ndarray, offsets: np.ndarray, in_focus: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 2) on the lens beside the central ray, and directions of the rays that reach them from its object
    point.

    The object point lies in the plane in focus. On steep rays it is at most twice as far away as that plane; for an
    infinite distance the rays are parallel.
    """
    distance, slope = in_focus
    points = entry + offsets[:, None] * np.array([-along[1], along[0]])
    if math.isinf(distance):
        return points, np.tile(along, (len(points), 1))
    # The central ray, followed back from its entry, meets the plane x = slope y - distance after `away`.
    away = (distance + entry[0] - slope * entry[1]) / max(along[0] - slope * along[1], 0.5)
    directions = points - (entry - away * along)
    return points, directions / np.linalg.norm(directions, axis=1, keepdims=True)


def _entry(first: tuple[float, float], direction: list[float], left_mm: float, limit_mm: float) -> tuple[float, float]:
    """Point at which a ray to the lens enters the drawing: through its left side, or from above or below."""
    x, y = first
    along, across = direction
    back = (x - left_mm) / along if along > 0 else math.inf
    if across:
        back = min(back, (y + math.copysign(limit_mm, across)) / across)
    return x - back * along, y - back * across


def _trace(
    prescription: Prescription, start: np.ndarray, directions: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Points on all surfaces, (surfaces + 1, n) along and across the axis; flags of passing; slopes behind the lens."""
    in_plane = (np.stack([np.zeros(len(start)), rays[:, 1], rays[:, 0]], axis=1) for rays in (start, directions))
    points, (_, direction, passes) = trace_path(towards_sensor(prescription), *in_plane)
    return points[..., 2], points[..., 1], passes, direction[:, 1] / direction[:, 2]


def _behind(camera: Camera, last: tuple[float, float], slope: float) -> Points:
    """The ray behind the lens: to the sensor, through the microlens of the cell that it meets, drawn as a thin one."""
    # The ray relative to the sensor, as if that stood upright
    (x, y), next_point = _turned(camera, [last, (last[0] + 1.0, last[1] + slope)], -1)
    slope = (next_point[1] - y) / (next_point[0] - x)
    array = camera.microlenses
    if array is None:
        return _turned(camera, [(camera.sensor_distance_mm, y + slope * (camera.sensor_distance_mm - x))])
    film = camera.sensor_distance_mm - array.distance_mm
    at_film = y + slope * (film - x)
    vertices = lattice(array)
    row = _row_at(camera, vertices, at_film)
    height = at_film - float(_about_axis(camera, vertices)[1][row])
    bent = slope - height / array.focal_lengths_mm[int(vertices.type[row])]
    ends = [(film, at_film), (camera.sensor_distance_mm, at_film + bent * array.distance_mm)]
    return _turned(camera, ends)


def _turned(camera: Camera, points: Points, sign: int = 1) -> Points:
    """Points given for an upright sensor, turned with the tilted sensor; with `sign` -1 turned back.

    A tilt about y moves none of them: y of the film stays in the vertical plane.
    """
    angle = sign * math.radians(camera.sensor.tilt_deg[0])
    end = camera.sensor_distance_mm
    sine, cosine = math.sin(angle), math.cos(angle)
    return [(end + cosine * (x - end) + sine * y, cosine * y - sine * (x - end)) for x, y in points]


def _films(camera: Camera) -> list[Points]:
    """Lower and upper end of the sensor, and of the microlens array if there is one."""
    half = _half_sensor(camera)
    end = camera.sensor_distance_mm
    centre = _height(camera, 0.0)
    array = camera.microlenses
    ends = [(end, centre - half), (end, centre + half)]
    if array is None:
        return [_turned(camera, ends)]
    film = end - array.distance_mm
    reach = extent_mm(array)[1] / 2
    middle = centre + array.offset_y_mm
    return [_turned(camera, ends), _turned(camera, [(film, middle - reach), (film, middle + reach)])]


def _row_at(camera: Camera, vertices: Lattice, y: float) -> int:
    """Row of the microlens whose cell contains the height y of the drawing; up is +y of the sensor frame."""
    x, heights = _about_axis(camera, vertices)
    return int(np.argmin(np.hypot(x, heights - y).round(9)))


def _about_axis(camera: Camera, vertices: Lattice) -> tuple[np.ndarray, np.ndarray]:
    """Microlens vertices relative to the optical axis, which need not meet the centre of the sensor."""
    return vertices.x_mm - camera.sensor.offset_x_mm, vertices.y_mm - camera.sensor.offset_y_mm


def _half_sensor(camera: Camera) -> float:
    return camera.sensor.height_px * camera.sensor.pitch_mm / 2


def _height(camera: Camera, field: float) -> float:
    """Height in the drawing of a relative sensor height: 0 at its centre, 1 at the edge farther from the axis."""
    centre = 0.0 - camera.sensor.offset_y_mm
    return centre + field * math.copysign(_half_sensor(camera), centre)


def _half_height(camera: Camera) -> float:
    """Half the height of the drawing: a little more than the largest surface or the edge of the sensor."""
    return 1.12 * max([abs(_height(camera, 1.0)), *(s.semi_diameter_mm for s in camera.prescription.surfaces)])


def _rear(camera: Camera) -> tuple[np.ndarray, int]:
    """Surfaces towards the scene, and the row of the stop."""
    return towards_scene(camera.prescription), len(camera.prescription.surfaces) - 1 - camera.prescription.stop_index


def _lit_height(camera: Camera, field: float) -> float:
    """`_height`, with the rim of the image circle in place of the edge of the sensor where that is dark."""
    centre = _height(camera, 0.0)
    edge = _height(camera, 1.0)
    ends = np.array([[0.0, -height, -camera.sensor_distance_mm] for height in (0.0, edge)])
    share = lit_share(*_rear(camera), *camera.in_vision(ends))
    return centre + field * ((edge if share == 1 else _RIM * share * edge) - centre)


def _draw_stop(sheet: "_Sheet", prescription: Prescription, half: float) -> None:
    edge = prescription.stop.semi_diameter_mm
    widest = max(surface.semi_diameter_mm for surface in prescription.surfaces)
    for side in (-1, 1):
        sheet.line([(0.0, side * edge), (0.0, side * max(1.05 * widest, 1.3 * edge))], _DARK, 3)
    sheet.label(0.0, half, "stop")


def _draw_film(sheet: "_Sheet", camera: Camera, name: str) -> None:
    sensor, *array = _films(camera)
    sheet.line(sensor, _DARK, 3)
    sheet.label(*sensor[1], name, "start")
    for ends in array:
        sheet.line(ends, _ARRAY, 1.5, dashes="2 2")
        sheet.label(*ends[1], "MLA", "end")


def _draw_scale(sheet: "_Sheet", left: float, right: float, half: float) -> None:
    sheet.line([(left, -half), (right, -half)], "#555555", 0.8)
    step = 10 ** math.floor(math.log10((right - left) / 3))
    for tick in range(math.ceil(left / step), math.floor(right / step) + 1):
        sheet.line([(tick * step, -half), (tick * step, -half - 4 / sheet.scale)], "#555555", 0.8)
        words = f"{tick * step:g}" + (" mm" if tick == 0 else "")
        sheet.words(sheet.to_px(tick * step, -half - 18 / sheet.scale), words, 11)


def focus_in_words(camera: Camera, number_format: str = ".1f") -> str:
    """Distance from the stop to the plane in focus; the median over the types of microlenses."""
    distance_mm = middle_focus(camera)
    return "infinity" if math.isinf(distance_mm) else f"{distance_mm:{number_format}} mm before the stop"


class _Sheet:
    """Elements of an unfinished drawing, in mm: x from `left` at `scale` pixels per mm, y upwards from `axis_px`."""

    def __init__(self, left: float, scale: float, axis_px: float) -> None:
        self.left, self.scale, self.axis_px = left, scale, axis_px
        self.items: list[str] = []

    def to_px(self, x: float, y: float) -> svg_file.Point:
        return _MARGIN_PX + (x - self.left) * self.scale, self.axis_px - y * self.scale

    def line(self, points: Points, colour: str, width: float, dashes: str = "") -> None:
        dashed = {"stroke_dasharray": dashes} if dashes else {}
        placed = [self.to_px(*point) for point in points]
        self.items.append(svg_file.line(placed, stroke=colour, stroke_width=width, **dashed))

    def area(self, points: Points, colour: str) -> None:
        placed = [self.to_px(*point) for point in points]
        self.items.append(svg_file.area(placed, fill=colour, stroke=_EDGE, stroke_width=0.6))

    def label(self, x: float, y: float, words: str, anchor: str = "middle") -> None:
        """Write words a little above a point."""
        x_px, y_px = self.to_px(x, y)
        self.words((x_px, y_px - 6), words, 11, anchor)

    def words(self, at_px: svg_file.Point, words: str, size: int, anchor: str = "middle") -> None:
        """Write words at a point, in pixels."""
        style = {"font_family": "sans-serif", "font_size": str(size), "text_anchor": anchor, "fill": "#222222"}
        self.items.append(svg_file.words(words, at_px, **style))

    def text(self, height: float) -> str:
        narrower = "max-width: 100%; height: auto"  # on a page or in a notebook that has no room for all of it
        return svg_file.document((_WIDTH_PX, round(height)), *self.items, style=narrower)
