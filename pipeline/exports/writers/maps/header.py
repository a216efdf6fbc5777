"""Attributes of EXR files with a value per pixel."""

from pipeline.exports.cameras import ExportCamera
from pipeline.exports.material import Material

Attributes = dict[str, str | float | int]


def about(material: Material, camera: ExportCamera) -> Attributes:
    """Remarks line by line, and the positions of the first and of the last pixel as the format counts them."""
    found: Attributes = {f"remark{number}": line for number, line in enumerate(material.remarks)}
    (first_x, first_y), (last_x, last_y) = camera.rays.ends.tolist()
    return found | {"first_x": first_x, "first_y": first_y, "last_x": last_x, "last_y": last_y}
