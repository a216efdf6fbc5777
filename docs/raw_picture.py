"""Draw docs/raw.png: a window of an image as it is, and as a sensor of the library records it with less and less light.

    python docs/raw_picture.py [PICTURE FRAME_FOLDER] [--window LEFT TOP WIDTH HEIGHT] [--zoom N]

FRAME_FOLDER is frames/<frame>/<camera> of an output folder. Each panel is as bright as the others: what is small is
multiplied. Prints the electrons of white at each level, and their noise, with or without a picture.
"""

import argparse
from pathlib import Path

import numpy as np
from picture import enlarged, side_by_side
from pxr import Usd

from pipeline.files.exr import read_exr
from pipeline.files.png import write_png
from pipeline.folders import shipped_folder
from pipeline.render.sensor.read_out import Shot, digital_numbers
from pipeline.render.sensor.response import Irradiation, SensorResponse
from pipeline.render.spectral.preview import srgb_preview
from pipeline.scene.sensor import read_response

LEVELS = (0.8, 0.02, 0.002)
"""Shares of saturation that relative irradiance 1 fills: well exposed, and 40 and 400 times less light."""


def sensor() -> SensorResponse:
    """The IMX250 of the library."""
    stage = Usd.Stage.Open(str(shipped_folder("stages") / "sensors" / "imx250.usda"))
    return read_response(stage.GetDefaultPrim())


def recorded(light: np.ndarray, response: SensorResponse, level: float, frame: int) -> np.ndarray:
    """Electrons above black over those of relative irradiance 1, (h, w) float64."""
    at_one = Irradiation(exposure_time_s=0.01, white_level=level).photons_at_one(response)
    shot = Shot(seed=1, camera="Rig.Camera", frame=frame, exposure_time_s=0.01)
    numbers = digital_numbers(response, {"mono": light * at_one}, shot)
    return (numbers - response.black_level_dn) / (response.gain_dn_per_e * level * response.saturation_e)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("picture", type=Path, nargs="?")
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("--window", type=int, nargs=4, default=(0, 0, 1 << 20, 1 << 20))
    parser.add_argument("--zoom", type=int, default=1)
    given = parser.parse_args()
    if given.picture and given.folder:
        draw(given.picture, given.folder, given.window, given.zoom)
    tell()


def draw(picture: Path, folder: Path, window: tuple[int, int, int, int], zoom: int) -> None:
    """Write the picture."""
    left, top, width, height = window
    image = read_exr(folder / "image.exr")["image"].channels["Y"].astype(np.float64)
    light, response = image[top : top + height, left : left + width], sensor()
    panels = [light, *(recorded(light, response, level, 1) for level in LEVELS)]
    write_png(picture, side_by_side([enlarged(srgb_preview(one, 1.0), zoom) for one in panels]))


def tell() -> None:
    """Print a table of levels: electrons of white, and their noise over many pixels."""
    print("| `plen:image:whiteLevel` | electrons of white | noise of them |\n|---|---|---|")
    response, even = sensor(), np.ones((300, 300))
    for level in LEVELS:
        noise = np.std(recorded(even, response, level, 1))
        print(f"| {level:g} | {level * response.saturation_e:.0f} | {100 * noise:.1f} % |")


if __name__ == "__main__":
    main()
