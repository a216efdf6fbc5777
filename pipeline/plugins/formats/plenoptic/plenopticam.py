"""plenopticam: centres of micro-images as JSON beside the white image; y comes first."""

from pathlib import Path

import numpy as np

from pipeline.exports.material import Material
from pipeline.files.jsonfile import write_json
from pipeline.formats import Cameras, ExportError, Format, ImageAxes, Microlenses, Origin

FORMAT = Format(
    consumer="plenopticam",
    note="to stand beside the white image of the same name",
    source="read: hahnec/plenopticam 24bb523, cfg/cfg.py, lfp_aligner/lfp_local_resampler.py",
    cameras=Cameras.PLENOPTIC,
    files=("<camera>.json",),
    origin=Origin.ZERO,
    axes=ImageAxes.Y_X,
    microlenses=Microlenses.MICRO_IMAGE_GRID,
)


def write(material: Material, folder: Path) -> None:
    """Write a file per camera."""
    for camera in material.cameras:
        images, mesh = camera.array
        if mesh.layout == "hexagonal-columns":
            raise ExportError(f"plenopticam supports only rows of microlenses, and {camera.name} has hexagonal columns")
        rows = [
            [*centre, row, column]
            for centre, (column, row) in zip(images.centres.tolist(), images.microlenses.tolist(), strict=True)
        ]
        lines = [images.centres[images.microlenses[:, 1] == row] for row in range(mesh.rows)]
        down = np.median(np.diff([np.median(line[:, 0]) for line in lines]))
        across = np.median(np.concatenate([np.diff(line[:, 1]) for line in lines]))
        write_json(
            folder / f"{camera.name}.json",
            {
                "about": list(material.remarks),
                "pat_type": "rec" if mesh.layout == "square" else "hex",
                "ptc_mean": [float(down), float(across)],
                "mic_list": rows,
            },
        )
