"""Cameras of libpleno (COMPOTE, BLADE, PRISM): `intrinsics.js`, and `camera.js` where it has a microlens array.

JSON with numbers as strings; a matrix is a list of its columns. The camera looks along +z with its thin main lens in
the origin, array and sensor at negative z; their poses are those of a corner. The image shows x and y turned by 180
degrees: u = W - 1 - (X - sensor) / scale.
"""

import json
import math
from itertools import product
from pathlib import Path
from typing import Any

from pipeline.camera.camera import CameraError, MicrolensArray, Sensor
from pipeline.camera.printed import PrintedCamera
from pipeline.files.lenses.text import UnreadableLens, read_lines
from pipeline.optics.printed import Lost, PrintedLens, PrintedSurface

_HEX_ROWS = 1


def read_libpleno(path: str | Path) -> PrintedCamera:
    """A camera from a `.js` file.

    Raises
    ------
    UnreadableLens
        The file is no camera of libpleno, or one without a microlens array, or one that cannot be represented.
    """
    try:
        file = json.loads("\n".join(read_lines(path)))
    except json.JSONDecodeError as error:
        raise UnreadableLens(path, f"is no JSON: {error.msg}", line=error.lineno) from None
    if not isinstance(file, dict) or not {"main_lens", "sensor"} <= file.keys():
        raise UnreadableLens(path, "is no camera of libpleno: it has no main_lens and sensor")
    if "mla" not in file:
        reason = "holds start values without a microlens array, whose place only a calibration finds"
        raise UnreadableLens(path, reason, hint="import the intrinsics.js that the calibration writes")
    try:
        return _camera(path, file)
    except (KeyError, IndexError, TypeError, ValueError) as error:
        raise UnreadableLens(path, f"lacks something or has no number there: {error}") from None
    except CameraError as error:
        raise UnreadableLens(path, error.what, hint=error.hint) from None


def _camera(path: str | Path, file: dict[str, Any]) -> PrintedCamera:
    lens, size = file["main_lens"], file["sensor"]
    focal_mm, pitch_mm = _finite(lens["f"]), _finite(size["scale"])
    width_px, height_px = int(size["width"]), int(size["height"])
    corner = _vector(size["pose"])
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


def _array(
    path: str | Path, file: dict[str, Any], centre: list[float], sensor_mm: float
) -> tuple[MicrolensArray, list[Lost]]:
    mesh, focal = file["mla"]["mesh"], [_finite(f) for f in file["mla"].get("focal_lengths", ())]
    if int(mesh["geometry"]) != _HEX_ROWS:
        raise UnreadableLens(path, "its microlenses do not form hexagonal rows, which cannot be represented yet")
    if len(focal) not in (1, 3):
        raise UnreadableLens(path, f"its array has {len(focal)} types of microlenses, and not 1 or 3")
    x_mm, y_mm = (_finite(value) for value in mesh["pitch"][0])
    columns, rows = int(mesh["width"]), int(mesh["height"])
    across, up = _axes(mesh["pose"])
    origin = _vector(mesh["pose"])
    middle = (columns - 1) // 2, (rows - 1) // 2
    place = _node(*middle)
    node = [origin[i] + across[i] * x_mm * place[0] + up[i] * y_mm * place[1] * math.sqrt(3) / 2 for i in (0, 1)]
    pitch_mm = (x_mm + y_mm) / 2
    tilt = math.degrees(math.atan2(up[2], up[1])), -math.degrees(math.atan2(across[2], across[0]))
    array = MicrolensArray(
        pitch_mm=pitch_mm,
        focal_lengths_mm=tuple(focal[kind] for kind in _types(columns, rows, middle, len(focal))),
        width_mm=columns * pitch_mm,
        height_mm=rows * pitch_mm * math.sqrt(3) / 2,
        distance_mm=sensor_mm + origin[2],
        rotation_deg=math.degrees(math.atan2(across[1], across[0])),
        offset_x_mm=centre[0] - node[0],
        offset_y_mm=centre[1] - node[1],
    )
    return array, _lost_of_array(x_mm, y_mm, tilt)


def _node(k: int, l: int) -> tuple[float, float]:
    """Node of a mesh of hexagonal rows: along a row in pitches, and which row."""
    return k + (0.5 if l % 2 == 0 else 0.0), l


def _types(columns: int, rows: int, middle: tuple[int, int], count: int) -> list[int]:
    """For each of our types, (k - l) mod 3 from the middle node, the one of libpleno.

    libpleno counts the types of hexagonal rows by micro-image, whose indices run against those of the microlenses.
    """
    if count == 1:
        return [0]
    found: dict[int, int] = {}
    x0, l0 = _node(*middle)
    for k, l in product(range(middle[0] - 3, middle[0] + 4), range(middle[1] - 3, middle[1] + 4)):
        theirs = ((rows - 1 - l) % (count - 1) + columns - 1 - k) % count
        row = l0 - l
        ours = round(x0 - _node(k, l)[0] - row / 2 - row) % 3
        if found.setdefault(int(ours), theirs) != theirs:
            raise CameraError("its types do not repeat as (k - l) mod 3")
    return [found[kind] for kind in range(3)]


def _finite(text: Any) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text} is not a finite number")
    return value


def _vector(pose: dict[str, Any]) -> list[float]:
    return [_finite(value) for value in pose["translation"][0]]


def _axes(pose: dict[str, Any]) -> tuple[list[float], list[float]]:
    x, y, _ = ([_finite(value) for value in column] for column in pose["rotation"])
    return x, y


def _lost_of_array(x_mm: float, y_mm: float, tilt_deg: tuple[float, float]) -> list[Lost]:
    lost = ["the outermost lenses of every other row may stand at the other end of it"]
    if x_mm != y_mm:
        lost.append(f"pitches of {x_mm:.9g} mm along rows and {y_mm:.9g} mm across; their mean is taken")
    if any(abs(angle) > 1e-9 for angle in tilt_deg):
        shown = f"{tilt_deg[0]:.5g} and {tilt_deg[1]:.5g} degrees about x and y"
        lost.append(f"a tilt of the array by {shown}; it stands upright at the distance of its origin")
    return [Lost(what=what) for what in lost]


def _lost(file: dict[str, Any]) -> list[Lost]:
    brown = file.get("distortions", {})
    numbers = [
        _finite(value) for key in ("radial", "tangential", "depth") for row in brown.get(key, ()) for value in row
    ]
    lost = []
    if any(numbers):
        lost.append("distortion coefficients: the ideal thin lens has no distortion")
    if "scaling" in file:
        lost.append("the depth scaling polynomial")
    return [Lost(what=what) for what in lost]
