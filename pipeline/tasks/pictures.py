"""Task `sheet`: the patterns of targets for viewers."""

from pathlib import Path

import numpy as np

from pipeline.files.png import write_png
from pipeline.targets.preview import preview_picture
from pipeline.targets.target import Target, target_from_plain
from pipeline.tasks.artefacts.cameras import Inputs
from pipeline.tasks.params.frames import SHEET, Sheet

_EDGE_PX = 1024
"""Edge of the picture of a flat board [px]: its squares stay sharp on a whole screen."""


def sheet(params: Sheet, inputs: Inputs, out: Path) -> None:
    """Reflectances of all patches of a target side by side, linear, in 8 bits, for viewers: sheet.png."""
    target = target_from_plain(params.target)
    assert isinstance(target, Target)  # a mesh has no sheet
    grey = np.clip(preview_picture(target, _EDGE_PX), 0, 1)
    write_png(out / SHEET, np.rint(255 * grey).astype(np.uint8))
