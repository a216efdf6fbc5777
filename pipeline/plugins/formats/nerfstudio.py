"""nerfstudio: transforms.json of all images. The target is the world, so that it may move before a stationary camera.

Paths of images are those below the output folder of the build, into which the file is to be copied. nerfstudio has no
shutter: further keys of frames are for gsplat, which takes arrays.
"""

from pathlib import Path

from pipeline.exports.material import ExportCamera, ExportView, Material
from pipeline.files.jsonfile import Json, write_json
from pipeline.formats import (
    Board,
    CameraAxes,
    Cameras,
    Centre,
    ExportError,
    Format,
    Origin,
    Pose,
    Reads,
    Rotation,
    Targets,
    Unit,
)

FORMAT = Format(
    consumer="nerfstudio and programs that read its transforms.json; gsplat",
    note="the world is the target; OPENCV or OPENCV_FISHEYE",
    source="proof: nerfstudio 1.1.5 sends the rays, and nerfstudio-project/gsplat 90d7b4b projects by shutters",
    cameras=Cameras.CONVENTIONAL,
    targets=Targets.ONE,
    reads=frozenset({Reads.CORNERS, Reads.RAYS}),
    files=("transforms.json",),
    origin=Origin.HALF,
    board=Board.OURS,
    pose=Pose.TARGET_FROM_CAMERA,
    centre=Centre.CENTRAL,
    rotation=Rotation.MATRIX,
    camera_axes=CameraAxes.OPENGL,
    unit=Unit.M,
    models=("fisheye",),
)

_MODELS = {"brown": "OPENCV", "fisheye": "OPENCV_FISHEYE"}
"""Model name here -> camera_model."""


def write(material: Material, folder: Path) -> None:
    """Write one file: intrinsics and pose of each image."""
    assert material.only_target
    cameras = {camera.name: camera for camera in material.cameras}
    models = {_MODELS[camera.image_model.name] for camera in material.cameras}
    if len(models) > 1:
        message = "transforms.json has one camera_model, and these cameras are OPENCV and OPENCV_FISHEYE"
        raise ExportError(message, hint="choose some with --only; export.json of ros says which is which")
    frames = [
        {"file_path": view.image, **_intrinsics(cameras[view.camera]), **_poses(cameras[view.camera], view)}
        for view in material.views
    ]
    write_json(
        folder / "transforms.json", {"about": list(material.remarks), "camera_model": models.pop(), "frames": frames}
    )


def _intrinsics(camera: ExportCamera) -> Json:
    model = camera.image_model
    width, height = camera.size_px
    fx, fy = model.focal_px.tolist()
    cx, cy = model.principal_point_px.tolist()
    names = ("k1", "k2", "k3", "k4") if model.name == "fisheye" else ("k1", "k2", "p1", "p2", "k3")
    distortion = dict.fromkeys(("k1", "k2", "k3", "k4", "p1", "p2"), 0.0)
    distortion |= dict(zip(names, model.coefficients.tolist(), strict=True))
    return {"w": width, "h": height, "fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy, **distortion}


def _poses(camera: ExportCamera, view: ExportView) -> Json:
    """The pose at the time code; with a shutter also its type, and the poses of the first line and of the last."""
    assert view.pose is not None
    poses: Json = {"transform_matrix": view.pose.matrix}
    if view.at_lines:
        first, last = view.at_lines
        poses |= {"shutter_type": camera.shutter_type}
        poses |= {"transform_matrix_start": first.matrix, "transform_matrix_end": last.matrix}
    return poses
