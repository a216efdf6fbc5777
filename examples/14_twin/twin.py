"""A camera drawn by tolerances plays the real one: its images are detected, and its twin is fitted from the drawings.

    python examples/14_twin/twin.py [FOLDER]

FOLDER, by default build/14_twin, gets real.usda, images, corners.csv, fitted.usda, fitted.json and both builds; the
report of the twin's, fitted.report/index.html, shows the fit, and the images side by side.
"""

import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np

import pipeline
from pipeline.files.exr import read_exr
from pipeline.files.tables import write_table
from pipeline.plugins.fits.calibration import calibrate
from pipeline.plugins.fits.free_numbers import FreeStage
from pipeline.plugins.fits.observations import Stated
from pipeline.plugins.fits.real_images import found_images
from pipeline.plugins.fits.twin import Twin, document
from pipeline.plugins.fits.twin_page import page
from pipeline.scene.tolerances import layer_of_member

STAGE = Path(__file__).resolve().parent / "dataset.usda"
COLUMNS, ROWS = 7, 4
FIRST_PX = 0.1
"""Sigma of a first fit, whose chi squared tells that of the second."""
SHOWN, TIMES = 6, 5.0
"""Frame of the picture, and how many times darker and lighter differences are than they are."""
HALF_WINDOW_PX = 5
"""Half the window in which a corner is looked for: a third of a square."""


def main() -> None:
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "build/14_twin")
    folder.mkdir(parents=True, exist_ok=True)
    fitted = folder / "fitted.usda"
    errors = planted(STAGE, folder)
    detect(folder / "real", folder / "corners.csv")
    for old in (fitted, fitted.with_suffix(".json")):
        old.unlink(missing_ok=True)
    stage = FreeStage(STAGE, ["Made"])
    corners = [folder / "corners.csv"]
    first = calibrate(stage, corners, Stated(position="exact", sigma_px=FIRST_PX), tell=print)
    sigma_px = scatter(first, ~first.observations.is_centre)
    print(f"sigma is {sigma_px:.4f} px")
    twin = calibrate(stage, corners, Stated(position="saddle", sigma_px=sigma_px), tell=print)
    twin.write(fitted, found_images([str(folder / "images")], stage.nominal, fitted))
    print("\n".join(page(document(twin))))
    recovered(twin, errors)
    built(fitted, folder / "fitted")
    compare(folder / "real", folder / "fitted")


def planted(stage: Path, folder: Path) -> dict[str, float]:
    """Draw the real camera by the tolerances of a stage, and build its images; its errors, by number."""
    real = folder / "real.usda"
    text, errors = layer_of_member(stage, 1, real)
    real.write_text(text, encoding="utf-8")
    built(real, folder / "real")
    return {error.name: error.error for error in errors}


def built(stage: Path, out: Path) -> None:
    """Build a layer; it may read what the example may."""
    command = [sys.executable, "-m", "pipeline", "build", str(stage), "-o", str(out), "--allow-root", str(STAGE.parent)]
    subprocess.run(command, check=True)


def detect(out: Path, file: Path) -> None:
    """Find corners in the images of a build, as one would in photographs; nothing of its truth is read. The images of
    8 bits that the detector sees are kept beside the table.
    """
    images = file.parent / "images"
    images.mkdir(exist_ok=True)
    columns: dict[str, list] = {name: [] for name in ("frame", "point_id", "x_px", "y_px")}
    for view in pipeline.open_output(out).cameras["Rig.Camera"].views:
        light = read_exr(view.image_path)["image"].channels["Y"]
        image = np.rint(np.clip(light / light.max(), 0, 1) * 255).astype(np.uint8)
        cv2.imwrite(str(images / f"{view.frame}.png"), image)
        found, corners = cv2.findChessboardCornersSB(image, (COLUMNS, ROWS), flags=cv2.CALIB_CB_ACCURACY)
        if not found:
            print(f"frame {view.frame}: no board is found")
            continue
        window = (HALF_WINDOW_PX, HALF_WINDOW_PX)
        sharp = cv2.cornerSubPix(image, corners, window, (-1, -1), (cv2.TERM_CRITERIA_EPS, 100, 1e-4))
        sharp = sharp.reshape(-1, 2)[::-1]  # OpenCV begins at the end of this board where its first corner is not
        columns["frame"] += [view.frame] * len(sharp)
        columns["point_id"] += range(len(sharp))
        columns["x_px"] += sharp[:, 0].astype(float).tolist()
        columns["y_px"] += sharp[:, 1].astype(float).tolist()
    write_table(file, ["corners of OpenCV's detector", "pixel_origin: 0"], columns)


def scatter(twin: Twin, rows: np.ndarray) -> float:
    """Sigma with which chi squared of some rows would be what is expected."""
    group = twin.group("", rows)
    return float(twin.observations.sigma_px[rows][0] * np.sqrt(group.chi2 / group.expected))


def recovered(twin: Twin, errors: dict[str, float]) -> None:
    """Print what was planted beside what was found."""
    print(f"\n{'number':46} {'drawn':>10} {'found':>10} {'deviation':>10}")
    for number, by, deviation in zip(
        twin.stage.numbers, twin.solution.correction, twin.solution.deviation, strict=True
    ):
        print(f"{number.name[-46:]:46} {errors[number.name]:10.4g} {by:10.4g} {deviation:10.3g}")


def compare(real: Path, fitted: Path) -> None:
    """Print how far exact rows of the twin are from those of the real camera: points it was never told."""
    ours, theirs = (pipeline.open_output(out).cameras["Rig.Camera"].correspondences for out in (fitted, real))
    rows = {(row.frame, row.point_id): (row.x_px, row.y_px) for row in theirs}
    off = [np.subtract((row.x_px, row.y_px), rows[row.frame, row.point_id]) for row in ours]
    rms_px = np.sqrt(np.mean(np.sum(np.square(off), axis=1)))
    print(f"rows of the twin are {rms_px:.4f} px rms off those of the real camera")
    place = f"frames/{SHOWN:04d}/Rig.Camera/image.exr"
    theirs, ours = (read_exr(out / place)["image"].channels["Y"] for out in (real, fitted))
    apart = 0.5 + TIMES * (ours - theirs)
    picture = np.concatenate([theirs, apart], axis=1)[::2, ::2]
    cv2.imwrite(str(real.parent / "picture.png"), np.rint(255 * np.clip(picture, 0, 1)).astype(np.uint8))


if __name__ == "__main__":
    main()
