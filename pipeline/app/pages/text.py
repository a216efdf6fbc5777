"""The first-order report of a camera as a page for a terminal. It reads camera.json, so both agree."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from pipeline.camera.figures.field_curves import FieldCurves
from pipeline.files.jsonfile import Json

_WIDTH = 30
"""Characters before the value of a row: the longest name fits."""
_COUNTED = "distances are counted from the aperture stop, + towards the scene"


@dataclass(frozen=True, slots=True)
class Figure:
    """A row of the page of `pipeline show`."""

    name: str
    value: str
    remark: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """Some rows with a heading."""

    heading: str
    rows: tuple[Figure, ...]


def page(name: str, document: Json, curves: FieldCurves) -> list[str]:
    """Lines about one camera, whose camera.json is `document`."""
    lines = [f"{name}: {document['lens']['name']}", _COUNTED]
    if document["focus_request"]:
        lines.append(_request(document["focus_request"]))
    for section in figures(document, curves):
        lines += ["", section.heading, *map(_line, section.rows)]
    if "mla" in document:
        lines += ["", *_types(document["mla"])]
        lines += [f"  no type is sharp from {_range(*gap)}" for gap in document["mla"]["depth_of_field_gaps_mm"]]
    return [*lines, "", *_curves(curves)]


def figures(document: Json, curves: FieldCurves) -> list[Figures]:
    """The figures of a camera under their headings; parameters as for `page`."""
    sections = [Figures(heading="main lens", rows=tuple(_lens(document["lens"])))]
    if "windows" in document["lens"]:
        heading = "windows, the outermost first; the figures above are those of all together"
        sections.append(Figures(heading=heading, rows=tuple(_windows(document["lens"]))))
    if curves.boresight_px is not None:
        x, y = curves.boresight_px
        heading = "surfaces off their places: all figures but those of real rays are of the centred lens"
        boresight = Figure("image of the axis moves by", f"({x:+.3f}, {y:+.3f}) px", "boresight, by the real chief ray")
        sections.append(Figures(heading=heading, rows=(boresight,)))
    sections.append(Figures(heading="sensor", rows=(*_sensor(document), *_channels(document))))
    if "mla" in document:
        sections.append(Figures(heading="microlenses", rows=tuple(_microlenses(document))))
    return sections


def lens_page(document: Json, curves: FieldCurves | None) -> list[str]:
    """Lines about a bare lens, for an object at infinity; no curves where it has no real image."""
    lens = document["lens"]
    lines = [f"{lens['name']}, for objects at infinity", _COUNTED, ""]
    front, rear = lens["focal_points_mm"]
    rows = [
        Figure("surfaces", f"{lens['surfaces']}", f"{lens['length_mm']:.3f} mm from first to last vertex"),
        Figure("indices", f"{lens['index_source']}", f"{document['wavelengths_nm'][0]:g} nm"),
        *_cardinal(lens),
        Figure("focal points", f"{_mm(front)}, {_mm(rear)}", "front, rear"),
        Figure("f-number", f"{lens['f_number']:.2f}"),
    ]
    lines += map(_line, rows)
    return [*lines, "", *_curves(curves)] if curves else [*lines, "", "no real image: no rays to report"]


def _channels(document: Json) -> Iterator[Figure]:
    for channel in document.get("channels", ()):
        low, *_, high = channel["wavelengths_nm"]
        light = f"{channel['mean_wavelength_nm']:.1f} nm"
        remark = f"mean of {low:.1f} to {high:.1f} nm; focal length {channel['focal_length_mm']:.4f} mm"
        yield Figure(f"channel {channel['name']}", light, remark)


def _request(request: Json) -> str:
    """A line on the focus that the stage asks for, and what it has set."""
    wishes = []
    if request["focus_distance_mm"] is not None:
        kind = "" if request["focus_type"] is None else f" for microlens type {request['focus_type']}"
        distance = request["focus_distance_mm"]
        focus = "infinity" if math.isinf(distance) else f"{distance:g} mm"
        shift = request["group_shift_mm"]
        effect = "sets the sensor distance"
        if shift is not None:
            effect = f"moves {', '.join(request['focus_groups'])} by {shift:+.4f} mm towards the sensor"
        wishes.append(f"focus at {focus}{kind} {effect}")
    if request["stop_match"] != "none":
        wishes.append("a match with the microlenses sets the stop")
    return "asked for: " + "; ".join(wishes)


def _cardinal(lens: Json) -> Iterator[Figure]:
    """Focal length, principal planes and pupils of a lens."""
    front, rear = lens["principal_planes_mm"]
    yield Figure("effective focal length", _mm(lens["efl_mm"]))
    yield Figure("back focal distance", _mm(lens["bfd_mm"]), "from the last vertex")
    yield Figure("principal planes", f"{_mm(front)}, {_mm(rear)}", "front, rear")
    for which in ("entrance", "exit"):
        pupil = lens[f"{which}_pupil"]
        yield Figure(f"{which} pupil", f"{_mm(pupil['z_mm'])}, ø {_mm(pupil['diameter_mm'])}")
    yield Figure("stop", f"ø {_mm(lens['stop_diameter_mm'])}")


def _lens(lens: Json) -> Iterator[Figure]:
    if "index_in_front" in lens:
        yield Figure("index of the medium before it", f"{lens['index_in_front']:.6g}")
    yield from _cardinal(lens)
    yield Figure("f-number", f"{lens['f_number']:.2f}, working {lens['working_f_number']:.2f}")
    remark = "" if "matched_stop" not in lens else "without microlenses"
    yield Figure("conjugate of the sensor", _mm(lens["focus_distance_mm"]), remark)
    yield Figure("magnification there", f"{lens['magnification']:.4f}")
    if tilt := lens.get("focus_plane_tilt_deg"):
        yield Figure("plane of sharp focus", "turned by {:.3f}, {:.3f} deg".format(*tilt), "about x, about y, there")


def _windows(lens: Json) -> Iterator[Figure]:
    """Each window: vertices of its faces, and where they are not perpendicular to the axis or not flat their turn and
    centres of curvature; then the pupil behind all of them.
    """
    for window in lens["windows"]:
        faces = window["surfaces"]
        remarks = [] if faces[0]["axis"][2] == 1 else [f"turned by {_off_axis_deg(faces[0]['axis']):.3f} deg"]
        if centres := [_centre(face) for face in faces if not math.isinf(face["radius_mm"])]:
            remarks.append(f"centres of its faces at {', '.join(centres)}")
        vertices = ", ".join(_point(face["vertex_mm"]) for face in faces)
        yield Figure(window["name"], f"vertices at {vertices}", "; ".join(remarks))
    yield Figure("entrance pupil behind them", _mm(lens["pupil_behind_windows_mm"]), "about which a dome is concentric")


def _centre(face: Json) -> str:
    """Centre of curvature of a face, whose axis points towards the scene."""
    vertex_and_axis = zip(face["vertex_mm"], face["axis"], strict=True)
    return _point([vertex - face["radius_mm"] * axis for vertex, axis in vertex_and_axis])


def _off_axis_deg(axis: list[float]) -> float:
    x, y, z = axis
    return math.degrees(math.atan2(math.hypot(x, y), z))


def _point(point_mm: list[float]) -> str:
    """A point of the vision frame; one on the axis by its distance alone."""
    x, y, z = point_mm
    return f"({x:.3f}, {y:.3f}, {z:.3f}) mm" if round(x, 3) or round(y, 3) else _mm(z)


def _sensor(document: Json) -> Iterator[Figure]:
    """Sensor, projection, and depth of field of a camera."""
    width, height = document["resolution"]
    yield Figure("pixels", f"{width} x {height} of {1000 * document['pixel_pitch_mm']:g} µm")
    yield from _acceptance(document["pixel_acceptance"])
    yield Figure("size", "{:g} x {:g} mm".format(*document["sensor_mm"]))
    yield Figure("distance behind the stop", _mm(document["sensor_distance_mm"]))
    if tilt := document.get("sensor_tilt_deg"):
        yield Figure("tilt", "{:g}, {:g} deg".format(*tilt), "about x, about y: tauX and tauY of OpenCV")
    principal_mm = document["principal_distance_mm"]
    in_px = "" if math.isinf(principal_mm) else f" = {document['principal_distance_px']:.2f} px"
    yield Figure("principal distance", f"{_mm(principal_mm)}{in_px}")
    yield from _pinhole(document["pinhole"])
    x, y = document["optical_axis_px"]
    yield Figure("optical axis", f"({x:g}, {y:g}) px", "(0, 0) is the centre of the top-left pixel")
    across, down, diagonal = document["field_of_view_deg"]
    yield Figure("field of view", f"{across:.2f} x {down:.2f} deg, diagonal {diagonal:.2f} deg", "of the light on it")
    in_views = document.get("mla", {}).get("sharp_in") == "views"
    remark = "of views of one pixel, not of micro-images" if in_views else ""
    yield Figure("depth of field", _range(*document["depth_of_field_mm"]), remark)
    near, far = document["near_far_mm"]
    yield Figure("near and far plane", f"{_mm(near)}, {_mm(far)}", "of J_near, J_far")


def _pinhole(pinhole: Json | None) -> Iterator[Figure]:
    """The pinhole that fits real rays best, for OpenCV."""
    if pinhole is None:
        yield Figure("equivalent pinhole", "none", "a telecentric lens, too wide a field, or too little light")
        return
    centre = _point(pinhole["centre_mm"])
    yield Figure("equivalent pinhole", centre, "centre of projection, fitted to real rays")
    for name, projection in (("without", pinhole), ("with", pinhole["with_distortion"])):
        distance = f"{projection['principal_distance_px']:.2f} px"
        residual = "{rms:.2g} px rms, {max:.2g} px at most".format(**projection["residual_px"])
        yield Figure(f"  {name} distortion", distance, f"rays lie off by {residual}")


def _acceptance(acceptance: Json) -> Iterator[Figure]:
    if acceptance["shape"] == "cosine":
        yield Figure("pixels take", f"cos^{acceptance['power']:g} of the angle")
    elif acceptance["shape"] == "cone":
        yield Figure(
            "pixels take", f"up to {acceptance['half_angle_deg']:g} deg", f"falling over {acceptance['roll_off_deg']:g}"
        )


def _microlenses(document: Json) -> Iterator[Figure]:
    """The array: its geometry, its micro-images, and the match of F-numbers."""
    array = document["mla"]
    image_mm = array["micro_image_pitch_px"] * document["pixel_pitch_mm"]
    mismatch = array["f_number_mismatch"]
    yield Figure("distance to the sensor", _mm(array["distance_mm"]), f"{array['layout']} layout")
    yield Figure("microlenses", f"{array['count']} in {len(array['types'])} types", f"{array['model']} model")
    along = array["pitch_mm"]
    across = array["cross_pitch_mm"]
    yield Figure("MLA pitch", f"{_mm(along, 4)}", "" if along == across else f"{across:.5f} mm across")
    if array["aperture"] == "disc":
        yield Figure("apertures", f"discs ø {_mm(array['disc_diameter_mm'], 4)}", "opaque gaps")
    if array["index"] is not None:
        yield Figure("glass", f"index {array['index']:.5f}, {_mm(array['thickness_mm'])} thick")
    if any(array["tilt_deg"]):
        yield Figure("tilt", "{:g}, {:g} deg".format(*array["tilt_deg"]), "about x, about y")
    yield Figure(
        "micro-image pitch",
        f"{_mm(image_mm, 4)} = {array['micro_image_pitch_px']:.3f} px",
        f"{image_mm / array['pitch_mm']:.6f} MLA pitches",
    )
    verdict = "micro-images overlap" if mismatch < 1 else "gaps between micro-images"
    verdict = "matched" if abs(mismatch - 1) < 5e-4 else verdict
    yield Figure("F-number, lens / microlens", f"{mismatch:.4f}", verdict)
    yield Figure("stop that would match", f"ø {_mm(document['lens']['matched_stop_diameter_mm'], 2)}")


def _types(array: Json) -> Iterator[str]:
    """A table of the microlens types."""
    columns = (
        "type",
        "f [mm]",
        "virtual depth",
        "in focus [mm]",
        "magnification",
        "in micro-image",
        "depth of field [mm]",
    )
    rows = [
        (
            str(number),
            f"{kind['focal_length_mm']:.6g}",
            f"{kind['virtual_depth']:.2f}",
            f"{kind['focus_distance_mm']:.1f}",
            f"{kind['magnification']:.4f}",
            f"{kind['micro_image_magnification']:.5f}",
            " to ".join(f"{end:.1f}" for end in kind["depth_of_field_mm"]),
        )
        for number, kind in enumerate(array["types"])
    ]
    return table(columns, rows)


def _curves(curves: FieldCurves) -> Iterator[str]:
    """A table over the image height, and a line if the corner of the sensor is dark."""
    yield f"real rays of the main lens, without microlenses; distortion for objects at {_mm(curves.object_mm, 1)}"
    columns = ("height [mm]", "field angle [deg]", "relative illumination", "distortion [%]")
    values = zip(curves.height_mm, curves.angle_deg, curves.relative_illumination, 100 * curves.distortion, strict=True)
    rows = [(f"{h:.3f}", f"{a:.3f}", f"{e:.4f}", "-" if math.isnan(d) else f"{d:z.4f}") for h, a, e, d in values]
    yield from table(columns, rows)
    if curves.is_dark_in_the_corner:
        ends = f"light ends {_mm(curves.height_mm[-1])} from the axis, the image circle"
        yield f"{ends}: the corner of the sensor, {_mm(curves.corner_mm)} off, is dark"


def table(columns: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> Iterator[str]:
    """Right-aligned columns below their names."""
    widths = [max(map(len, column)) for column in zip(columns, *rows, strict=True)]
    for row in (columns, *rows):
        yield "  " + "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True))


def _line(row: Figure) -> str:
    return f"  {row.name:<{_WIDTH}}{row.value}" + (f"  ({row.remark})" if row.remark else "")


def _mm(value: float, digits: int = 3) -> str:
    return "infinity" if math.isinf(value) else f"{value:z.{digits}f} mm"


def _range(near: float, far: float) -> str:
    return f"{near:.1f} to {far:.1f} mm"
