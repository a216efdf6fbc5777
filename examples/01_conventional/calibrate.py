"""Calibrate the camera of this example with OpenCV from its exact image positions, and compare with what is known.

    python examples/01_conventional/calibrate.py [OUT]      OUT: what `pipeline build` made, else build/01_conventional

What is known is the pinhole in camera.json, which fits the mean rays of this lens best, and the poses to it in
poses.json: OpenCV's origin is a centre of projection, not the aperture stop that all other distances count from. The
error does not vanish although nobody measured anything: a pinhole with distortion is a model of this lens, whose
bundles have no common centre. The rest is the sampling of the ground truth (sigma_x_px).
"""

import argparse
import sys

import cv2
import numpy as np

import pipeline
from pipeline.errors import PipelineError

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


parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("out", nargs="?", default="build/01_conventional", help="folder of a build")
try:
    output = pipeline.open_output(parser.parse_args().out)
except PipelineError as error:
    sys.exit(f"{error}\nfirst: pipeline build examples/01_conventional/dataset.usda")
camera, pinhole = output.camera, output.camera.pinhole_with_distortion
tables = [view.correspondences for view in camera.views]
# Single precision, as OpenCV wants it.
target_points = [np.stack([t.target_x_mm, t.target_y_mm, t.target_z_mm], axis=1).astype(np.float32) for t in tables]
image_points = [np.stack([t.x_px, t.y_px], axis=1).astype(np.float32) for t in tables]
(width, height), pitch_mm = camera.size_px, camera.pitch_mm
guess = np.array([[1e4, 0, (width - 1) / 2], [0, 1e4, (height - 1) / 2], [0, 0, 1]])
rms, matrix, distortion, turns, shifts = cv2.calibrateCamera(
    target_points, image_points, camera.size_px, guess, None, flags=FLAGS, criteria=STOP
)

fitted_mm, true_mm = matrix[0, 0] * pitch_mm, pinhole.principal_distance_px * pitch_mm
print(f"{len(tables)} frames, {sum(map(len, tables))} points, RMS {rms:.4f} px, k1 {distortion.ravel()[0]:+.3f}")
off_percent = 100 * (fitted_mm / true_mm - 1)
print(f"fx * pitch {fitted_mm:.3f} mm, principal distance {true_mm:.3f} mm, difference {off_percent:+.3f} %")
for view, turn, shift in zip(camera.views, turns, shifts, strict=True):
    (true_pose,) = view.poses.pinhole_from_target.values()
    x, y, z = shift.ravel() - true_pose[:3, 3]
    angle = np.degrees(np.linalg.norm(cv2.Rodrigues(cv2.Rodrigues(turn)[0] @ true_pose[:3, :3].T)[0]))
    print(f"frames/{view.frame:04d}/{view.camera}: board off by ({x:+.3f}, {y:+.3f}, {z:+.3f}) mm, {angle:.4f} degrees")
