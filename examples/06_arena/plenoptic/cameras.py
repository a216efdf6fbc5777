"""The plenoptic cameras of the arena: rigs behind real lenses, each as designed and with one flaw."""

import tomllib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pxr import Gf
from scipy.spatial.transform import Rotation

from stages import HERE, opened, pose, with_values

COLUMNS, ROWS = 9, 6
"""Inner corners of every board."""
_TURNS_DEG = ((0, 0), (22, 0), (0, -24), (-18, 16))
"""Turns of a board about x and y at each distance [deg]: without tilted boards no distance is determined. About z it
turns by 3, 8, 13 and 18, to either side from one to the next, as some programs mind the side."""
_SENSOR_MM = 0.05
"""Tolerance of the sensor's distance, where a stage says that and not what is in focus [mm]."""
FLAWS = {
    "designed": "as designed",
    "tilted": "array turned by 0.2 degrees about x",
    "square": "square lattice, of microlenses of the middle type",
    "mismatched": "stop 0.7 as wide: the pupil, not the microlens, bounds what is blurred",
    "vignetted": "first surface of the lens half as large",
    "noisy": "images with the noise of a sensor that collects 1,000 electrons of white",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Rig:
    """A plenoptic camera, and the board that it is calibrated with; lenses are stages of the library."""

    name: str
    what: str
    lens: str
    stop_mm: float  # semi-diameter
    gap_mm: float  # from microlenses to sensor
    pitch_mm: float
    focal_mm: tuple[float, ...]  # of each type of microlenses
    array_mm: tuple[float, float]  # width and height
    size_px: tuple[int, int]
    pixel_mm: float
    distances_mm: tuple[float, ...]  # of the boards, from the stop
    square_mm: float
    f_numbers: tuple[float, ...]  # of further white images, from which libpleno learns
    focus_mm: float | None = None  # distance from the stop in focus behind microlenses of the middle type, or
    sensor_mm: float | None = None  # place of the sensor: the lens images 500 mm onto microlenses that see infinity
    planes_mm: tuple[float, float] | None = None  # near and far plane, where focus says none
    layout: str = "hexagonal"
    tilt_deg: tuple[float, float] | None = None  # of the array
    first_mm: float | None = None  # semi-diameter of the first surface, if it is not the lens's
    electrons: float | None = None  # of the brightest white pixel, if images have the noise of a sensor


RIGS = tuple(Rig(**row) for row in tomllib.loads(Path(__file__).with_name("rigs.toml").read_text())["rig"])


def with_flaw(rig: Rig, flaw: str) -> Rig:
    """The rig with a flaw of `FLAWS`."""
    changes = {
        "designed": {},
        "tilted": {"tilt_deg": (0.2, 0.0)},
        "square": {"layout": "square", "focal_mm": [sorted(rig.focal_mm)[len(rig.focal_mm) // 2]]},
        "mismatched": {"stop_mm": 0.7 * rig.stop_mm},
        "vignetted": {"first_mm": 1.3 * rig.stop_mm},
        "noisy": {"electrons": 1000.0},
    }
    return replace(rig, **changes[flaw])


def small(rig: Rig) -> Rig:
    """The rig with a sensor and an array half as wide and high, so that all is done in minutes."""
    (width_px, height_px), (width_mm, height_mm) = rig.size_px, rig.array_mm
    return replace(
        rig,
        name=f"{rig.name} small",
        what=f"{rig.what}; a quarter of its sensor",
        size_px=(width_px // 2, height_px // 2),
        array_mm=(width_mm / 2, height_mm / 2),
    )


def write_stage(rig: Rig, place: Path) -> None:
    """Write the USD stage of all boards before a rig: four at each distance."""
    stage = opened(HERE / "plenoptic/dataset.usda")
    stage.GetPrimAtPath("/Arena/Rig/Lens").GetReferences().AddReference(f"lenses/{rig.lens}.usda")
    near_mm, far_mm = rig.planes_mm or (None, None)
    camera = {"near": near_mm, "far": far_mm, "microlensDistance": rig.gap_mm}
    camera |= {"focusDistance": rig.focus_mm, "sensorDistance": rig.sensor_mm}
    array = {"pitch": rig.pitch_mm, "focalLengths": rig.focal_mm, "layout": rig.layout, "tilt": rig.tilt_deg}
    array |= {"width": rig.array_mm[0], "height": rig.array_mm[1]}
    values = {
        "Rig/Camera": {f"camera:{name}": value for name, value in camera.items()} | {"image:fNumbers": rig.f_numbers},
        "Rig/Microlenses": array,
        "Rig/Sensor": {"pixelPitch": rig.pixel_mm, "resolution": Gf.Vec2i(*rig.size_px)},
        "Rig/Lens/S1": {"semiDiameter": rig.first_mm},
        "Rig/Lens/Stop": {"semiDiameter": rig.stop_mm},
        "Board": {"squareSize": rig.square_mm},
    }
    with_values(stage, values)
    if rig.sensor_mm is not None:
        focus = stage.GetPrimAtPath("/Arena/Made/Focus")
        focus.GetRelationship("plen:tolerance:of").SetTargets(["/Arena/Rig/Camera.plen:camera:sensorDistance"])
        focus.GetAttribute("plen:tolerance:spread").Set(_SENSOR_MM)
    pairs = [(distance, number) for distance in rig.distances_mm for number in range(len(_TURNS_DEG))]
    sides = [(-1) ** (number + position // len(_TURNS_DEG)) for position, (_, number) in enumerate(pairs)]
    turns = [
        Rotation.from_euler("xyz", [*_TURNS_DEG[n], side * (3 + 5 * n)], degrees=True)
        for side, (_, n) in zip(sides, pairs, strict=True)
    ]
    places = [[0.012 * z * (-1) ** n, 0.012 * z * (0.8 * (-1) ** (n // 2)), -z] for z, n in pairs]
    pose(stage, "/Arena/Board", np.array(places), turns)
    stage.GetRootLayer().Export(str(place))
