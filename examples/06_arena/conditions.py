"""The conditions of the arena as USD stages: one rig before three boards, and for calibrations."""

import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from stages import HERE, opened, pose, with_values

BOARDS = ("checkerboard", "charuco", "aprilgrid")
ACROSS = 8
"""Inner corners of a row and of a column: mrgingham finds square grids only."""
_PIXELS_PER_UNIT, _PUPIL_MM = 720.0, 10.0
"""Principal distance [px] and place of the entrance pupil [mm]: near enough to place boards where they are wanted."""
_STOP_F8_MM = 2.27151054
_TAG_SQUARES, _MARKER_SQUARES = 9 / 4.9, 0.75
"""Sides of an AprilTag, four of which with gaps of 0.3 are as long as nine squares; of a ChArUco marker [squares]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """Circumstances under which detectors look at a board; sizes and places in the image are about so."""

    name: str
    what: str
    f_number: float = 8.0
    distance_mm: float = 500.0  # from the stop
    tilt_deg: float = 15.0
    square_px: float = 24.0  # side of a square in the middle of the image
    centres_px: tuple[tuple[float, float], ...] = ((323.3, 241.1), (430.4, 172.7))  # of the board: one view each
    electrons: float = 20_000.0  # of a white pixel
    like: str = ""  # condition whose rendered images are taken; empty: its own

    @property
    def place(self) -> str:
        """Name of its folders and files."""
        return self.name.replace(" ", "_")


CONDITIONS = tuple(
    Condition(**row) for row in tomllib.loads((HERE / "conditions.toml").read_text(encoding="utf-8"))["condition"]
)


def write_stage(condition: Condition, board: str, place: Path) -> None:
    """Write the USD stage of a board under a condition."""
    stage, square = opened(HERE / "condition.usda"), condition.square_px * _depth_mm(condition) / _PIXELS_PER_UNIT
    stage.GetPrimAtPath("/Arena/Rig").GetReferences().AddReference(str(HERE / "rig.usda"))
    stage.GetPrimAtPath("/Arena").GetVariantSet("board").SetVariantSelection(board)
    size = {
        "checkerboard": {"squareSize": square},
        "charuco": {"squareSize": square, "markerSize": square * _MARKER_SQUARES},
        "aprilgrid": {"tagSize": square * _TAG_SQUARES},
    }[board]
    stop_mm = _STOP_F8_MM * 8 / condition.f_number
    with_values(stage, {"Rig/Lens/Stop": {"semiDiameter": stop_mm}, "Board": size})
    pose(stage, "/Arena/Board", *_poses(condition))
    if board == "checkerboard":
        left, half = ACROSS / 2 * square, (ACROSS + 2) / 2 * square
        corners = [(left, -half), (half + square, -half), (half + square, half), (left, half)]
        stage.GetPrimAtPath("/Arena/Card").GetAttribute("points").Set([(x, y, 0.01) for x, y in corners])
        pose(stage, "/Arena/Card", *_poses(condition))
    stage.GetRootLayer().Export(str(place))


def _depth_mm(condition: Condition) -> float:
    return condition.distance_mm - _PUPIL_MM


def _poses(condition: Condition) -> tuple[np.ndarray, list[Rotation]]:
    """Places of the middle of the board, and its turns, one per view."""
    x, y = np.array(condition.centres_px).T
    depth = _depth_mm(condition)
    right, up = (x - 319.5) / _PIXELS_PER_UNIT * depth, -(y - 239.5) / _PIXELS_PER_UNIT * depth
    axes = np.array([[0.0, 1.0, 0.0], [0.8, -0.6, 0.0]])[: len(x)]
    tilts = [Rotation.from_rotvec(np.radians(condition.tilt_deg) * axis) for axis in axes]
    turns = [tilt * Rotation.from_euler("z", 4 + 7 * number, True) for number, tilt in enumerate(tilts)]
    return np.stack([right, up, np.full(len(x), -condition.distance_mm)], axis=1), turns
