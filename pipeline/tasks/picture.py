"""Task `picture`: a picture on a surface or in the sky, decoded to linear numbers."""

import base64
from pathlib import Path

from pipeline.files.npy import write_npy
from pipeline.files.pictures import decoded
from pipeline.tasks.artefacts.cameras import Inputs
from pipeline.tasks.params.pictures import PICTURE
from pipeline.tasks.params.pictures import Picture as Params


def run(params: Params, inputs: Inputs, out: Path) -> None:
    """Write picture.npy, (h, w, 4) float32."""
    write_npy(out / PICTURE, decoded(base64.b64decode(params.encoded), params.suffix, params.space))
