"""Output folders as a build writes them, of cameras that are pinholes: every image position is known in closed form."""

import hashlib
import json
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from pipeline.files.tables import write_table
from pipeline.frames import inverse, rigid, rotation_vector

COLUMNS, ROWS, SQUARE_MM = 4, 3, 10.0
SIZE_PX, F_PX, CENTRE_PX = (640, 480), 1000.0, np.array([300.25, 200.75])
MATRIX = np.array([[F_PX, 0, CENTRE_PX[0]], [0, F_PX, CENTRE_PX[1]], [0, 0, 1]])
STOP_MM = np.array([0.0, 0.0, -6.0])
"""Centre of projection in the vision frame, whose origin is the centre of the stop."""
DISTORTION = np.array([0.1, -0.05, 0.001, -0.002, 0.01])
CORNER_PX = np.array([10.0, 7.0])
"""The pixel on whose centre the left camera sees point 0 in frame 1."""
HIDDEN = {("Left", 2, 3), ("Left", 2, 5), ("Right", 2, 0)}
"""Camera, frame and id of points that have no row."""
DIM = {("Right", 3, 4): 0.3, ("Right", 3, 5): 0.7}
"""Visibility of points that are hidden in part."""


def same(found, expected, atol: float) -> None:
    np.testing.assert_allclose(np.asarray(found, float), np.asarray(expected, float), rtol=0, atol=atol)


def board_mm(square_mm: float = SQUARE_MM) -> np.ndarray:
    """Points in the target frame: the middle is the origin, x right, y up; row 0 at the top."""
    row, column = np.divmod(np.arange(COLUMNS * ROWS), COLUMNS)
    x, y = (column - (COLUMNS - 1) / 2) * square_mm, ((ROWS - 1) / 2 - row) * square_mm
    return np.stack([x, y, np.zeros(len(x))], axis=1)


def turned(*rvec: float) -> np.ndarray:
    return cv2.Rodrigues(np.array(rvec))[0]


FACING = np.diag([1.0, -1.0, -1.0])
"""A board that faces a camera: y of the target is up, of the camera down."""


