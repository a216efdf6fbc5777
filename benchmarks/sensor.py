"""What the reference program of EMVA 1288 finds in raw images of ours: the parameters that went in?

    python benchmarks/sensor.py

`emva1288` 1.0.2 (EMVA1288/emva1288, release 4.0 of the standard; extra `referees`) reads our TIFF files by a
descriptor file, as a laboratory would hand them in. tests/published/test_emva1288.py judges what it finds.
"""

import argparse
import logging
import math
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.files.tiff import write_tiff
from pipeline.render.sensor.read_out import Shot, digital_numbers
from pipeline.render.sensor.response import SensorResponse

SHAPE = (300, 400)
PIXELS = SHAPE[0] * SHAPE[1]
RATE = 4.0e6
"""Photons of a pixel in a second: a series of exposure times is one of photons, too."""
TIMES_S = np.arange(1, 53) * 8.0e-5
"""From 320 photons to 16,640, where most pixels are full: the referee wants a series that ends there."""
HALF_S = 2.0e-3
"""Exposure time of the stacks, which fills the pixels to about half."""
STACKED = 64
"""Images that the spatial variances are taken from."""

REPORTED = SensorResponse(
    quantum_efficiency=(0.6,),
    full_well_e=10000.0,
    gain_dn_per_e=0.35,
    bit_depth=12,
    black_level_dn=64.0,
    dark_noise_e=6.5,
    dark_current_e_per_s=3.0e4,
    dsnu_e=3.0,
    dsnu_row_e=0.7,
    dsnu_column_e=1.0,
    prnu=0.008,
    prnu_row=0.002,
    prnu_column=0.003,
)


def taken(folder: Path, number: int, photons: float, time_s: float) -> str:
    """Write a raw image of even light; gives its name."""
    light = {"mono": np.full(SHAPE, photons)}
    shot = Shot(seed=3, camera="Rig.Camera", frame=number, exposure_time_s=time_s)
    numbers = digital_numbers(REPORTED, light, shot)
    write_tiff(folder / f"{number}.tiff", SHAPE, lambda first, end: numbers[first:end], {})
    return f"i {number}.tiff"


def descriptor(folder: Path) -> Path:
    """A series of exposure times in pairs, bright and dark, and stacks in the dark and near half of saturation."""
    lines, number = ["v 4.0", f"n 12 {SHAPE[1]} {SHAPE[0]}"], 0
    for time_s, count in [*((time_s, 2) for time_s in TIMES_S), (HALF_S, STACKED)]:
        for photons, kind in (
            (RATE * time_s, f"b {time_s * 1e9:.6f} {RATE * time_s:.9g}"),
            (0.0, f"d {time_s * 1e9:.6f}"),
        ):
            lines.append(kind)
            for _ in range(count):
                lines.append(taken(folder, number, photons, time_s))
                number += 1
    path = folder / "series.txt"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def referee(folder: Path) -> Any:
    """Findings of the referee in a series that is made in a folder."""
    if not hasattr(np, "asfarray"):  # NumPy 2 has dropped it, and the referee still calls it
        np.asfarray = lambda values: np.asarray(values, np.float64)  # type: ignore[attr-defined]
    from emva1288.process.data import Data1288
    from emva1288.process.loader import LoadImageData
    from emva1288.process.parser import ParseEmvaDescriptorFile
    from emva1288.process.results import Results1288

    logging.disable(logging.INFO)
    images = LoadImageData(ParseEmvaDescriptorFile(str(descriptor(folder))).images)
    return Results1288(Data1288(images.data).data)


def main() -> None:
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = referee(Path(folder))
    dsnu = math.hypot(REPORTED.dsnu_e, REPORTED.dsnu_row_e, REPORTED.dsnu_column_e)
    prnu = math.hypot(REPORTED.prnu, REPORTED.prnu_row, REPORTED.prnu_column)
    rows = (
        ("gain K [DN/e-]", REPORTED.gain_dn_per_e, found.K),
        ("quantum efficiency [%]", 100 * REPORTED.quantum_efficiency[0], found.QE),
        ("temporal dark noise [e-]", REPORTED.dark_noise_e, found.sigma_d),
        ("dark current [e-/s]", REPORTED.dark_current_e_per_s, found.u_I_mean),
        ("DSNU of pixels, rows and columns together [e-]", dsnu, found.DSNU1288),
        ("PRNU likewise [%]", 100 * prnu, found.PRNU1288),
        ("full well, and saturation [e-]", REPORTED.full_well_e, found.u_e_sat),
    )
    print("| parameter | went in | came out |\n|---|---|---|")
    for name, given, came in rows:
        print(f"| {name} | {given:.5g} | {came:.5g} |")


if __name__ == "__main__":
    main()
