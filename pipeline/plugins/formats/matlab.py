"""MATLAB: `cameraParameters` of each camera, as `toStruct` writes it, and inputs of `estimateCameraParameters`.

Points without an observation are NaN, as MATLAB's own detectors leave them.
"""

from pathlib import Path
from typing import Any

import numpy as np

from pipeline.exports.material import ExportCamera, ExportView, Material
from pipeline.formats import Board, Cameras, Centre, ExportError, Format, Origin, Pose, Rotation, Targets, Unit
from pipeline.frames import apply
from pipeline.plugins.formats.filestorage import write_mat

FORMAT = Format(
    consumer="MATLAB R2022b and later, Computer Vision Toolbox: cameraParameters",
    note="cameraParameters(cameraParams) makes the object; imagePoints, worldPoints, imageSize, frames lie beside it",
    source="proof: GNU Octave 7.3 loads the files. Read: the help and the properties of cameraParameters, R2024",
    cameras=Cameras.CONVENTIONAL,
    targets=Targets.ONE,
    files=("<camera>.mat",),
    origin=Origin.ONE,
    board=Board.RIGHT_DOWN,
    pose=Pose.CAMERA_FROM_TARGET,
    centre=Centre.FITTED_TO_ROWS,
    rotation=Rotation.VECTOR,
    unit=Unit.MM,
)


def write(material: Material, folder: Path) -> None:
    """Write a file per camera."""
    if not material.only_target.is_flat:
        raise ExportError(f"cameraParameters supports only flat targets, and {material.only_target.name} is bent")
    for camera in material.cameras:
        views = [view for view in material.of(camera) if len(view.observations.ids)]
        values = _calibration(material, camera, views)
        write_mat(folder / f"{camera.name}.mat", {**values, "remarks": list(material.remarks)})


def _calibration(material: Material, camera: ExportCamera, views: list[ExportView]) -> dict[str, Any]:
    """Variables of a camera: points (n, 2), their positions (n, 2, views), and the struct."""
    points = material.only_target.points
    model = camera.model
    size = np.array([camera.size_px[::-1]], float)
    x_px = np.full((len(points), 2, len(views)), np.nan)
    errors = x_px.copy()
    poses = [view.pose.numbers for view in views if view.pose]
    for number, view in enumerate(views):
        assert view.camera_from_target is not None
        ids = view.observations.ids
        x_px[ids, :, number] = view.observations.positions
        errors[ids, :, number] = model.projected(apply(view.camera_from_target, points[ids])) - x_px[ids, :, number]
    k1, k2, p1, p2, k3 = camera.brown
    parameters = {
        "RadialDistortion": [[k1, k2, k3]],
        "TangentialDistortion": [[p1, p2]],
        "ImageSize": size,
        "WorldPoints": points[:, :2],
        "WorldUnits": "mm",
        "EstimateSkew": np.array([[False]]),
        "NumRadialDistortionCoefficients": 3.0,
        "EstimateTangentialDistortion": np.array([[bool(p1 or p2)]]),
        "RotationVectors": np.array(poses).reshape(-1, 6)[:, :3],
        "TranslationVectors": np.array(poses).reshape(-1, 6)[:, 3:],
        "ReprojectionErrors": errors,
        "K": model.matrix,
        "DetectedKeypoints": np.isfinite(x_px[:, 0]),
    }
    frames = np.array([[view.frame] for view in views], float)
    inputs = {"imagePoints": x_px, "worldPoints": points[:, :2], "imageSize": size, "frames": frames}
    return {"cameraParams": parameters, **inputs}
