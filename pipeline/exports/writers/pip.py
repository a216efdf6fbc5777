"""PlenopticImageProcessing: MLAconfig.xml, FileStorage whose scalars must be real. It has no place for comments."""

from pathlib import Path

from pipeline.exports.filestorage import xml_text
from pipeline.exports.material import ExportError, Material
from pipeline.exports.thin_lens import thin_lens


def write(material: Material, folder: Path) -> None:
    """Write a file per camera.

    Raises
    ------
    ExportError
        Microlenses are not hexagonal rows.
    """
    for camera in material.cameras:
        array, model = camera.array, thin_lens(camera)
        assert array is not None
        if array.layout != "hexagonal":
            raise ExportError(f"pip knows hexagonal rows of microlenses, and {camera.name} has {array.layout}")
        larger = 1 / model.ratio
        values = {
            "IsHexGrid": 1,
            "GridRotRAD": array.turn_rad,
            # The reference lens as its centre would lie on the sensor if the light came along the axis.
            "MlaCenterPX": (camera.axis + (array.centre - camera.axis) / larger).tolist(),
            "SensorResPX": camera.size_px,
            "MicroLensDistancePX": array.pitch_px / larger,
            "MainPrincipalPointPX": camera.axis.tolist(),
            "MlaImageScale": larger,
            "MicroLensFocalLengthPX": model.sensor_mm / camera.pitch_mm,
            "MainLensFLengthMM": float(model.focal_mm),
            "MainLensFDistMM": float(model.main_lens_mm),
            "PixelsizeMM": camera.pitch_mm,
        }
        (folder / f"{camera.name}.MLAconfig.xml").write_text(xml_text("MlaDescription", values), encoding="utf-8")
