"""Lenses and cameras of the Blender add-on for plenoptic cameras.

A lens table has rows `radius;thickness;material;index;v-no;sa` in mm. An empty radius is a plane, an empty index or 0
is air. The stop is the second of the first two consecutive rows whose material is exactly `air`.

A camera has rows `key;value` and names its lens table. Lengths are millimetres but the pitch of the microlenses, which
is micrometres. The distance of the sensor counts from the stop. The add-on's types are (i - j) mod 3 as ours, but its
first, third and second focal length belong to our 0, 1, 2.
"""

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

from pipeline.camera.parts.camera import PrintedCamera, Sensor
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.optics.printed import Lost, PrintedLens, PrintedSurface
from pipeline.plugins.lenses.text import UnreadableLens, number, read_lines

_COLUMNS = ("radius", "thickness", "material", "index", "v-no", "sa")
_LAYOUTS = {"HEX": "hexagonal", "RECT": "square"}
_MESHING = ("prop_lens_creation_method", "prop_lens_patch_size", "prop_vertex_count_radial", "prop_vertex_count_height")
_READ = """
objective_file_name prop_objective_list prop_objective_scale prop_aperture_blades prop_aperture_size prop_aperture_angle
prop_sensor_width prop_sensor_height prop_pixel_size prop_wavelength prop_focus_distance prop_focal_distance
prop_sensor_mainlens_distance prop_mla_enabled prop_mla_type prop_microlens_diam prop_mla_sensor_dist
prop_three_ml_types prop_ml_type_1_f prop_ml_type_2_f prop_ml_type_3_f
"""


def is_blender(lines: list[str]) -> bool:
    """Whether a file begins like one of the add-on: a lens table or a camera."""
    header = [cell.strip().lower() for cell in lines[0].split(";")] if lines else []
    return tuple(header[: len(_COLUMNS)]) == _COLUMNS or any(line.startswith(("prop_", "objective_")) for line in lines)


def read_blender(path: str | Path) -> PrintedLens:
    """A lens from a CSV file of the add-on."""
    lines = read_lines(path)
    header = [cell.strip().lower() for cell in lines[0].split(";")] if lines else []
    if any(text.startswith(("prop_", "objective_")) for text in lines):
        raise UnreadableLens(path, "is a camera of the add-on, and no lens table", hint="pipeline import camera FILE")
    if tuple(header[: len(_COLUMNS)]) != _COLUMNS:
        raise UnreadableLens(path, f'the first line must be "{";".join(_COLUMNS)}"', line=1)
    rows = [(line, text) for line, text in enumerate(lines[1:], 2) if text.strip("; \t")]
    surfaces = [_surface(path, line, text) for line, text in rows]
    if not surfaces:
        raise UnreadableLens(path, "holds no surfaces")
    # Not stripped: the add-on takes a row with another spelling for glass.
    materials = [text.split(";")[2] for _, text in rows]
    pairs = (i for i, pair in enumerate(pairwise(materials), 1) if pair == ("air", "air"))
    stop = next(pairs, None)
    if stop is None:
        reason = 'has no stop: no two consecutive rows have the material "air"'
        hint = "add a row for the stop, with its semi-diameter; the add-on itself invents one before the first vertex"
        raise UnreadableLens(path, reason, hint=hint)
    if not math.isinf(surfaces[stop].radius_mm):
        raise UnreadableLens(path, "the row of the stop has a radius", line=rows[stop][0])
    surfaces[stop] = replace(surfaces[stop], is_stop=True)
    back_mm = surfaces[-1].thickness_mm
    return PrintedLens(name=Path(path).stem, surfaces=tuple(surfaces), nominal_bfd_mm=back_mm if back_mm > 0 else None)


