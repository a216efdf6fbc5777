"""The plenoptic twin: corners within micro-images and the centres of a white image tell where the array is.

    python examples/14_twin/plenoptic.py [FOLDER]

FOLDER, by default build/14_plenoptic, gets real.usda, corners.csv, white.csv, fitted.usda, fitted.json and both builds.
"""

import sys
from pathlib import Path

import cv2
import numpy as np
from scipy import ndimage
from twin import FIRST_PX, TIMES, built, planted, recovered, scatter

import pipeline
from pipeline.files.exr import read_exr
from pipeline.files.tables import write_table
from pipeline.plugins.fits.calibration import calibrate
from pipeline.plugins.fits.free_numbers import FreeStage
from pipeline.plugins.fits.observations import Stated
from pipeline.plugins.fits.twin import Twin, document
from pipeline.plugins.fits.twin_page import page

STAGE = Path(__file__).resolve().parent / "plenoptic.usda"
HALF_WINDOW_PX, FARTHEST_PX = 3, 1.5
"""Half the window in which a corner is looked for, and the farthest that it may be from where it is looked for."""
DARK, BRIGHT = 0.3, 0.7
"""White over the brightest above which pixels are those of one micro-image, and above which all of a window has to be:
nearer to the edge of a micro-image vignetting moves a saddle."""
SHOWN, ENLARGED = 4, 2
"""Frame of the picture, and how many times larger it is."""


def main() -> None:
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "build/14_plenoptic")
    folder.mkdir(parents=True, exist_ok=True)
    errors = planted(STAGE, folder)
    white = folder / "white.csv", "centres: chief", centres_in(folder / "real")
    by_white = fit((white, FIRST_PX))
    corners = folder / "corners.csv", "position: exact", corners_in(folder / "real", by_white)
    first = fit((white, FIRST_PX), (corners, FIRST_PX))
    of_points, of_centres = (scatter(first, first.observations.is_centre == flag) for flag in (False, True))
    twin = fit((white, of_centres), (corners, of_points))
    print(f"sigma is {of_points:.3f} px of corners, {of_centres:.4f} px of centres")
    for old in (folder / "fitted.usda", folder / "fitted.json"):
        old.unlink(missing_ok=True)
    twin.write(folder / "fitted.usda")
    print("\n".join(page(document(twin))))
    recovered(twin, errors)
    built(folder / "fitted.usda", folder / "fitted")
    compare(folder)


def fit(*seen: tuple[tuple[Path, str, dict], float]) -> Twin:
    """Fit what the workshop may have done to tables of positions, each with its sigma."""
    for (file, position, columns), sigma_px in seen:
        column = np.full(len(columns["x_px"]), sigma_px)
        write_table(file, ["pixel_origin: 0", position], columns | {"sigma_px": column})
    files = [file for (file, *_), _ in seen]
    return calibrate(FreeStage(STAGE, ["Made"]), files, Stated(), tell=print)


def light_of(file: Path) -> np.ndarray:
    return next(iter(read_exr(file).values())).channels["Y"].astype(np.float32)


def centres_in(out: Path) -> dict[str, list]:
    """Centroids of islands of light in the white image at F/11, which has gaps between them: of chief rays."""
    light = light_of(out / "cameras/Rig.Camera/white/f11.exr")
    island, _ = ndimage.label(light > DARK * light.max())
    whole = [
        number
        for number, (rows, columns) in enumerate(ndimage.find_objects(island), 1)
        if min(rows.start, columns.start) > 1 and rows.stop < light.shape[0] - 1 and columns.stop < light.shape[1] - 1
    ]
    grown = ndimage.grey_dilation(island, size=5)  # with the faint rim of each
    y_px, x_px = np.array(ndimage.center_of_mass(light, grown, whole)).T
    return {"x_px": x_px, "y_px": y_px}


def corners_in(out: Path, by_white: Twin) -> dict[str, list]:
    """Saddles within micro-images, near to where the camera that the white image told has them, before boards as one
    has put them up; nothing of the build's truth is read.
    """
    columns: dict[str, list] = {
        name: [] for name in ("frame", "point_id", "microlens_k", "microlens_l", "x_px", "y_px")
    }
    dataset = by_white.stage.at(by_white.solution.correction)
    camera, (target,) = pipeline.ready(dataset.cameras[0].camera), dataset.targets
    white = light_of(out / "cameras/Rig.Camera/white.exr")
    for frame in dataset.frames:
        pose = frame.vision_from_target("Rig.Camera", target.name)
        points = target.target.points()
        drawn = camera.project(points.position_mm @ pose[:3, :3].T + pose[:3, 3], pose[:3, 2])
        image = light_of(out / f"frames/{frame.number:04d}/Rig.Camera/image.exr") / np.maximum(
            white, DARK * white.max()
        )
        begun = np.stack([drawn.x_px, drawn.y_px], axis=1).astype(np.float32)
        begun = np.clip(begun, 0, np.subtract(camera.size_px, 1, dtype=np.float32))
        window = (HALF_WINDOW_PX, HALF_WINDOW_PX)
        found = cv2.cornerSubPix(image, begun.copy(), window, (-1, -1), (cv2.TERM_CRITERIA_EPS, 100, 1e-4))
        moved_px = np.hypot(*(found - begun).T)
        around = ndimage.map_coordinates(ndimage.minimum_filter(white, 2 * HALF_WINDOW_PX + 1), found.T[::-1], order=0)
        kept = (moved_px < FARTHEST_PX) & (around > BRIGHT * white.max())
        columns["frame"] += [frame.number] * int(kept.sum())
        columns["point_id"] += drawn.point[kept].tolist()
        for axis, name in enumerate(("microlens_k", "microlens_l")):
            columns[name] += drawn.microlens[kept, axis].tolist()
        for axis, name in enumerate(("x_px", "y_px")):
            columns[name] += found[kept, axis].astype(float).tolist()
    return columns


def compare(folder: Path) -> None:
    """Draw the image of the real camera beside that of its twin, and their difference."""
    place = f"frames/{SHOWN:04d}/Rig.Camera/image.exr"
    theirs, ours = (light_of(folder / name / place) for name in ("real", "fitted"))
    picture = np.concatenate([theirs, ours, 0.5 + TIMES * (ours - theirs)], axis=1)
    picture = np.repeat(np.repeat(picture, ENLARGED, axis=0), ENLARGED, axis=1)
    cv2.imwrite(str(folder / "picture.png"), np.rint(255 * np.clip(picture, 0, 1)).astype(np.uint8))


if __name__ == "__main__":
    main()
