"""Cameras of libpleno (COMPOTE, BLADE, PRISM): `intrinsics.js`, and `camera.js` where it has a microlens array.

JSON with numbers as strings; a matrix is a list of its columns. The camera looks along +z with its thin main lens in
the origin, array and sensor at negative z; their poses are those of a corner. The image shows x and y turned by 180
degrees, u = W - 1 - (X - sensor) / scale; so does our sensor frame, whose z has the same direction.
"""

import json
import math
from pathlib import Path
from typing import Any

from pipeline.camera.parts.camera import PrintedCamera, Sensor
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.parts.microlens_array import SIN_60, MicrolensArray
from pipeline.optics.printed import Lost, PrintedLens, PrintedSurface
from pipeline.plugins.lenses.text import UnreadableLens, read_lines
from pipeline.records.plain import Json

_LAYOUTS = {0: "square", 1: "hexagonal", 2: "hexagonal-columns"}
_UPRIGHT = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
"""Rotation of an array if the file states none: the unit matrix."""
_NO_TILT_DEG = 1e-9
"""Tilt below which there is none [deg]: rounding of a rotation matrix. It moves the rim of an array of 50 mm by
0.4 pm.
"""


def read_libpleno(path: str | Path) -> PrintedCamera:
    """A camera from a `.js` file."""
    try:
        file = json.loads("\n".join(read_lines(path)))
    except json.JSONDecodeError as error:
        raise UnreadableLens(path, f"is no JSON: {error.msg}", line=error.lineno) from None
    except RecursionError:
        raise UnreadableLens(path, "is JSON nested too deeply for a camera") from None
    if not isinstance(file, dict) or not {"main_lens", "sensor"} <= file.keys():
        raise UnreadableLens(path, "is no camera of libpleno: it has no main_lens and sensor")
    if "mla" not in file:
        reason = "holds start values without a microlens array, whose place only a calibration finds"
        raise UnreadableLens(path, reason, hint="import the intrinsics.js that the calibration writes")
    try:
        return _camera(path, file)
    except (KeyError, IndexError, TypeError, ValueError, ArithmeticError) as error:
        raise UnreadableLens(path, f"lacks something or has no number there: {error}") from None
    except CameraError as error:
        raise UnreadableLens(path, error.message, hint=error.hint) from None


def _camera(path: str | Path, file: Json) -> PrintedCamera:
    """The camera, with the centre of its sensor from the pose of the corner; KeyError and so on for missing values."""
    lens = file["main_lens"]
    chip = file["sensor"]
    focal_mm = _finite(lens["f"])
    pitch_mm = _finite(chip["scale"])
    width_px, height_px = int(chip["width"]), int(chip["height"])
    corner = _vector(chip["pose"])
    centre = [c + pitch_mm * (n - 1) / 2 for c, n in zip(corner, (width_px, height_px), strict=False)]
    sensor = Sensor(
        width_px=width_px, height_px=height_px, pitch_mm=pitch_mm, offset_x_mm=centre[0], offset_y_mm=centre[1]
    )
    array, lost = _array(path, file, centre, -corner[2])
    diameter_mm = _finite(lens["diameter"]) if "diameter" in lens else focal_mm / _finite(lens["aperture"])
    stop = PrintedSurface(focal_length_mm=focal_mm, semi_diameter_mm=diameter_mm / 2, is_stop=True)
    thin = PrintedLens(name=f"Ideal thin lens {focal_mm:g} mm", surfaces=(stop,), nominal_efl_mm=focal_mm)
    return PrintedCamera(
        name=Path(path).stem,
        provenance=(f"Imported from {Path(path).name}, a camera of libpleno with an ideal thin main lens.",),
        lens=thin,
        sensor=sensor,
        sensor_distance_mm=-corner[2],
        microlenses=array,
        lost=(*lost, *_lost(file)),
    )


