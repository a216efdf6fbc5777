"""The conditions of the arena as USD stages: one rig, varied by overlays, before three boards and for calibrations."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

HERE = Path(__file__).resolve().parent
BOARDS = ("checkerboard", "charuco", "aprilgrid")
ACROSS = 8
"""Inner corners of a row and of a column: mrgingham finds square grids only."""
_PIXELS_PER_UNIT, _PUPIL_MM = 720.0, 10.0
"""Principal distance [px] and place of the entrance pupil [mm]: near enough to place boards where they are wanted."""
_STOP_F8_MM = 2.27151054
_TAG_SQUARES, _MARKER_SQUARES = 9 / 4.9, 0.75
"""Sides of an AprilTag, four of which with gaps of 0.3 are as long as nine squares; of a ChArUco marker [squares]."""
SURFACES = ("S1", "S2", "S3", "S4", "S5", "S6", "S7", "S8", "Stop", *(f"S{n}" for n in range(10, 18)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """Circumstances under which detectors look at a board.

    Attributes
    ----------
    name, what : str
    f_number : float
    distance_mm : float
        From the stop.
    tilt_deg : float
    square_px : float
        Side of a square in the middle of the image, about.
    centres_px : tuple of (float, float)
        Where the middle of the board is imaged, about: one view each.
    electrons : float
        Of a white pixel.
    like : str
        Condition whose rendered images are taken; empty: its own.
    """

    name: str
    what: str
    f_number: float = 8.0
    distance_mm: float = 500.0
    tilt_deg: float = 15.0
    square_px: float = 24.0
    centres_px: tuple[tuple[float, float], ...] = ((323.3, 241.1), (430.4, 172.7))
    electrons: float = 20_000.0
    like: str = ""


_MIDDLE = ((323.3, 241.1),)
"""One view near the middle of the image [px]; no corner lies on the middle of a pixel in it."""
CONDITIONS = (
    Condition(name="sharp", what="in focus, squares of 24 px, tilted by 15 degrees"),
    Condition(name="blur", what="f/2.8, 430 instead of 500 mm away", f_number=2.8, distance_mm=430.0),
    Condition(name="noise", what="as sharp, 1,000 electrons", electrons=1_000.0, like="sharp"),
    Condition(name="more noise", what="as sharp, 150 electrons", electrons=150.0, like="sharp"),
    Condition(name="tilt", what="tilted by 60 degrees", tilt_deg=60.0, square_px=28.0, centres_px=_MIDDLE),
    Condition(
        name="corner",
        what="f/2.8 in a corner of the image: vignetting and coma",
        f_number=2.8,
        square_px=20.0,
        centres_px=((512.3, 352.6),),
    ),
    Condition(name="near", what="300 mm away", distance_mm=300.0, centres_px=_MIDDLE),
    Condition(name="far", what="1.5 m away", distance_mm=1500.0, centres_px=_MIDDLE),
    Condition(name="small", what="squares of 9 px", square_px=9.0, centres_px=_MIDDLE),
)
"""Defocus, noise, tilt, vignetting, distance and size of the board, one after the other."""

_HEAD = """#usda 1.0
(
    defaultPrim = "Arena"
    endTimeCode = {frames}
    metersPerUnit = 0.001
    startTimeCode = 1
    timeCodesPerSecond = 24
    upAxis = "Y"
)
"""
_DATASET = """
def PlenDataset "Arena"
{{
    rel plen:cameras = </Arena/Rig/Camera>
    rel plen:occluders = [{occluders}]
    uniform double plen:background = 0.3
    uniform int plen:seed = 6
    rel plen:targets = </Arena/Board>

    def "Rig" (
        prepend references = @{here}/rig.usda@
    )
    {{
        over "Camera"
        {{
            uniform token[] plen:truth:columns = ["chief", "saddle"]
        }}

        over "Lens"
        {{
            over "Stop"
            {{
                uniform double plen:semiDiameter = {stop_mm}
            }}
        }}
    }}

    def {kind} "Board"
    {{
        uniform double plen:black = 0.05
{size}
{poses}
    }}
{card}}}
"""
_CARD = """
    def Mesh "Card" (
        prepend apiSchemas = ["PlenOccluderAPI"]
    )
    {{
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [
            ({left}, {low}, 0.01),
            ({right}, {low}, 0.01),
            ({right}, {high}, 0.01),
            ({left}, {high}, 0.01),
        ]
        uniform double plen:radiance = 1
{poses}
    }}
