"""Draw the contact sheet of docs/targets.md: every target of the library as an ideal pinhole sees it.

    python docs/target_sheet.py PICTURE.png

`make picture` draws all pictures of the project.
"""

import argparse
import math
from pathlib import Path

import numpy as np

from pipeline.files.png import write_png
from pipeline.frames import apply
from pipeline.render.glow import TargetLight
from pipeline.scene.load import load
from pipeline.targets.target import AnyTarget

ROOT = Path(__file__).parents[1]
CELL_PX, COLUMNS, SUBSAMPLES = 240, 4, 4
BACKGROUND = 0.35
DISTANCE_MM = 400.0


def turned(angle_x_deg: float, angle_y_deg: float) -> np.ndarray:
    """vision_from_target of a target that faces the camera, turned about both axes."""
    a, b = math.radians(angle_x_deg), math.radians(angle_y_deg)
    about_x = np.array([[1, 0, 0], [0, math.cos(a), -math.sin(a)], [0, math.sin(a), math.cos(a)]])
    about_y = np.array([[math.cos(b), 0, math.sin(b)], [0, 1, 0], [-math.sin(b), 0, math.cos(b)]])
    pose = np.eye(4)
    pose[:3, :3] = np.diag([1.0, -1.0, -1.0]) @ about_x @ about_y
    return pose


def picture_of(target: AnyTarget, pose: np.ndarray) -> np.ndarray:
    """A square picture that the target just fills, each pixel the mean of 16 rays through one point, (h, w) in 0..1."""
    hull = np.concatenate(
        [apply(pose @ patch.target_from_patch, patch.mesh().reshape(-1, 3)) for patch in target.patches()]
    )
    middle = (hull.min(axis=0) + hull.max(axis=0)) / 2
    pose = pose.copy()
    pose[:3, 3] = [-middle[0], -middle[1], DISTANCE_MM - middle[2]]
    half = 1.06 * np.abs(hull[:, :2] - middle[:2]).max() / (DISTANCE_MM - np.ptp(hull[:, 2]) / 2)
    step = ((np.arange(CELL_PX * SUBSAMPLES) + 0.5) / (CELL_PX * SUBSAMPLES) * 2 - 1) * half
    x, y = np.meshgrid(step, step)
    direction = np.stack([x.ravel(), y.ravel(), np.ones(x.size)], axis=1)
    light = TargetLight([(target, pose)], BACKGROUND).radiance(np.zeros_like(direction), direction)
    return light.reshape(CELL_PX, SUBSAMPLES, CELL_PX, SUBSAMPLES).mean(axis=(1, 3))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("picture", type=Path, help="file to write")
    picture = parser.parse_args().picture
    files = sorted((ROOT / "stages/targets").glob("*.usda"))
    targets = [load(file).targets[0].target for file in files]
    flat = [len(target.patches()) == 1 and len(target.points().frames) == 1 for target in targets]
    pictures = [picture_of(t, turned(0, 0) if f else turned(25, -30)) for t, f in zip(targets, flat, strict=True)]
    rows = [pictures[i : i + COLUMNS] for i in range(0, len(pictures), COLUMNS)]
    rows[-1] += [np.full((CELL_PX, CELL_PX), 1.0)] * (COLUMNS - len(rows[-1]))
    sheet = np.concatenate([np.concatenate(row, axis=1) for row in rows])
    write_png(picture, np.rint(255 * np.clip(sheet, 0, 1) ** (1 / 2.2)).astype(np.uint8))
    print("\n".join(f"row {i // COLUMNS + 1}, {i % COLUMNS + 1}: {file.stem}" for i, file in enumerate(files)))


if __name__ == "__main__":
    main()
