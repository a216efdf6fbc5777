"""OpenCV 5: the arguments of `calibrateMultiview`.

Lengths are metres: OpenCV divides points by the square of their extent, and takes boards of 100 mm for collinear.
"""

from pathlib import Path

import numpy as np

from pipeline.exports.material import Material
from pipeline.files.npy import write_npz
from pipeline.formats import Board, Cameras, Centre, ExportError, Format, Origin, Pose, Rotation, Targets, Unit

FORMAT = Format(
    consumer="calibrateMultiview of OpenCV 5",
    source="run: cv2 5.0.0",
    cameras=Cameras.CONVENTIONAL,
    least_cameras=2,
    targets=Targets.ONE,
    files=("multiview.npz",),
    origin=Origin.ZERO,
    board=Board.RIGHT_DOWN,
    pose=Pose.CAMERA_FROM_FIRST,
    centre=Centre.FITTED_TO_ROWS,
    rotation=Rotation.VECTOR,
    unit=Unit.M,
)

_MISSED = -1
"""Coordinate of a point without an observation, in arrays that have room for all points; a mask leaves its view out."""


def write(material: Material, folder: Path) -> None:
    """Write the arguments by their names, and the true Ks, distortions, Rs and Ts."""
    target, cameras = material.only_target, material.cameras
    if len(cameras) == 1:
        raise ExportError("opencv-multiview relates cameras to each other, and there is one", hint="opencv takes it")
    frames = sorted({view.frame for view in material.views})
    positions = np.full((len(cameras), len(frames), len(target.points), 2), _MISSED, np.float32)
    for row, camera in zip(positions, cameras, strict=True):
        for view in material.of(camera):
            row[frames.index(view.frame)][view.observations.ids] = view.observations.positions
    poses = [camera.pose for camera in cameras if camera.pose]
    distortions = [camera.model.distortion for camera in cameras]
    count = max(map(len, distortions))  # of one whose sensor is tilted 14, of others 5
    arguments = {
        "objPoints": np.repeat(target.points[None].astype(np.float32), len(frames), axis=0),
        "imagePoints": positions,
        "imageSize": np.array([camera.size_px for camera in cameras]),
        "detectionMask": (positions[..., 0] != _MISSED).all(axis=2).astype(np.uint8),
        "models": np.zeros((len(cameras), 1), np.uint8),  # CALIB_MODEL_PINHOLE
        "cameras": np.array([camera.name for camera in cameras], dtype=str),
        "frames": np.array(frames, dtype=np.int64),
        "Ks": np.stack([camera.model.matrix for camera in cameras]),
        "distortions": np.stack([np.pad(coefficients, (0, count - len(coefficients))) for coefficients in distortions]),
        "Rs": np.stack([pose.rotation for pose in poses]),
        "Ts": np.stack([pose.translation for pose in poses]),
    }
    write_npz(folder / "multiview.npz", material.remarks, arguments)
