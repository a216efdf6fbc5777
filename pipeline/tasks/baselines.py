"""Task `baselines`: relative poses of the cameras of a dataset in every frame, from pinhole to pinhole."""

from itertools import combinations
from pathlib import Path

import numpy as np

from pipeline.files.tables import write_table
from pipeline.frames import inverse, rotation_vector
from pipeline.tasks.artefacts.cameras import Inputs, pinhole_of
from pipeline.tasks.frame_poses import pinhole_from_camera
from pipeline.tasks.params.truth import BASELINES, RigFrame
from pipeline.tasks.params.truth import Baselines as Params

HEADER = (
    "two cameras in a frame: point in the second = R(rvec) point in the first + t, axes x right, y down, z forward",
    "pinhole: between the pinholes of camera.json, R and T as OpenCV's stereoCalibrate defines them; mm, rvec in rad",
    "stop: between the centres of the aperture stops, the origins of the vision frames; rvec is the same",
    "baseline: distance of the two centres, mm; empty where a camera has no pinhole",
)
_COLUMNS = ("frame", "camera", "second_camera", "pinhole_baseline_mm", "stop_baseline_mm")
_VECTORS = ("rvec", "pinhole_t", "stop_t")


def run(params: Params, inputs: Inputs, out: Path) -> None:
    """Write baselines.csv; pinholes of the cameras, in their order, are the inputs `pinhole0`, …"""
    to_pinhole = []
    for i in range(len(params.cameras)):
        pinhole = pinhole_of(inputs, f"pinhole{i}")
        to_pinhole.append(np.full((4, 4), np.nan) if pinhole is None else pinhole_from_camera(pinhole))
    rows = [
        (frame.number, params.cameras[i], params.cameras[j], *_between(frame, to_pinhole, i, j))
        for frame in params.frames
        for i, j in combinations(range(len(to_pinhole)), 2)
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
