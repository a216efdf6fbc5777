"""lensboy: cameras as its `OpenCV.save` writes them. Corners have no file there: they are arrays in its interface."""

from pathlib import Path

from pipeline.exports.material import Material
from pipeline.files.jsonfile import write_json
from pipeline.formats import Cameras, Format, Origin

FORMAT = Format(
    consumer="lensboy: OpenCV.load",
    note="corners are arrays in its interface, as those of opencv",
    source="proof: lensboy 4.0.3 loads the camera and projects",
    cameras=Cameras.CONVENTIONAL,
    reads=frozenset(),
    files=("<camera>.json",),
    origin=Origin.ZERO,
)

_COEFFICIENTS = 14
"""Coefficients of OpenCV's longest model, in its order: ours come first."""


def write(material: Material, folder: Path) -> None:
    """Write a file per camera."""
    for camera in material.cameras:
        width, height = camera.size_px
        f = camera.model.principal_distance_px
        coefficients = camera.model.distortion.tolist()
        cx, cy = camera.model.principal_point_px.tolist()
        record = {
            "type": "opencv",
            "about": list(material.remarks),
            "image_width": width,
            "image_height": height,
            "fx": f,
            "fy": f,
            "cx": cx,
            "cy": cy,
            "distortion_coeffs": [*coefficients, *([0.0] * (_COEFFICIENTS - len(coefficients)))],
        }
        write_json(folder / f"{camera.name}.json", record)
