"""LFToolbox (MATLAB): the grid of micro-images as LFUtilProcessWhiteImages writes it.

Since release 0.5 LFBuildHexGrid turns the grid about its own first place and then adds the offset.
"""

from pathlib import Path

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
        across, down = mesh.step_px
        model = {
            "HSpacing": across,
            "VSpacing": down,
            "HOffset": float(mesh.origin[0]),
            "VOffset": float(mesh.origin[1]),
            "Rot": mesh.angle_rad,
            "UMax": mesh.columns,
            "VMax": mesh.rows,
            "Orientation": "horz",
            "FirstPosShiftRow": 1,
        }
        said = {"about": list(material.remarks), "LensletGridModel": model}
        write_json(folder / f"{camera.name}.grid.json", said)
