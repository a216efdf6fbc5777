"""Files that say where everything stands: poses.json per frame and camera, and one JSON per target."""

from typing import Any

import numpy as np

from pipeline.files.jsonfile import json_bytes
from pipeline.frames import rotation_vector
from pipeline.records import to_plain
from pipeline.scene.dataset import Frame, TargetEntry


def vision_from_target(frame: Frame, camera: str, target: str) -> np.ndarray:
    """Pose of a target in a camera's vision frame, (4, 4) [mm]."""
    return np.array(frame.camera_from_world[camera]) @ np.array(frame.world_from_target[target])


def poses_json(frame: Frame, camera: str, poses: dict[str, np.ndarray]) -> bytes:
    """The content of poses.json."""
    return json_bytes(
        {
            "conventions": "a_from_b acts on column vectors; camera: vision frame, x right, y down, z forward,"
            " origin at the aperture stop; target: x right, y up, z towards the viewer; mm, rad",
            "frame": frame.number,
            "camera": camera,
            "camera_from_world": frame.camera_from_world[camera],
            "targets": {name: _pose(pose) for name, pose in poses.items()},
        }
    )


def _pose(camera_from_target: np.ndarray) -> dict[str, Any]:
    return {
        "camera_from_target": to_plain(camera_from_target.tolist()),
        "rvec": to_plain(rotation_vector(camera_from_target).tolist()),
        "tvec": to_plain(camera_from_target[:3, 3].tolist()),
    }


def targets_json(entry: TargetEntry) -> bytes:
    """The content of targets/<target>.json; a flat board's actual coordinates are its nominal ones."""
    points = [
        {"id": index, "nominal_mm": point, "actual_mm": point}
        for index, point in enumerate(to_plain(entry.target.points_mm().tolist()))
    ]
    return json_bytes(
        {
            "kind": "checkerboard",
            "frame": "target frame: origin at the pattern centre, x right, y up, z towards the viewer, mm",
            "order": "id = row * columns + column, row 0 at the top, column 0 at the left as the viewer sees it",
            "parameters": to_plain(entry.target),
            "points": points,
        }
    )