def _array(path: str | Path, file: Json, centre: list[float], sensor_mm: float) -> tuple[MicrolensArray, list[Lost]]:
    """The microlens array about its middle microlens, and losses; `sensor_mm` is the distance of the sensor."""
    mesh = file["mla"]["mesh"]
    focal = [_finite(f) for f in file["mla"].get("focal_lengths", ())]
    layout = _LAYOUTS.get(int(mesh["geometry"]))
    if layout is None:
        raise UnreadableLens(path, f"its microlenses have the geometry {mesh['geometry']}, and not 0, 1 or 2")
    if not focal or (layout != "square" and len(focal) not in (1, 3)):
        raise UnreadableLens(path, f"its array has {len(focal)} types of microlenses, and not 1 or 3")
    x_mm, y_mm = (_finite(value) for value in mesh["pitch"][0])
    along, cross = (y_mm, x_mm) if layout == "hexagonal-columns" else (x_mm, y_mm)
    columns, rows = int(mesh["width"]), int(mesh["height"])
    middle = (columns - 1) // 2, (rows - 1) // 2
    offset = _node(layout, *middle)
    turn = _rotation(mesh["pose"])
    origin = _vector(mesh["pose"])
    node = [o + row[0] * x_mm * offset[0] + row[1] * y_mm * offset[1] for o, row in zip(origin, turn, strict=True)]
    tilt_x_deg, tilt_y_deg, rotation_deg = _angles_deg(turn)
    array = MicrolensArray(
        layout=layout,
        pitch_mm=along,
        cross_pitch_mm=None if along == cross else cross,
        columns=columns,
        rows=rows,
        distance_mm=sensor_mm + node[2],
        rotation_deg=rotation_deg,
        offset_x_mm=centre[0] - node[0],
        offset_y_mm=centre[1] - node[1],
        tilt_x_deg=tilt_x_deg,
        tilt_y_deg=tilt_y_deg,
        **_types(layout, columns, rows, focal),
    )
    # The first of our rows, or columns, ends like theirs; whether the next one does depends on which is shifted.
    middle_line, count = (middle[1], columns) if layout == "hexagonal" else (middle[0], rows)
    if layout == "square" or (middle_line + count) % 2 == 0:
        return array, []
    line = "row" if layout == "hexagonal" else "column"
    return array, [Lost(f"the outermost microlens of every other {line} is at its other end")]


def _node(layout: str, k: int, l: int) -> tuple[float, float]:
    """Node (k, l) of a mesh in its two pitches: even rows are shifted to the right by half of it, odd columns up."""
    if layout == "square":
        return k, l
    if layout == "hexagonal":
        return k + 0.5 * (l % 2 == 0), l * SIN_60
    return k * SIN_60, l - 0.5 * (k % 2 == 1)


def _angles_deg(turn: list[list[float]]) -> tuple[float, float, float]:
    """Tilt about x and y and rotation of the array in the sensor frame, from libpleno's rotation matrix.

    The sensor frame is libpleno's turned by 180 degrees about z, which changes the signs of both tilts:
    T(tilt) R(rotation) = Ry Rx Rz has the third column (sin b cos a, -sin a, cos b cos a).
    """
    a = math.asin(max(-1.0, min(1.0, turn[1][2])))
    b = -math.atan2(turn[0][2], turn[2][2])
    c = math.atan2(turn[1][0], turn[1][1])
    tilt_x, tilt_y = (math.degrees(angle) if abs(math.degrees(angle)) > _NO_TILT_DEG else 0.0 for angle in (a, b))
    return tilt_x, tilt_y, math.degrees(c)


def _types(layout: str, columns: int, rows: int, focal: list[float]) -> Json:
    """Focal lengths and, on a square lattice, the table of types.

    libpleno counts the types by micro-image, whose indices run against those of the microlenses, as ours do:
    ((l mod (n - 1)) + k) mod n in hexagonal rows, k and l exchanged elsewhere.
    """
    count = len(focal)
    middle = (columns - 1 - (columns - 1) // 2, rows - 1 - (rows - 1) // 2)
    if count == 1:
        return {"focal_lengths_mm": tuple(focal)}

    def type_of(k: int, l: int) -> int:
        """Number of the type of micro-image (k, l) in the file."""
        across, along = (l, k) if layout == "hexagonal" else (k, l)
        return (across % (count - 1) + along) % count

    if layout == "square":
        table = [type_of(middle[0] + k, middle[1] + l) for l in range(count) for k in range(count - 1)]
        return {
            "focal_lengths_mm": tuple(focal),
            "type_table": tuple(table),
            "type_period": (count - 1, count),
        }
    # Neighbours along a row, or down a column, have our types 0, 1, 2 one after the other.
    steps = [(step, 0) if layout == "hexagonal" else (0, -step) for step in range(3)]
    return {"focal_lengths_mm": tuple(focal[type_of(middle[0] + k, middle[1] + l)] for k, l in steps)}


def _finite(text: Any) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text} is not a finite number")
    return value


def _vector(pose: Json) -> list[float]:
    return [_finite(value) for value in pose["translation"][0]]


def _rotation(pose: Json) -> list[list[float]]:
    """Rows of a rotation matrix, which the file lists by columns; the unit matrix if there is none."""
    columns = [[_finite(value) for value in column] for column in pose.get("rotation", _UPRIGHT)]
    return [list(row) for row in zip(*columns, strict=True)]


def _lost(file: Json) -> list[Lost]:
    """Parts of the calibration that an ideal thin lens does not have."""
    brown = file.get("distortions", {})
    numbers = [
        _finite(value) for key in ("radial", "tangential", "depth") for row in brown.get(key, ()) for value in row
    ]
    lost = []
    if any(numbers):
        lost.append("distortion coefficients: the ideal thin lens has no distortion")
    if "scaling" in file:
        lost.append("the depth scaling polynomial")
    return [Lost(statement) for statement in lost]
