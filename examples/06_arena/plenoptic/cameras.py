"""The plenoptic cameras of the arena as USD stages: rigs behind real lenses, each as designed and with one flaw."""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

Attributes = dict[str, object]


@dataclass(frozen=True, slots=True, kw_only=True)
class Rig:
    """A plenoptic camera, and the board that it is calibrated with.

    Attributes
    ----------
    name, what : str
    lens : str
        Stage of the library.
    stop_mm : float
        Semi-diameter of the stop.
    focus_mm, sensor_mm : float
        Object distance from the stop in focus behind microlenses of the middle type; or, behind microlenses that see
        infinity sharp, place of the sensor: the lens then images 500 mm onto the microlenses.
    gap_mm : float
        From microlenses to sensor.
    array : dict
        Attributes of the array, without `plen:`, as USD writes them.
    size_px, pixel_mm
        The sensor.
    distances_mm : tuple of float
        Where boards stand, from the stop.
    square_mm : float
    f_numbers : tuple of float
        Of further white images, from which libpleno learns.
    rims : dict
        Semi-diameters of surfaces [mm], where they are not those of the lens.
    electrons : float
        Of the brightest white pixel, if images have the noise of a sensor.
    planes_mm : tuple of float
        Near and far plane, where focus says none: microlenses that see infinity sharp may make it virtual.
    """

    name: str
    what: str
    lens: str
    stop_mm: float
    gap_mm: float
    array: Attributes
    size_px: tuple[int, int]
    pixel_mm: float
    distances_mm: tuple[float, ...]
    square_mm: float
    f_numbers: tuple[float, ...]
    focus_mm: float | None = None
    sensor_mm: float | None = None
    rims: Attributes = field(default_factory=dict)
    electrons: float | None = None
    planes_mm: tuple[float, float] | None = None


COLUMNS, ROWS = 9, 6
"""Inner corners of every board."""
_TURNS_DEG = ((0, 0), (22, 0), (0, -24), (-18, 16))
"""Turns of a board about x and y at each distance [deg]: without tilted boards no distance is determined."""
_HEX: Attributes = {"layout": '"hexagonal"', "aperture": '"cell"'}
RIGS = (
    Rig(
        name="paper",
        what="Michels 2019: double Gauss 100 mm, three types, hexagonal",
        lens="double_gauss_100mm_tronnier",
        stop_mm=5.0,
        focus_mm=420.0,
        gap_mm=1.7,
        array=_HEX | {"pitch": 0.2173, "focalLengths": [1.9, 2.1, 2.3], "width": 9.5, "height": 7.5},
        size_px=(800, 600),
        pixel_mm=0.01,
        distances_mm=(380.0, 420.0, 465.0),
        square_mm=2.0,
        f_numbers=(14.0, 20.0, 28.0),
    ),
    Rig(
        name="r12",
        what="like a Raytrix R12: double Gauss 50 mm f/2.4, three types, hexagonal, focused",
        lens="double_gauss_50mm_tronnier",
        stop_mm=7.2,
        focus_mm=370.0,
        gap_mm=0.3371,
        array=_HEX | {"pitch": 0.12744, "focalLengths": [0.524, 0.5606, 0.5827], "width": 6.6, "height": 5.3},
        size_px=(1120, 880),
        pixel_mm=0.0055,
        distances_mm=(320.0, 345.0, 369.0),
        square_mm=3.0,
        f_numbers=(4.0, 5.6, 8.0),
    ),
    Rig(
        name="lytro",
        what="like a Lytro, seven times as large: double Gauss 50 mm f/4, one type in the sensor's focus, hexagonal",
        lens="double_gauss_50mm_tronnier",
        stop_mm=4.6,
        sensor_mm=57.22227889486375,
        gap_mm=0.4,
        array=_HEX | {"pitch": 0.1, "focalLengths": [0.4], "width": 8.6, "height": 8.6},
        size_px=(800, 800),
        pixel_mm=0.01,
        distances_mm=(350.0, 385.0, 430.0),
        square_mm=4.5,
        f_numbers=(5.6, 8.0, 11.0),
    ),
    Rig(
        name="wide",
        what="as lytro, behind a retrofocus lens of 28 mm: its exit pupil is twice as far away as its principal plane",
        lens="retrofocus_28mm_leica",
        stop_mm=4.54,
        sensor_mm=56.12172087712594,
        gap_mm=0.4,
        array=_HEX | {"pitch": 0.1, "focalLengths": [0.4], "width": 8.6, "height": 8.6},
        size_px=(800, 800),
        pixel_mm=0.01,
        distances_mm=(200.0, 240.0, 300.0),
        square_mm=4.5,
        f_numbers=(5.6, 8.0, 11.0),
        planes_mm=(150.0, 600.0),
    ),
)
"""The paper's camera, a focused and two unfocused ones."""


@dataclass(frozen=True, slots=True)
class Flaw:
    """What is not as designed: of which rigs, and in which numbers."""

    name: str
    what: str


FLAWS = (
    Flaw("designed", "as designed"),
    Flaw("tilted", "array turned by 0.2 degrees about x"),
    Flaw("square", "square lattice, of microlenses of the middle type"),
    Flaw("mismatched", "stop 0.7 as wide: the pupil, not the microlens, bounds what is blurred"),
    Flaw("vignetted", "first surface of the lens half as large"),
    Flaw("noisy", "images with the noise of a sensor that collects 1,000 electrons of white"),
)


