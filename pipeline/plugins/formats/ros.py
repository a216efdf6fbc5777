"""ROS: sensor_msgs/CameraInfo of each camera as YAML for camera_calibration_parsers and camera_info_manager.

The projection matrix is the camera matrix: rectified images keep its scale, and no camera is the second of a pair.
"""

import re
from collections.abc import Iterator
from pathlib import Path

from pipeline.exports.material import ExportCamera, Material
from pipeline.formats import Cameras, Centre, Format, Origin, Reads
from pipeline.plugins.formats.filestorage import yaml_real

FORMAT = Format(
    consumer="ROS and ROS 2: camera_info_manager, image_proc",
    note="sensor_msgs/CameraInfo: plumb_bob, equidistant or rational_polynomial",
    source="read: ros-perception/image_common 00bed63, parse_yml.cpp; run: PyYAML 6",
    cameras=Cameras.CONVENTIONAL,
    reads=frozenset({Reads.RAYS}),
    files=("<camera>.yaml",),
    origin=Origin.ZERO,
    centre=Centre.CENTRAL,
    models=("fisheye", "rational"),
)

_MODELS = {"brown": "plumb_bob", "fisheye": "equidistant", "rational": "rational_polynomial"}
"""Model name here -> name in sensor_msgs, whose coefficients have the same order."""


def write(material: Material, folder: Path) -> None:
    """Write a file per camera."""
    for camera in material.cameras:
        material.write_text(folder / f"{camera.name}.yaml", _info(camera))


def _info(camera: ExportCamera) -> Iterator[str]:
    """CameraInfo of a camera as YAML."""
    model = camera.image_model
    width, height = camera.size_px
    fx, fy = model.focal_px.tolist()
    cx, cy = model.principal_point_px.tolist()
    yield f"# residual of the rays of the image: {model.rms_px:.3g} px rms, {model.max_px:.3g} px at most"
    yield from (f"image_width: {width}", f"image_height: {height}")
    yield f"camera_name: {re.sub('[^A-Za-z0-9_]', '_', camera.name)}"
    yield from _matrix("camera_matrix", 3, [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0])
    yield f"distortion_model: {_MODELS[model.name]}"
    yield from _matrix("distortion_coefficients", 1, model.coefficients.tolist())
    yield from _matrix("rectification_matrix", 3, [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
    yield from _matrix("projection_matrix", 3, [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0])


def _matrix(name: str, rows: int, numbers: list[float]) -> Iterator[str]:
    yield from (f"{name}:", f"  rows: {rows}", f"  cols: {len(numbers) // rows}")
    yield f"  data: [{', '.join(map(yaml_real, numbers))}]"