def slopes_seen(pixels: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """The slopes that pixels (n, 2) see."""
    stop = (cv2.TERM_CRITERIA_COUNT, 200, 0)
    return cv2.undistortPoints(np.asarray(pixels, float)[:, None], matrix, DISTORTION, criteria=stop)[:, 0]


def projected(pose, points=None, matrix=MATRIX, distortion=DISTORTION) -> np.ndarray:
    """Where OpenCV sees points, by default those of the board, before a camera from whose frame they have a pose."""
    points = board_mm() if points is None else points
    return cv2.projectPoints(points, rotation_vector(pose), pose[:3, 3], matrix, distortion)[0][:, 0]


def _first_pose() -> np.ndarray:
    """The board faces the camera, and its point 0 is seen in the middle of a pixel."""
    place = np.append(slopes_seen(CORNER_PX[None], MATRIX) * 400.0, 400.0)
    return rigid(FACING, place - FACING @ board_mm()[0])


@dataclass(frozen=True)
class Scene:
    rig: dict = field(
        default_factory=lambda: {
            "Left": np.eye(4),
            "Right": rigid(turned(-0.03, -0.05, 0.02), np.array([60.0, 3.0, 5.0])),
            "Upper": rigid(turned(0.04, 0.03, -0.1), np.array([10.0, 40.0, -4.0])),
        }
    )
    """Camera -> its pose from the left one."""
    poses: dict = field(
        default_factory=lambda: {
            1: _first_pose(),
            2: rigid(turned(0.2, -0.35, 0.1) @ FACING, np.array([5.0, 8.0, 420.0])),
            3: rigid(turned(-0.3, 0.25, -0.2) @ FACING, np.array([-12.0, 4.0, 390.0])),
        }
    )
    matrix: np.ndarray = field(default_factory=MATRIX.copy)

    def camera_from_target(self, camera: str, frame: int) -> np.ndarray:
        return self.rig[camera] @ self.poses[frame]

    def pixels(self, camera: str, frame: int) -> np.ndarray:
        """Positions of all points, (n, 2), hidden or not: what OpenCV projects."""
        return projected(self.camera_from_target(camera, frame), matrix=self.matrix)

    def ids(self, camera: str, frame: int) -> list[int]:
        return [point for point in range(COLUMNS * ROWS) if (camera, frame, point) not in HIDDEN]


def write_build(folder: Path, scene: Scene) -> Path:
    """What a build would write; the stop stands 6 mm before the centre of projection."""
    for name in scene.rig:
        write_camera(folder / "cameras" / name, SIZE_PX, F_PX, CENTRE_PX, DISTORTION)
        for frame in scene.poses:
            _write_view(folder / f"frames/{frame:04d}/{name}", scene, name, frame)
    write_target(folder, SQUARE_MM)
    write_manifest(folder)
    return folder


def write_target(folder: Path, square_mm: float) -> None:
    (folder / "targets").mkdir()
    points = [
        {"id": i, "kind": "corner", "nominal_mm": p, "actual_mm": p, "normal": [0.0, 0.0, 1.0]}
        for i, p in enumerate(board_mm(square_mm).tolist())
    ]
    target = {"kind": "checkerboard", "surface": {"kind": "flat"}, "points": points}
    target["parameters"] = {"columns": COLUMNS, "rows": ROWS, "square_mm": square_mm}
    (folder / "targets/Board.json").write_text(json.dumps(target))


def write_manifest(folder: Path) -> None:
    entries = {
        path.relative_to(folder).as_posix(): {
            "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
            "size": path.stat().st_size,
        }
        for path in folder.rglob("*")
        if path.is_file() and path.name != "manifest.json"
    }
    manifest = {"format": 1, "stage": "pretended.usda </Pretended>", "tasks": {}, "files": entries}
    (folder / "manifest.json").write_text(json.dumps(manifest))


def write_camera(
    folder: Path, size_px: tuple[int, int], f_px: float, centre_px: np.ndarray, distortion: np.ndarray
) -> None:
    """Files of a camera whose centre of projection is 6 mm behind its stop."""
    folder.mkdir(parents=True)
    plain = {"principal_distance_px": f_px, "principal_point_px": centre_px.tolist()}
    plain["residual_px"] = {"rms": 0.0, "max": 0.0}
    pinhole = {"centre_mm": [0.0, 0.0, -6.0], **plain, "with_distortion": {**plain, "distortion": distortion.tolist()}}
    record = {
        "optical_axis_px": centre_px.tolist(),
        "resolution": list(size_px),
        "pixel_pitch_mm": 0.01,
        "near_far_mm": [360.0, 480.0],
        "sensor_distance_mm": 16.0,
        "lens": {"name": "Hole", "f_number": 8.0, "focus_distance_mm": 450.0},
        "pinhole": pinhole,
    }
    (folder / "camera.json").write_text(json.dumps(record))


def _write_view(folder: Path, scene: Scene, name: str, frame: int) -> None:
    world, ids = scene.rig[name] @ rigid(turned(0.1, 0.2, 0.3), np.ones(3)), scene.ids(name, frame)
    write_poses(folder, world, {"Board": scene.camera_from_target(name, frame)})
    visibility = [DIM.get((name, frame, point), 1.0) for point in ids]
    write_rows(folder, ids, scene.pixels(name, frame)[ids], visibility=visibility)


def write_poses(view: Path, world: np.ndarray, targets: dict[str, np.ndarray], centre_mm: np.ndarray = STOP_MM) -> None:
    """Poses of the world and of targets from a pinhole, and from the stop, from which its centre of projection is."""
    to_stop = rigid(np.eye(3), centre_mm)
    poses = {
        "camera_from_world": (to_stop @ world).tolist(),
        "pinhole": {"pinhole_from_world": world.tolist(), "world_from_pinhole": inverse(world).tolist()},
        "targets": {
            name: {"camera_from_target": (to_stop @ pose).tolist(), "pinhole": {"pinhole_from_target": pose.tolist()}}
            for name, pose in targets.items()
        },
    }
    view.mkdir(parents=True)
    (view / "poses.json").write_text(json.dumps(poses))


def write_rows(view: Path, ids, pixels: np.ndarray, **others) -> None:
    """Rows of the board in the view frames/FRAME/CAMERA; others replace what a pinhole says."""
    count = len(ids)
    columns = {"frame": [int(view.parent.name)] * count, "camera": [view.name] * count, "target": ["Board"] * count}
    columns |= {"point_id": ids, **{f"microlens_{column}": [""] * count for column in ("k", "l", "type")}}
    columns |= {"x_px": pixels[:, 0], "y_px": pixels[:, 1], "method": ["direct"] * count}
    columns |= {"visibility": [1.0] * count, "rho_px": [0.1] * count}
    write_table(view / "correspondences.csv", ["in closed form"], columns | others)