def _surface(path: str | Path, line: int, text: str) -> PrintedSurface:
    """A row of a lens table as a surface; UnreadableLens if its material and its index contradict each other."""
    cells = [cell.strip() for cell in text.split(";")]
    if len(cells) < len(_COLUMNS):
        raise UnreadableLens(path, f"a row has {len(cells)} columns, not {len(_COLUMNS)}", line=line)
    values = dict(zip(_COLUMNS, cells, strict=False))

    def cell(name: str) -> float | None:
        return number(path, line, values[name], f'"{name}"') if values[name] else None

    index = cell("index") or 1.0
    glass = "" if values["material"].lower() == "air" else values["material"]
    if glass and index == 1:
        reason = f"glass {glass} has no index"
        raise UnreadableLens(path, reason, line=line, hint="write its index into the fourth column")
    if not glass and index != 1:
        raise UnreadableLens(path, f"air has index {index:g}", line=line)
    radius, semi_diameter = cell("radius"), cell("sa")
    return PrintedSurface(
        radius_mm=math.inf if radius is None else radius,
        thickness_mm=cell("thickness") or 0.0,
        semi_diameter_mm=semi_diameter,
        index=index,
        glass=glass,
        abbe=(cell("v-no") or None) if glass else None,
    )


class _Keys:
    """The rows of a file, each with its line."""

    def __init__(self, path: str | Path) -> None:
        self.path = path
        self.rows: dict[str, tuple[int, str]] = {}
        for line, text in enumerate(read_lines(path), 1):
            key, mark, value = text.partition(";")
            if not mark and text.strip():
                raise UnreadableLens(path, f'a row must be key;value, not "{text.strip()}"', line=line)
            self.rows[key.strip()] = (line, value.strip().rstrip(";"))

    def text(self, key: str) -> str:
        if key not in self.rows:
            raise UnreadableLens(self.path, f"has no {key}", hint=f"add a row {key};value")
        return self.rows[key][1]

    def refusal(self, key: str, reason: str) -> UnreadableLens:
        """The error of an impossible value."""
        return UnreadableLens(self.path, reason, line=self.rows[key][0])

    def number(self, key: str) -> float:
        text = self.text(key)
        # The add-on writes single precision; the shortest decimal with the same single is what its user typed.
        return float(f"{number(self.path, self.rows[key][0], text, key):.7g}")


def read_blender_camera(path: str | Path, lens: Path | None = None) -> PrintedCamera:
    """A camera of the add-on; by default it names the lens table, beside it or in `Lenses` there."""
    keys = _Keys(path)
    printed = _with_aperture(keys, read_blender(lens or _lens_path(keys)))
    try:
        return PrintedCamera(
            name=Path(path).stem,
            provenance=(
                f"Imported from {Path(path).name}, a camera of the Blender add-on, and its lens {printed.name}.",
            ),
            lens=printed,
            sensor=_sensor(keys),
            sensor_distance_mm=keys.number("prop_sensor_mainlens_distance"),
            microlenses=_microlenses(keys),
            lost=tuple(_lost(keys)),
        )
    except CameraError as error:
        raise UnreadableLens(path, error.message, hint=error.hint) from None


def _lens_path(keys: _Keys) -> Path:
    """The lens table that the camera names, in its own folder or in `Lenses` within that."""
    folder = Path(keys.path).parent
    if "objective_file_name" not in keys.rows:
        reason = "names its lens by a place in a list that depends on the version of the add-on"
        raise UnreadableLens(keys.path, reason, hint="say which lens table it is: --lens FILE.csv")
    name = keys.text("objective_file_name")
    candidates = [at / f"{name}{ending}" for at in (folder, folder / "Lenses") for ending in ("", ".csv")]
    table = next((file for file in candidates if file.is_file()), None)
    if table is None:
        line = keys.rows["objective_file_name"][0]
        raise UnreadableLens(keys.path, f'its lens "{name}" is not here', line=line, hint="say where: --lens FILE.csv")
    return table


