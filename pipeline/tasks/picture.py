"""Task `picture`: a picture on a surface or in the sky, decoded to linear numbers and as it is."""

import base64
from pathlib import Path

from pipeline.files.npy import write_npy
from pipeline.files.pictures import decoded
from pipeline.tasks.artefacts.cameras import Inputs
from pipeline.tasks.params.placed import PICTURE, source_name
from pipeline.tasks.params.placed import Picture as Params


def run(params: Params, inputs: Inputs, out: Path) -> None:
    """Write picture.npy, (h, w, 4) float32, and the file itself."""
    content = base64.b64decode(params.encoded)
    write_npy(out / PICTURE, decoded(content, params.suffix, params.space))
    (out / source_name(params.suffix)).write_bytes(content)
