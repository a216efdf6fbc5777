"""Task `frame_poses`: poses.json of a camera in all frames, each pose to the stop and to the equivalent pinhole."""

from pathlib import Path

import numpy as np

from pipeline.camera.figures.equivalent_pinhole import Pinhole
from pipeline.files.jsonfile import Json, write_json
from pipeline.frames import inverse, rigid, rotation_vector
from pipeline.tasks.artefacts.cameras import Inputs, pinhole_of
from pipeline.tasks.params.truth import FramePoses as Params
from pipeline.tasks.params.truth import PosedFrame, poses_file

CONVENTIONS = {
    "transforms": "a_from_b acts on column vectors, mm",
    "camera": "vision frame, that of all rays: x right, y down, z forward, origin at the centre of the aperture stop",
    "pinhole": "the same axes, origin at the centre of projection of the pinhole of camera.json; rvec (rad) and tvec"
    " (mm) are OpenCV's and go with that pinhole's principal distance",
    "target": "x right, y up, z towards the viewer, origin at the pattern centre",
}


def run(params: Params, inputs: Inputs, out: Path) -> None:
    """Write a file for each frame."""
    pinhole = pinhole_of(inputs)
    for frame in params.frames:
        write_json(out / poses_file(frame.number), poses(params.camera, frame, pinhole))


def poses(camera: str, frame: PosedFrame, pinhole: Pinhole | None) -> Json:
    """The content of poses.json."""
    camera_from_world = np.array(frame.camera_from_world)
    targets: dict[str, Json] = {
        name: {"camera_from_target": pose, "pinhole": None} for name, pose in frame.targets.items()
    }
    content = {
        "conventions": CONVENTIONS,
        "frame": frame.number,
        "camera": camera,
        "camera_from_world": camera_from_world,
        "pinhole": None,
        "targets": targets,
    }
    if pinhole is None:
        return content
    pinhole_from_world = pinhole_from_camera(pinhole) @ camera_from_world
    world_from_pinhole = inverse(pinhole_from_world)
    content["pinhole"] = {
        "pinhole_from_world": pinhole_from_world + 0.0,  # no -0.0
        "world_from_pinhole": world_from_pinhole + 0.0,
    }
    for target in targets.values():
        pinhole_from_target = pinhole_from_camera(pinhole) @ np.array(target["camera_from_target"])
        target["pinhole"] = {
            "pinhole_from_target": pinhole_from_target + 0.0,
            "rvec": rotation_vector(pinhole_from_target) + 0.0,
            "tvec": pinhole_from_target[:3, 3] + 0.0,
        }
    return content


def pinhole_from_camera(pinhole: Pinhole) -> np.ndarray:
    """Transform from the vision frame to the same axes about the centre of projection, (4, 4)."""
    return rigid(np.eye(3), -np.array(pinhole.centre_mm))
