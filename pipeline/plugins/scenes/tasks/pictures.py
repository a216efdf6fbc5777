"""Task `picture`: pictures that prims name."""

import base64
from pathlib import Path

from pipeline.files.npy import write_npy
from pipeline.plugins.scenes.picture_files import decoded
from pipeline.plugins.scenes.tasks.params import PICTURE, PictureFile, source_name
from pipeline.products.cameras import Inputs


def picture(params: PictureFile, inputs: Inputs, out: Path) -> None:
    """A picture on a surface or in the sky: picture.npy, (h, w, 4) float32 and linear, and the file as it is."""
    content = base64.b64decode(params.encoded)
    write_npy(out / PICTURE, decoded(content, params.suffix, params.space))
    (out / source_name(params.suffix)).write_bytes(content)
