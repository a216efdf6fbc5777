"""Draw picture.png: the colour camera's image beside a window of the plenoptic one, with its exact positions.

pipeline build examples/05_scene/dataset.usda
python examples/05_scene/draw.py [build/05_scene]
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from PIL import Image

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parents[1] / "docs"))
import picture  # noqa: E402  # stands beside the documents that it draws for

WINDOW = 236, 110, 85, 85
"""Left, top, width and height of what is shown of the plenoptic image [px]."""
ZOOM, SIZE = 4, (544, 340)
"""Enlargement of that, and the size of the colour image beside it [px]: made smaller, it has less noise."""
LEVELS = 4
"""Steps of the 256 of a component that count as one: the eye sees no difference, and the file is half as long."""


def main() -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", nargs="?", type=Path, default=Path("build/05_scene"))
    frame = parser.parse_args().out / "frames/0001"
    with Image.open(frame / "Colour.Camera/image.png") as image:
        scene = np.array(image.convert("RGB").resize(SIZE, Image.Resampling.LANCZOS))
    lenses = picture.picture_of(frame / "Plenoptic.Camera", WINDOW, ZOOM, "image.png")
    both = picture.side_by_side([scene, lenses]) // LEVELS * LEVELS + LEVELS // 2
    Image.fromarray(both.astype(np.uint8)).save(HERE / "picture.png", optimize=True)


if __name__ == "__main__":
    main()
