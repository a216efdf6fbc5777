"""Calibrate the camera of this example with OpenCV from its exact image positions, and compare with what is known.

    python examples/01_conventional/calibrate.py [OUT]      OUT: what `pipeline build` made, else build/01_conventional

What is known is the pinhole in camera.json, which fits the mean rays of this lens best, and the poses to it in
poses.json: OpenCV's origin is a centre of projection, not the aperture stop that all other distances count from. The
error does not vanish although nobody measured anything: a pinhole with distortion is a model of this lens, whose
bundles have no common centre. The rest is the sampling of the ground truth (sigma_x_px).
"""

import argparse
import csv
import json
import sys
from pathlib import Path

import cv2
import numpy as np

# 6.4 mm of sensor 128 mm behind the pupil see 3 degrees. So narrow a field cannot tell a shifted principal point from a
# turned board, nor one distortion coefficient from the next. The principal point therefore stays at the image centre,
# where this rig has its axis; estimated are one principal distance, k1 and the poses.
FLAGS = (
    cv2.CALIB_FIX_PRINCIPAL_POINT
    | cv2.CALIB_FIX_ASPECT_RATIO
    | cv2.CALIB_ZERO_TANGENT_DIST
    | cv2.CALIB_FIX_K2
    | cv2.CALIB_FIX_K3
    | cv2.CALIB_USE_INTRINSIC_GUESS
)
STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 1000, 1e-14)


def points(table: Path) -> tuple[np.ndarray, np.ndarray]:
    """Target points (n, 3) [mm] and their image positions (n, 2) [px], both single precision as OpenCV wants them."""
    rows = csv.DictReader(line for line in table.read_text().splitlines() if not line.startswith("#"))
    names = ("target_x_mm", "target_y_mm", "target_z_mm", "x_px", "y_px")
    values = np.array([[row[name] for name in names] for row in rows], dtype=np.float32)
    return values[:, :3].copy(), values[:, 3:].copy()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", nargs="?", type=Path, default=Path("build/01_conventional"), help="folder of a build")
    out = parser.parse_args().out
    if not (out / "manifest.json").exists():
        sys.exit(f"{out} holds no finished build; first: pipeline build examples/01_conventional/dataset.usda")
    camera = json.loads(next(out.glob("cameras/*/camera.json")).read_text())
    frames = sorted(table.parent for table in out.glob("frames/*/*/correspondences.csv"))
    target_points, image_points = zip(*(points(frame / "correspondences.csv") for frame in frames), strict=True)
    guess = np.array(
        [[1e4, 0, (camera["resolution"][0] - 1) / 2], [0, 1e4, (camera["resolution"][1] - 1) / 2], [0, 0, 1]]
    )
    rms, matrix, distortion, turns, shifts = cv2.calibrateCamera(
        target_points, image_points, camera["resolution"], guess, None, flags=FLAGS, criteria=STOP
    )

    found, true = matrix[0, 0] * camera["pixel_pitch_mm"], camera["pinhole"]["with_distortion"]["principal_distance_mm"]
    print(
        f"{len(frames)} frames, {sum(map(len, image_points))} points, RMS {rms:.4f} px, k1 {distortion.ravel()[0]:+.3f}"
    )
    print(f"fx * pitch {found:.3f} mm, principal distance {true:.3f} mm, difference {100 * (found / true - 1):+.3f} %")
    for frame, turn, shift in zip(frames, turns, shifts, strict=True):
        (pose,) = json.loads((frame / "poses.json").read_text())["targets"].values()
        x, y, z = shift.ravel() - pose["pinhole"]["tvec"]
        known_turn = cv2.Rodrigues(np.array(pose["pinhole"]["rvec"]))[0]
        angle = np.degrees(np.linalg.norm(cv2.Rodrigues(cv2.Rodrigues(turn)[0] @ known_turn.T)[0]))
        print(f"{frame.relative_to(out)}: board off by ({x:+.3f}, {y:+.3f}, {z:+.3f}) mm, {angle:.4f} degrees")


if __name__ == "__main__":
    main()
