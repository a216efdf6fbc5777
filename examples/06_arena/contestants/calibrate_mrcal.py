"""mrcal of Debian by its own command, mrcal-calibrate-cameras: OPENCV8 and splined stereographic.

The board is held flat, and no outlier is looked for, because there are none. What mrcal states is the covariance of a
projection at the distance that the case names.
"""

import subprocess
import tempfile
from pathlib import Path

import mrcal
import numpy as np

MM_PER_M = 1000.0
MODELS = {
    "opencv8": "LENSMODEL_OPENCV8",
    "splined": "LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=10_Ny=8_fov_x_deg=60",
}


def calibrate(case, option):
    """Calibrate one of the models."""
    spacing = float(case["square_mm"]) / MM_PER_M
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _write_corners(case, folder / "corners.vnl")
        command = ["mrcal-calibrate-cameras", "--corners-cache", "corners.vnl", "--lensmodel", MODELS[option]]
        command += ["--focal", float(case["focal_guess_px"]), "--imagersize", *case["size_px"], "--outdir", "."]
        command += ["--object-spacing", spacing, "--object-width-n", case["columns"], "--object-height-n", case["rows"]]
        command += ["--skip-outlier-rejection", "--skip-calobject-warp-solve", "*.png"]
        subprocess.run([str(word) for word in command], cwd=folder, check=True, capture_output=True)
        model = mrcal.cameramodel(str(folder / "camera-0.cameramodel"))
    inputs = model.optimization_inputs()
    rays = mrcal.unproject(case["query_px"], *model.intrinsics(), normalize=True)
    turn_and_shift = mrcal.Rt_from_rt(inputs["frames_rt_toref"])
    poses = np.array([np.column_stack([one[:3], one[3] * MM_PER_M]) for one in turn_and_shift])
    stated_px2 = mrcal.projection_uncertainty(rays * float(case["distance_mm"]) / MM_PER_M, model, what="covariance")
    return {"slopes": rays[:, :2] / rays[:, 2:], "poses": poses, "stated_px2": stated_px2}


def _write_corners(case, path):
    """Corners of all views in the order of the grid; a point that was not seen keeps its row."""
    lines = ["# filename x y level"]
    for view, board in enumerate(case["boards"]):
        seen = dict(zip(board["point"].tolist(), board["image_px"], strict=True))
        for point in range(int(case["columns"]) * int(case["rows"])):
            place = f"{seen[point][0]:.9f} {seen[point][1]:.9f} 0" if point in seen else "- - -"
            lines.append(f"{view:03d}.png {place}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
