"""LFToolbox (MATLAB): the grid of micro-images as LFUtilProcessWhiteImages writes it.

Since release 0.5 LFBuildHexGrid turns the grid about its own first node and then adds the offset.
"""

from pathlib import Path

from pipeline.exports.material import Material
from pipeline.files.jsonfile import write_json
from pipeline.formats import Cameras, ExportError, Format, Microlenses, Origin

FORMAT = Format(
    consumer="LFToolbox (MATLAB)",
    note="the grid of micro-images that a white image would give",
    source="proof: LFBuildHexGrid of doda42/LFToolbox 3bf4f55, LFBuildLensletGridModel.m, in GNU Octave 7.3",
    cameras=Cameras.PLENOPTIC,
    files=("<camera>.grid.json",),
    origin=Origin.ONE,
    microlenses=Microlenses.MICRO_IMAGE_GRID,
)


def write(material: Material, folder: Path) -> None:
    """Write a file per camera."""
    for camera in material.cameras:
        _, mesh = camera.array
        if mesh.layout != "hexagonal":
            raise ExportError(
                f"lftoolbox supports only hexagonal rows of microlenses, and {camera.name} has {mesh.layout}"
            )
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
        record = {"about": list(material.remarks), "LensletGridModel": model}
        write_json(folder / f"{camera.name}.grid.json", record)