def _with_aperture(keys: _Keys, lens: PrintedLens) -> PrintedLens:
    """The lens, scaled, with the aperture of the camera, limited by the stop of the lens."""
    scale = keys.number("prop_objective_scale") if "prop_objective_scale" in keys.rows else 1.0
    if not scale > 0:
        raise keys.refusal("prop_objective_scale", f"scales its lens by {scale:g}")
    size_mm = keys.number("prop_aperture_size")
    blades = int(keys.number("prop_aperture_blades"))
    turn_deg = keys.number("prop_aperture_angle") if "prop_aperture_angle" in keys.rows else 0.0
    surfaces = []
    for surface in lens.surfaces:
        edge_mm = None if surface.semi_diameter_mm is None else scale * surface.semi_diameter_mm
        scaled = replace(
            surface,
            radius_mm=scale * surface.radius_mm,
            thickness_mm=scale * surface.thickness_mm,
            semi_diameter_mm=edge_mm,
        )
        if surface.is_stop:
            edge_mm = min(size_mm / 2, edge_mm or math.inf)
            sides = blades if blades > 2 else 0
            scaled = replace(scaled, semi_diameter_mm=edge_mm, blades=sides, aperture_rotation_deg=turn_deg)
        surfaces.append(scaled)
    back_mm = lens.nominal_bfd_mm
    return replace(lens, surfaces=tuple(surfaces), nominal_bfd_mm=None if back_mm is None else scale * back_mm)


def _sensor(keys: _Keys) -> Sensor:
    """The sensor, whose size the add-on states in millimetres and not in pixels."""
    if "prop_pixel_size" not in keys.rows:
        raise UnreadableLens(keys.path, "has no prop_pixel_size, as older files", hint="add prop_pixel_size;0.01 (mm)")
    pitch_mm = keys.number("prop_pixel_size")
    if not pitch_mm > 0:
        raise keys.refusal("prop_pixel_size", f"has pixels of {pitch_mm:g} mm")
    width_px, height_px = (round(keys.number(f"prop_sensor_{side}") / pitch_mm) for side in ("width", "height"))
    return Sensor(width_px=width_px, height_px=height_px, pitch_mm=pitch_mm)


def _microlenses(keys: _Keys) -> MicrolensArray | None:
    """The microlens array, None if the file switches it off."""
    if keys.text("prop_mla_enabled") != "True":
        return None
    kind = keys.text("prop_mla_type")
    if kind not in _LAYOUTS:
        raise keys.refusal("prop_mla_type", f'prop_mla_type must be HEX or RECT, not "{kind}"')
    order = (1, 3, 2) if keys.text("prop_three_ml_types") == "True" and kind == "HEX" else (1,)
    return MicrolensArray(
        layout=_LAYOUTS[kind],
        pitch_mm=keys.number("prop_microlens_diam") / 1000,
        focal_lengths_mm=tuple(keys.number(f"prop_ml_type_{i}_f") for i in order),
        width_mm=keys.number("prop_sensor_width"),
        height_mm=keys.number("prop_sensor_height"),
        distance_mm=keys.number("prop_mla_sensor_dist"),
    )


def _lost(keys: _Keys) -> list[Lost]:
    """Settings of the camera that have no counterpart here, or that are not read."""
    lost = []
    for key in ("prop_focus_distance", "prop_focal_distance"):
        if key in keys.rows:
            loss = f"{key} = {keys.text(key)} cm: the distance of the sensor decides"
            lost.append(Lost(loss, keys.rows[key][0]))
    if "prop_wavelength" in keys.rows and abs(keys.number("prop_wavelength") - 587.6) > 0.1:
        loss = f"prop_wavelength = {keys.text('prop_wavelength')} nm: the lens has its printed indices, of 587.56 nm"
        lost.append(Lost(loss, keys.rows["prop_wavelength"][0]))
    if keys.text("prop_mla_enabled") != "True" and "prop_microlens_diam" in keys.rows:
        lost.append(Lost("microlenses, which the file switches off", keys.rows["prop_mla_enabled"][0]))
    elif keys.rows.get("prop_three_ml_types", (0, ""))[1] == "True":
        loss = "which side of microlens (0, 0) has the second focal length: taken as the add-on's formula says"
        lost.append(Lost(loss))
    unread = [(key, line) for key, (line, _) in keys.rows.items() if key and key not in {*_READ.split(), *_MESHING}]
    return lost + [Lost(f"{key} is not read", line) for key, line in unread]
