"""Tasks `frame_poses` and `baselines`: where cameras and targets are in all frames, and cameras to each other."""

from itertools import combinations
from pathlib import Path

import numpy as np

from pipeline.camera.figures.equivalent_pinhole import Pinhole
from pipeline.files.jsonfile import Json, write_json
from pipeline.files.tables import write_table
from pipeline.frames import inverse, rigid, rotation_vector
from pipeline.products.cameras import Inputs, pinhole_of
from pipeline.products.poses.params import BASELINES, Baselines, FramePoses, PosedFrame, RigFrame, poses_file

CONVENTIONS = {
    "transforms": "a_from_b acts on column vectors, mm",
    "camera": "vision frame, that of all rays: x right, y down, z forward, origin at the centre of the aperture stop",
    "pinhole": "the same axes, origin at the centre of projection of the pinhole of camera.json; rvec (rad) and tvec"
    " (mm) are OpenCV's and go with that pinhole's principal distance",
    "target": "x right, y up, z towards the viewer, origin at the pattern centre",
}


def frame_poses(params: FramePoses, inputs: Inputs, out: Path) -> None:
    """Poses of a camera in each frame, to the stop and to the equivalent pinhole: a poses.json for each."""
    pinhole = pinhole_of(inputs)
    for frame in params.frames:
        write_json(out / poses_file(frame.number), poses(params.camera, frame, pinhole))


def poses(camera: str, frame: PosedFrame, pinhole: Pinhole | None) -> Json:
    """Content of poses.json: a camera and all targets in a frame; no pinhole, and no poses by it, where none can be
    fitted.
    """
    camera_from_world = np.array(frame.camera_from_world)
    targets: dict[str, Json] = {
        name: {"camera_from_target": pose, "pinhole": None} for name, pose in frame.targets.items()
    }
    for name, (first, last) in frame.at_lines.items():
        targets[name]["camera_from_target_at_lines"] = {"first": first, "last": last}
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


HEADER = (
    "two cameras in a frame: point in the second = R(rvec) point in the first + t, axes x right, y down, z forward",
    "pinhole: between the pinholes of camera.json, R and T as OpenCV's stereoCalibrate defines them; mm, rvec in rad",
    "stop: between the centres of the aperture stops, the origins of the vision frames; rvec is the same",
    "baseline: distance of the two centres, mm; empty where a camera has no pinhole",
)
_COLUMNS = ("frame", "camera", "second_camera", "pinhole_baseline_mm", "stop_baseline_mm")
_VECTORS = ("rvec", "pinhole_t", "stop_t")


def baselines(params: Baselines, inputs: Inputs, out: Path) -> None:
    """Write baselines.csv; pinholes of the cameras, in their order, are the inputs `pinhole0`, …"""
    to_pinhole = []
    for i in range(len(params.cameras)):
        pinhole = pinhole_of(inputs, f"pinhole{i}")
        to_pinhole.append(np.full((4, 4), np.nan) if pinhole is None else pinhole_from_camera(pinhole))
    rows = [
        (frame.number, params.cameras[i], params.cameras[j], *_between(frame, to_pinhole, i, j))
        for frame in params.frames
        for i, j in combinations(range(len(to_pinhole)), 2)
        if frame.camera_from_world[i] and frame.camera_from_world[j]
    ]
    vectors = [f"{vector}_{axis}_{'rad' if vector == 'rvec' else 'mm'}" for vector in _VECTORS for axis in "xyz"]
    columns = dict(zip((*_COLUMNS, *vectors), map(list, zip(*rows, strict=True)), strict=True))
    write_table(out / BASELINES, HEADER, columns)


def _between(frame: RigFrame, to_pinhole: list[np.ndarray], i: int, j: int) -> tuple[float, ...]:
    """Both baselines, then rvec and both translations of the second camera from the first."""
    first, second = (np.array(frame.camera_from_world[n]) for n in (i, j))
    stop = second @ inverse(first)
    pinhole = to_pinhole[j] @ stop @ inverse(to_pinhole[i])
    lengths = [float(np.linalg.norm(pose[:3, 3])) for pose in (pinhole, stop)]
    vectors = np.concatenate([rotation_vector(stop), pinhole[:3, 3], stop[:3, 3]]) + 0.0
    return *lengths, *vectors.tolist()
