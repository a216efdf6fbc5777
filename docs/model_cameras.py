"""The rig of example 01 as what calibrations assume of it: how far its truth is from OpenCV's projection.

python docs/model_cameras.py

The projection is that of the pinhole which the build itself states, with its
poses. docs/model_cameras.md quotes the table.
"""

import argparse
import tempfile
from pathlib import Path

import cv2
import numpy as np

from pipeline.app.build import build
from pipeline.results.output import open_output

ROOT = Path(__file__).resolve().parents[1]
ROUNDING_PX = 1e-11
"""Largest rounding of positions near 640 px [px]: a hundred units of their last digit."""
DISTORTION = (-0.5, 2.0, 0.001, -0.002, 0.0)
MODELS = {
    "prescription": "",
    "thinLens": 'uniform token plen:camera:model = "thinLens"',
    "thinLens with distortion": f'uniform token plen:camera:model = "thinLens"\n'
    f"uniform double[] plen:camera:distortion = {list(DISTORTION)}",
    "pinhole": 'uniform token plen:camera:model = "pinhole"',
    "pinhole with distortion": f'uniform token plen:camera:model = "pinhole"\n'
    f"uniform double[] plen:camera:distortion = {list(DISTORTION)}",
}
STAGE = """#usda 1.0
(
    defaultPrim = "Conventional"
    endTimeCode = 6
    metersPerUnit = 0.001
    startTimeCode = 1
    subLayers = [@{example}@]
    timeCodesPerSecond = 24
    upAxis = "Y"
)
over "Conventional"
{{
    over "Rig"
    {{
        over "Camera"
        {{
            uniform int plen:image:samples = 4
            {opinions}
        }}
    }}
}}
"""


def differences_px(opinions: str) -> np.ndarray:
    """Truth less projection of every row of a model, (n, 2) [px]."""
    with tempfile.TemporaryDirectory() as name:
        stage = Path(name) / "stage.usda"
        example = ROOT / "examples/01_conventional/dataset.usda"
        stage.write_text(STAGE.format(example=example.as_posix(), opinions=opinions))
        result = build(stage, Path(name) / "out", allow_roots=[ROOT])
        if result.exit_code:
            raise SystemExit(str([task.error for task in result.failures]))
        output = open_output(Path(name) / "out")
        pinhole, found = output.camera.pinhole_with_distortion, []
        rows = output.correspondences
        for frame in np.unique(rows["frame"]):
            own, view = rows[rows["frame"] == frame], output.view(int(frame))
            pose = view.poses.pinhole_from_target["Board"]
            points = np.stack([own[f"target_{axis}_mm"] for axis in "xyz"], axis=1)
            turn, shift = cv2.Rodrigues(pose[:3, :3])[0], pose[:3, 3]
            projected = cv2.projectPoints(points, turn, shift, pinhole.matrix, pinhole.distortion)[0]
            found.append(np.stack([own["x_px"], own["y_px"]], axis=1) - projected[:, 0])
    return np.concatenate(found)


def main() -> None:
    """Print the table."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    print("| model | rows | rms px | largest px |\n| --- | --- | --- | --- |")
    for name, opinions in MODELS.items():
        off = np.hypot(*differences_px(opinions).T)
        figures = [_shown(value) for value in (np.sqrt(np.mean(off**2)), off.max())]
        print(f"| {name} | {len(off)} | {' | '.join(figures)} |", flush=True)


def _shown(value_px: float) -> str:
    """A length; roundings, which differ between processors, by their bound."""
    return f"{value_px:.4f}" if value_px > ROUNDING_PX else f"below {ROUNDING_PX:g}"


if __name__ == "__main__":
    main()
