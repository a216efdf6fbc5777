"""A material into the folder of a format: converted, written, and held to the files that the format states."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

from pipeline.exports.conversion import converted
from pipeline.exports.material import Material
from pipeline.exports.noise import Noise
from pipeline.files.jsonfile import write_json
from pipeline.formats import SIDE_CAR, Centre, Format, module_of


def write_format(name: str, material: Material, folder: Path, position: str, noise: Noise) -> None:
    """Write the files of a format, and export.json, into an empty folder.

    Parameters
    ----------
    position : str
        Kind of position that the material holds, for the side-car; likewise `noise`, which it has already.

    Raises
    ------
    ExportError
        The format cannot hold this material.
    """
    module = module_of(name)
    record: Format = module.FORMAT
    module.write(converted(material, record), folder)
    files = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    facts: dict[str, Any] = {"stage": material.stage, "format": name, "position": position}
    if record.centre is Centre.ROWS:
        facts["pinholes_of_rows"] = _row_pinholes(material)
    noisy = None if noise.is_none else noise.to_dict()
    write_json(folder / SIDE_CAR, {**facts, "noise": noisy, "conventions": _meaning(record), "files": files})
    stated = record.paths({camera.name: camera.built.is_plenoptic for camera in material.cameras}, material.frames)
    if sorted([*files, SIDE_CAR]) != stated:
        raise ValueError(f"{name} states the files {stated}, and wrote {files}")


def _meaning(record: Format) -> dict[str, str]:
    """What the numbers mean, who reads them, and how we know."""
    facts = ("cameras", "least_cameras", "targets", "reads", "files")
    return {name: str(value) for name, value in asdict(record).items() if name not in facts}


def _row_pinholes(material: Material) -> dict[str, Any]:
    """The pinholes of the rows in our conventions, by the keys of camera.json; null where rows determine none."""
    pinholes: dict[str, Any] = {}
    for camera in material.cameras:
        pinhole = camera.row_pinhole
        pinholes[camera.name] = None
        if pinhole is not None:
            record = asdict(pinhole)
            residual_px = {"rms": record.pop("rms_px"), "max": record.pop("max_px")}
            pinholes[camera.name] = {**record, "residual_px": residual_px}
    return pinholes