def with_flaw(rig: Rig, flaw: str) -> Rig:
    """The rig with a flaw of `FLAWS`."""
    if flaw == "tilted":
        return replace(rig, array=rig.array | {"tilt": (0.2, 0.0)})
    if flaw == "square":
        focal_mm: list[float] = rig.array["focalLengths"]  # type: ignore[assignment]
        middle = sorted(focal_mm)[len(focal_mm) // 2]
        return replace(rig, array=rig.array | {"layout": '"square"', "focalLengths": [middle]})
    if flaw == "mismatched":
        return replace(rig, stop_mm=0.7 * rig.stop_mm)
    if flaw == "vignetted":
        return replace(rig, rims={"S1": 1.3 * rig.stop_mm})
    if flaw == "noisy":
        return replace(rig, electrons=1000.0)
    return rig


def small(rig: Rig) -> Rig:
    """The rig with a sensor and an array half as wide and high, so that all is done in minutes."""
    array = rig.array | {name: float(rig.array[name]) / 2 for name in ("width", "height")}  # type: ignore[arg-type]
    return replace(rig, size_px=(rig.size_px[0] // 2, rig.size_px[1] // 2), array=array)


def poses(rig: Rig) -> list[tuple[np.ndarray, Rotation]]:
    """Place of the middle of each board [mm, USD's camera frame] and its turn; four at each distance."""
    result = []
    for distance in rig.distances_mm:
        for number, (about_x, about_y) in enumerate(_TURNS_DEG):
            aside = 0.012 * distance * np.array([(-1) ** number, 0.8 * (-1) ** (number // 2)])
            turn = Rotation.from_euler("xyz", [about_x, about_y, 3 + 5 * number], degrees=True)
            result.append((np.array([*aside, -distance]), turn))
    return result


def stage_text(rig: Rig, *, samples: int = 128) -> str:
    """USD stage of all boards before a rig."""
    places = poses(rig)
    shifts = "\n".join(f"            {n + 1}: {tuple(p.tolist())}," for n, (p, _) in enumerate(places))
    turns = "\n".join(f"            {n + 1}: {_quaternion(turn)}," for n, (_, turn) in enumerate(places))
    array = "\n".join(f"        uniform {_TYPES[name]} plen:{name} = {value}" for name, value in rig.array.items())
    rims = "".join(_RIM.format(name=name, rim=rim) for name, rim in (rig.rims | {"Stop": rig.stop_mm}).items())
    focus = {"sensorDistance": rig.sensor_mm} if rig.focus_mm is None else {"focusDistance": rig.focus_mm}
    focus |= dict(zip(("near", "far"), rig.planes_mm or (), strict=False))
    lengths = "\n".join(f"            uniform double plen:camera:{name} = {value}" for name, value in focus.items())
    return _STAGE.format(
        frames=len(places), rig=rig, focus=lengths, array=array, rims=rims, shifts=shifts, turns=turns, samples=samples,
        columns=COLUMNS, rows=ROWS, f_numbers=list(rig.f_numbers),
    )  # fmt: skip


def _quaternion(turn: Rotation) -> tuple[float, ...]:
    i, j, k, real = turn.as_quat().tolist()
    return real, i, j, k


_TYPES = {
    "layout": "token", "aperture": "token", "pitch": "double", "focalLengths": "double[]", "width": "double",
    "height": "double", "tilt": "double2",
}  # fmt: skip
_RIM = """
            over "{name}"
            {{
                uniform double plen:semiDiameter = {rim}
            }}
"""
_STAGE = """#usda 1.0
(
    defaultPrim = "Arena"
    endTimeCode = {frames}
    metersPerUnit = 0.001
    startTimeCode = 1
    timeCodesPerSecond = 24
    upAxis = "Y"
)

def PlenDataset "Arena"
{{
    rel plen:cameras = </Arena/Rig/Camera>
    uniform double plen:background = 0.3
    uniform int plen:seed = 6
    rel plen:targets = </Arena/Board>

    def Xform "Rig"
    {{
        def Camera "Camera" (
            prepend apiSchemas = ["PlenCameraAPI"]
        )
        {{
            rel plen:camera:lens = </Arena/Rig/Lens>
{focus}
            uniform double plen:camera:microlensDistance = {rig.gap_mm}
            rel plen:camera:microlenses = </Arena/Rig/Microlenses>
            rel plen:camera:sensor = </Arena/Rig/Sensor>
            uniform double[] plen:image:fNumbers = {f_numbers}
            uniform int plen:image:samples = {samples}
        }}

        def "Lens" (
            prepend references = @lenses/{rig.lens}.usda@
        )
        {{{rims}        }}

        def PlenSensor "Sensor"
        {{
            uniform double plen:pixelPitch = {rig.pixel_mm}
            uniform int2 plen:resolution = {rig.size_px}
        }}

        def PlenMicrolensArray "Microlenses"
        {{
{array}
        }}
    }}

    def PlenCheckerboard "Board"
    {{
        uniform int plen:columns = {columns}
        uniform int plen:rows = {rows}
        uniform double plen:squareSize = {rig.square_mm}
        quatd xformOp:orient.timeSamples = {{
{turns}
        }}
        double3 xformOp:translate.timeSamples = {{
{shifts}
        }}
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:orient"]
    }}
}}
"""
