"""Tasks `picture` and `sheet`: pictures that prims name, and the patterns of targets for viewers."""

import base64
from pathlib import Path

import numpy as np

from pipeline.files.npy import write_npy
from pipeline.files.pictures import decoded
from pipeline.files.png import write_png
from pipeline.targets.preview import preview_picture
from pipeline.targets.target import Target, target_from_plain
from pipeline.tasks.artefacts.cameras import Inputs
from pipeline.tasks.params.frames import PICTURE, SHEET, PictureFile, Sheet, source_name


def picture(params: PictureFile, inputs: Inputs, out: Path) -> None:
    """A picture on a surface or in the sky: picture.npy, (h, w, 4) float32 and linear, and the file as it is."""
    content = base64.b64decode(params.encoded)
    write_npy(out / PICTURE, decoded(content, params.suffix, params.space))
    (out / source_name(params.suffix)).write_bytes(content)


_EDGE_PX = 1024
"""Edge of the picture of a flat board [px]: its squares stay sharp on a whole screen."""


def sheet(params: Sheet, inputs: Inputs, out: Path) -> None:
    """Reflectances of all patches of a target side by side, linear, in 8 bits, for viewers: sheet.png."""
    target = target_from_plain(params.target)
    assert isinstance(target, Target)  # a mesh has no sheet
    grey = np.clip(preview_picture(target, _EDGE_PX), 0, 1)
    write_png(out / SHEET, np.rint(255 * grey).astype(np.uint8))
