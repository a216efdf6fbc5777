"""LFToolbox (MATLAB): the grid of micro-images as LFUtilProcessWhiteImages writes it."""

import math
from pathlib import Path

import numpy as np

from pipeline.exports.errors import ExportError
from pipeline.exports.material import Material
from pipeline.files.jsonfile import write_json


def write(material: Material, folder: Path) -> None:
    """Write a file per camera.

    Raises
    ------
    ExportError
        Microlenses are not hexagonal rows.
    """
    for camera in material.cameras:
        mesh = camera.mesh
        assert mesh is not None
        if mesh.layout != "hexagonal":
            raise ExportError(f"lftoolbox knows hexagonal rows of microlenses, and {camera.name} has {mesh.layout}")
        cos, sin = math.cos(mesh.angle_rad), math.sin(mesh.angle_rad)
        # LFBuildHexGrid: place = 2 offset + Rot (grid - offset), and the first micro-image is that of grid 0.
        offset = np.linalg.solve(2 * np.eye(2) - [[cos, -sin], [sin, cos]], mesh.origin)
        across, down = mesh.step_px
        model = {
            "HSpacing": across,
            "VSpacing": down,
            "HOffset": float(offset[0]),
            "VOffset": float(offset[1]),
            "Rot": mesh.angle_rad,
            "UMax": mesh.columns,
            "VMax": mesh.rows,
            "Orientation": "horz",
            "FirstPosShiftRow": 1,
        }
        said = {"about": list(material.remarks), "LensletGridModel": model}
        write_json(folder / f"{camera.name}.grid.json", said)
