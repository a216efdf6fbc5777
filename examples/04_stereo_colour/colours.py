"""Print how far apart the channels of each camera see the same points: lateral colour, from the ground truth.

pipeline build examples/04_stereo_colour/dataset.usda
python examples/04_stereo_colour/colours.py [build/04_stereo_colour]
"""

import argparse
from pathlib import Path

import numpy as np

import pipeline


def main() -> None:
    """Print one row per camera and pair of channels."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", nargs="?", type=Path, default=Path("build/04_stereo_colour"))
    out = pipeline.open_output(parser.parse_args().out)
    print("camera        pair        points  rms px  max px  radial px per mm of image height")
    for body in sorted({name.partition("@")[0] for name in out.cameras}):
        for one, other in (("red", "green"), ("blue", "green")):
            near, far = (out.cameras[f"{body}@{name}"].correspondences for name in (one, other))
            assert (near.point_id == far.point_id).all() and (near.frame == far.frame).all()
            apart = np.stack([near.x_px - far.x_px, near.y_px - far.y_px], axis=1)
            height = np.stack([far.x_px - 319.5, far.y_px - 239.5], axis=1) * 0.01
            slope = (apart * height).sum() / (height**2).sum()
            length = np.hypot(*apart.T)
            rms = np.sqrt(np.mean(length**2))
            print(f"{body:12}  {one:>4}-{other:5}  {len(length):6}  {rms:6.4f}  {length.max():6.4f}  {slope:+.4f}")


if __name__ == "__main__":
    main()
