"""Bok 2017 and Nousias 2017 (MATLAB): centres of micro-images, their neighbours, and corners with their centres.

`correspondencesAll_<frame>.mat` is the file through which exact corners enter the calibration of Nousias.
"""

from pathlib import Path
from typing import Any

import numpy as np

from pipeline.exports.material import ExportCamera, Material
from pipeline.exports.micro_images import MicroImages
from pipeline.formats import Cameras, ExportError, Format, Microlenses, Origin, Targets, Unit
from pipeline.plugins.formats.filestorage import write_mat

FORMAT = Format(
    consumer="MATLAB code of Bok 2017 and Nousias 2017",
    source="proof: GNU Octave 7.3 loads the files. Read: sotnousias/plenoptic-camera-calibration d41208d",
    cameras=Cameras.PLENOPTIC,
    targets=Targets.BOARD,
    files=(
        "<camera>/microlens_center_list.mat",
        "<camera>/lens_types.mat",
        "<camera>/correspondencesAll_<frame>.mat",
        "<camera>/image_center.txt",
        "<camera>/pattern_size.txt",
    ),
    origin=Origin.ONE,
    unit=Unit.MM,
    microlenses=Microlenses.TYPES_FROM_ONE,
)

_NEIGHBOURS = ((0, 0), (1, 0), (0, 1), (-1, 1), (-1, 0), (0, -1), (1, -1))
"""Itself, right, lower right, lower left, left, upper left, upper right, as steps of the axial indices (k, l)."""


def write(material: Material, folder: Path) -> None:
    """Write a folder per camera."""
    for camera in material.cameras:
        images, mesh = camera.array
        if mesh.layout != "hexagonal":
            raise ExportError(f"bok supports only hexagonal rows of microlenses, and {camera.name} has {mesh.layout}")
        camera_folder = folder / camera.name
        camera_folder.mkdir()
        remarks = {"remarks": np.array(material.remarks, dtype=object)}
        write_mat(camera_folder / "microlens_center_list.mat", {**_centres(camera), **remarks})
        types = {f"type{number}_struct": images.centres[images.types == number].T for number in np.unique(images.types)}
        write_mat(camera_folder / "lens_types.mat", {**types, **remarks})
        for view in material.of(camera):
            rows = _correspondences(material, images, view.observations)
            write_mat(camera_folder / f"correspondencesAll_{view.frame:04d}.mat", {"correspondences": rows, **remarks})
        (camera_folder / "image_center.txt").write_text(
            " ".join(map(repr, camera.axis.tolist())) + "\n", encoding="utf-8"
        )
        (camera_folder / "pattern_size.txt").write_text(f"{material.board.column_step!r}\n", encoding="utf-8")


def _centres(camera: ExportCamera) -> dict[str, Any]:
    images, mesh = camera.array
    index_of = {tuple(pair): row for row, pair in enumerate(images.microlenses.tolist(), 1)}
    connection = [[index_of.get((k + dk, l + dl), row) for dk, dl in _NEIGHBOURS] for (k, l), row in index_of.items()]
    return {
        "center_list": images.centres.T,
        "center_connection": np.array(connection, dtype=np.float64).T,
        "image_size": np.array([camera.size_px], dtype=np.float64),
        "radius": np.array([[mesh.pitch_px[0] // 2]]),
    }


def _correspondences(material: Material, images: MicroImages, observations: Any) -> np.ndarray:
    """Six rows: corner x, y, centre x, y, column and row of the board."""
    row_of = {tuple(pair): row for row, pair in enumerate(images.microlenses.tolist())}
    centres = images.centres[[row_of[tuple(pair)] for pair in observations.microlenses.tolist()]]
    row, column = np.divmod(observations.ids, material.board.columns)
    return np.column_stack([observations.positions, centres, column, row]).T
