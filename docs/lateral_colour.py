"""Compare the lateral colour that detectors find in images with that of the ground truth: docs/colour.md quotes it.

    python docs/lateral_colour.py [FOLDER]      FOLDER: where to build, else build/lateral_colour

The conventional rig of the library with its Bayer sensor, a strip of 640 x 32 pixels, looks at a row of 23 corners in
daylight (D65). Two detectors work on image over white of each channel. One fits two erf edges to a corner, which the
steepest part of the blur decides. The other adds up the light along pixel rows on both sides of the corner: however
asymmetric the blur of an edge is, such a sum moves with its mean.
"""

import argparse
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from scipy.special import erf

import pipeline
from pipeline.files.exr import read_exr
from pipeline.files.tables import read_table

ROOT = Path(__file__).resolve().parents[1]
HALF_PX, BESIDE_PX = 12, range(7, 13)
"""Half the window around a corner; distances of the rows, on both sides of it, in which light is added up."""
STAGE = """#usda 1.0
(
    defaultPrim = "Strip"
    endTimeCode = 1
    metersPerUnit = 0.001
    startTimeCode = 1
    timeCodesPerSecond = 24
    upAxis = "Y"
)

def PlenDataset "Strip"
{{
    rel plen:cameras = </Strip/Rig/Camera>
    uniform string plen:illuminant = "D65"
    rel plen:targets = </Strip/Board>

    def "Rig" (
        prepend references = @{stages}/rigs/conventional_100mm.usda@
    )
    {{
        over "Camera"
        {{
            uniform int plen:image:samples = 1024
            uniform token[] plen:truth:columns = ["saddle"]
            float verticalAperture = 3.2
        }}

        over "Lens"
        {{
            uniform token plen:indexSource = "catalogue"
        }}

        over "Sensor" (
            prepend references = @{stages}/sensors/bayer_640x480_10um.usda@
        )
        {{
            uniform int2 plen:resolution = (640, 32)
        }}
    }}

    def PlenCheckerboard "Board"
    {{
        uniform int plen:columns = 23
        uniform int plen:rows = 2
        uniform double plen:squareSize = 0.98
        double3 xformOp:translate = (0, 0.49, -434.4)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }}
}}
"""


def by_erf(window: np.ndarray) -> float:
    """Place of a corner from the middle of a window, along x, by two edges of the shape of erf."""
    y, x = np.mgrid[-HALF_PX : HALF_PX + 1, -HALF_PX : HALF_PX + 1]

    def off(guess: np.ndarray) -> np.ndarray:
        at_x, at_y, lean_x, lean_y, width_x, width_y, middle, step = guess
        upright = erf((x - at_x + lean_x * (y - at_y)) / width_x)
        return np.ravel(middle + step * upright * erf((y - at_y + lean_y * (x - at_x)) / width_y) - window)

    step = 0.5 if window[-1, -1] > 0.5 else -0.5
    return float(least_squares(off, [0.0, 0.0, 0.0, 0.0, 0.6, 0.6, 0.5, step]).x[0])


def by_sum(window: np.ndarray) -> float:
    """The same by the light of both edges above and below."""
    sides = [window[[HALF_PX + side * row for row in BESIDE_PX]].mean(axis=0) for side in (-1, 1)]
    lit = [1 - side if side[0] > side[-1] else side for side in sides]
    return float(HALF_PX + 0.5 - np.mean([side.sum() for side in lit]))


def found_in(out: Path, channel: str) -> np.ndarray:
    """J, saddle, and both detections of the corners of a channel, along x, (corners, 4) [px]."""
    frame = out / "frames/0001/Rig.Camera" / channel
    table, image = read_table(frame / "correspondences.csv"), read_exr(frame / "image.exr")["image"].channels["Y"]
    white, rows = read_exr(out / "cameras/Rig.Camera" / channel / "white.exr")["white"].channels["Y"], []
    for x, y, saddle in zip(*map(table.numbers, ("x_px", "y_px", "saddle_x_px")), strict=True):
        column, row = round(x), round(y)
        here = np.s_[row - HALF_PX : row + HALF_PX + 1, column - HALF_PX : column + HALF_PX + 1]
        if HALF_PX <= column < image.shape[1] - HALF_PX:
            window = image[here].astype(float) / white[here]
            rows.append((x, saddle, column + by_sum(window), column + by_erf(window)))
    return np.array(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path, default=ROOT / "build/lateral_colour")
    folder = parser.parse_args().folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "strip.usda").write_text(STAGE.format(stages=ROOT / "stages"), encoding="utf-8")
    pipeline.build(folder / "strip.usda", folder / "strip", allow_roots=(ROOT,))
    red, green, blue = (found_in(folder / "strip", channel) for channel in ("red", "green", "blue"))
    away = green[:, :1] / 1000 - 0.3195
    print("radial px per 1000 px   J        saddle             sums of light      erf edges")
    for name, apart in (("red - green", red - green), ("blue - green", blue - green)):
        slope = np.sum(away * apart, axis=0) / np.sum(away**2)
        error = (apart - away * slope).std(axis=0) / np.sqrt(np.sum(away**2))
        cells = [f"{slope[0]:+.3f}", *(f"{a:+.3f} +- {b:.3f}" for a, b in zip(slope[1:], error[1:], strict=True))]
        print(f"{name:22}  {cells[0]}   " + "   ".join(cells[1:]))


if __name__ == "__main__":
    main()
