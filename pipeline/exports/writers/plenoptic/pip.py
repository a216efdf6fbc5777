"""PlenopticImageProcessing: MLAconfig.xml, FileStorage whose scalars must be real. It has no place for comments."""

from pathlib import Path

from pipeline.exports.filestorage import xml_text
from pipeline.exports.material import Material
from pipeline.formats import Cameras, ExportError, Format, Origin, Unit

FORMAT = Format(
    consumer="PlenopticImageProcessing",
    source="read: Arne-Petersen/PlenopticImageProcessing f72013a, PlenopticTypes.hh, PlenopticTools.cpp",
    cameras=Cameras.PLENOPTIC,
    reads=frozenset(),
    files=("<camera>.MLAconfig.xml",),
    origin=Origin.ZERO,
    unit=Unit.MM,
)


def write(material: Material, folder: Path) -> None:
    """Write a file per camera."""
    for camera in material.cameras:
        (_, mesh), model = camera.array, camera.thin_lens
        if mesh.layout != "hexagonal":
            raise ExportError(f"pip knows hexagonal rows of microlenses, and {camera.name} has {mesh.layout}")
        lens_pitch_px = camera.built.record["mla"]["pitch_mm"] / camera.pitch_mm
        larger = mesh.pitch_px[0] / lens_pitch_px
        values = {
            "IsHexGrid": 1,
            "GridRotRAD": -mesh.angle_rad,
            # The reference lens as its centre would lie on the sensor if the light came along the axis.
            "MlaCenterPX": (camera.axis + (mesh.middle - camera.axis) / larger).tolist(),
            "SensorResPX": list(camera.size_px),
            "MicroLensDistancePX": lens_pitch_px,
            "MainPrincipalPointPX": camera.axis.tolist(),
            "MlaImageScale": larger,
            "MicroLensFocalLengthPX": model.sensor_mm / camera.pitch_mm,
            "MainLensFLengthMM": float(model.focal_mm),
            "MainLensFDistMM": float(model.main_lens_mm),
            "PixelsizeMM": camera.pitch_mm,
        }
        (folder / f"{camera.name}.MLAconfig.xml").write_text(xml_text("MlaDescription", values), encoding="utf-8")