"""


def stage_text(condition: Condition, board: str) -> str:
    """USD stage of a board under a condition.

    A checkerboard of 8 x 8 corners looks the same upside down, and a build refuses it: so it has a ninth column,
    which a white card hides.
    """
    square = condition.square_px * (condition.distance_mm - _PUPIL_MM) / _PIXELS_PER_UNIT
    kind, size = {
        "checkerboard": ("PlenCheckerboard", {"int plen:columns": ACROSS + 1, "int plen:rows": ACROSS}),
        "charuco": ("PlenCharuco", {"int plen:columns": ACROSS, "int plen:rows": ACROSS}),
        "aprilgrid": ("PlenAprilGrid", {"int plen:columns": 4, "int plen:rows": 4, "int plen:borderBits": 1}),
    }[board]
    if board == "aprilgrid":
        size |= {"double plen:tagSize": square * _TAG_SQUARES, "double plen:tagSpacing": 0.3}
    else:
        size |= {"double plen:squareSize": square}
    if board == "charuco":
        size |= {"double plen:markerSize": square * _MARKER_SQUARES, "token plen:dictionary": '"5x5_50"'}
    poses, hides = _poses(condition), board == "checkerboard"
    half = (ACROSS + 2) / 2 * square
    card = _CARD.format(left=ACROSS / 2 * square, right=half + square, low=-half, high=half, poses=poses)
    text = _DATASET.format(
        occluders="</Arena/Card>" if hides else "",
        here=HERE.as_posix(),
        stop_mm=_STOP_F8_MM * 8 / condition.f_number,
        kind=kind,
        size="\n".join(f"        uniform {name} = {value}" for name, value in size.items()),
        poses=poses,
        card=card if hides else "",
    )
    text = text if hides else text.replace("    rel plen:occluders = []\n", "")
    return _HEAD.format(frames=len(condition.centres_px)) + text


def _poses(condition: Condition) -> str:
    turns, shifts = [], []
    for number, (x, y) in enumerate(condition.centres_px):
        depth = condition.distance_mm - _PUPIL_MM
        right, up = (x - 319.5) / _PIXELS_PER_UNIT * depth, -(y - 239.5) / _PIXELS_PER_UNIT * depth
        axis = np.array([0.0, 1.0, 0.0]) if number == 0 else np.array([0.8, -0.6, 0.0])
        turn = Rotation.from_rotvec(np.radians(condition.tilt_deg) * axis) * Rotation.from_euler(
            "z", 4 + 7 * number, True
        )
        i, j, k, real = turn.as_quat().tolist()
        turns.append(f"            {number + 1}: ({real}, {i}, {j}, {k}),")
        shifts.append(f"            {number + 1}: ({right}, {up}, {-condition.distance_mm}),")
    return "\n".join(
        (
            "        quatd xformOp:orient.timeSamples = {",
            *turns,
            "        }",
            "        double3 xformOp:translate.timeSamples = {",
            *shifts,
            "        }",
            '        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:orient"]',
        )
    )


VIEWS = 16
"""Boards of calibration.usda."""
CALIBRATION_CAMERAS = {
    "f8": "",
    "f2.8": f"""
            over "Stop"
            {{
                uniform double plen:semiDiameter = {_STOP_F8_MM * 8 / 2.8}
            }}""",
    "tilted": f"""
            def PlenLensGroup "All"
            {{
                uniform token[] plen:surfaces = [{", ".join(f'"{name}"' for name in SURFACES)}]
                uniform double plen:pivot = 30
                uniform double2 plen:tilt = (3, -2)
            }}""",
}
"""What a calibration's camera has instead of the arena's: a wide stop, or a lens tilted against the sensor."""


def calibration_text(camera: str) -> str:
    """USD stage of the calibration's boards before one of the cameras: a layer over calibration.usda."""
    head = (
        _HEAD.format(frames=VIEWS)
        .replace('"Arena"', '"Calibration"')
        .replace("    metersPerUnit", f"    subLayers = [@{HERE.as_posix()}/calibration.usda@]\n    metersPerUnit")
    )
    lens = CALIBRATION_CAMERAS[camera]
    body = f'        over "Lens"\n        {{{lens}\n        }}\n' if lens else ""
    return f'{head}\nover "Calibration"\n{{\n    over "Rig"\n    {{\n{body}    }}\n}}\n'
