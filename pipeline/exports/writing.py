"""A material into the folder of a format: converted, written, and held to the files that the format states."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

from pipeline.export_formats import FORMATS, SIDE_CAR, NamedCamera
from pipeline.exports.conventions import CONVENTIONS, Centre, Convention
from pipeline.exports.conversion import converted
from pipeline.exports.formats import WRITERS
from pipeline.exports.material import Material
from pipeline.exports.noise import Noise
from pipeline.files.jsonfile import write_json


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
    convention = CONVENTIONS[name]
    WRITERS[name](converted(material, convention), folder)
    files = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    facts: dict[str, Any] = {"stage": material.stage, "format": name, "position": position}
    if convention.centre is Centre.ROWS:
        facts["pinholes_of_rows"] = _by_name(material)
    noisy = None if noise.is_none else noise.to_dict()
    write_json(folder / SIDE_CAR, {**facts, "noise": noisy, "conventions": _plain(convention), "files": files})
    cameras = [NamedCamera(name=one.name, is_plenoptic=one.built.is_plenoptic) for one in material.cameras]
    stated = FORMATS[name].paths(cameras, material.frames)
    if sorted([*files, SIDE_CAR]) != stated:
        raise ValueError(f"{name} states the files {stated}, and wrote {files}")


def _plain(convention: Convention) -> dict[str, str]:
    return {name: str(value) for name, value in asdict(convention).items()}


def _by_name(material: Material) -> dict[str, Any]:
    """The pinholes of the rows in our conventions, by the keys of camera.json; null where rows determine none."""
    found = {one.name: None if one.row_pinhole is None else asdict(one.row_pinhole) for one in material.cameras}
    for one in found.values():
        if one is not None:
            one["residual_px"] = {"rms": one.pop("rms_px"), "max": one.pop("max_px")}
    return found
