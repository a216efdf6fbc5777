"""lensboy: OpenCV's standard model, and its pinhole with a splined distortion; flat boards are not allowed to warp."""

import lensboy as lb
import numpy as np

CONFIGS = {
    "opencv": lambda width, height, focal: lb.OpenCVConfig(
        image_height=height,
        image_width=width,
        initial_focal_length=focal,
        included_distortion_coefficients=lb.OpenCVConfig.STANDARD,
    ),
    "spline": lambda width, height, focal: lb.PinholeSplinedConfig(
        image_height=height, image_width=width, num_knots_x=12, num_knots_y=9, initial_focal_length=focal
    ),
}


def calibrate(case, option):
    """Calibrate one of the models."""
    points = np.unique(case["point"])
    target = np.array([case["object_mm"][case["point"] == point][0] for point in points])
    frames = [lb.Frame(np.searchsorted(points, board["point"]), board["image_px"]) for board in case["boards"]]
    width, height = map(int, case["size_px"])
    config = CONFIGS[option](width, height, float(case["focal_guess_px"]))
    found = lb.calibrate_camera(target, frames, config, estimate_target_warp=False)
    poses = [np.full((3, 4), np.nan) if pose is None else pose.matrix[:3] for pose in found.cameras_from_target]
    rays = found.camera_model.normalize_points(case["query_px"])
    return {"slopes": rays[:, :2] / rays[:, 2:], "poses": np.array(poses)}
