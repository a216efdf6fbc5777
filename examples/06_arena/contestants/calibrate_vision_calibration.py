"""vision-calibration: planar calibration with five coefficients, and with a tilted sensor (Scheimpflug)."""

import numpy as np
import vision_calibration as vc

MM_PER_M = 1000.0


def calibrate(case, option):
    """Calibrate one of the models."""
    seen = [((board["object_mm"] / MM_PER_M).tolist(), board["image_px"].tolist()) for board in case["boards"]]
    views = [vc.PlanarView(vc.Observation(points, places)) for points, places in seen]
    free = dict.fromkeys(("k1", "k2", "k3", "p1", "p2"), False)
    mask, solver = vc.CameraFixMask(distortion=free), vc.SolverConfig(max_iters=300)
    if option == "scheimpflug":
        config = vc.ScheimpflugIntrinsicsCalibrationConfig(solver=solver, fix_camera=mask, fix_poses=[])
        found = vc.run_scheimpflug_intrinsics(vc.PlanarDataset(views), config)
        tilt = found.camera.sensor.tilt_x, found.camera.sensor.tilt_y
    else:
        config = vc.PlanarCalibrationConfig(solver=solver, fix_camera=mask, fix_poses=[])
        found = vc.run_planar_intrinsics(vc.PlanarDataset(views), config)
        tilt = 0.0, 0.0
    poses = np.array([_matrix(pose) for pose in found.camera_se3_target])
    return {"slopes": _slopes(found.camera, tilt, case["query_px"]), "poses": poses}


def _matrix(pose):
    x, y, z, w = pose.rotation_xyzw
    q = np.array([x, y, z])
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turn = (w * w - q @ q) * np.eye(3) + 2 * np.outer(q, q) + 2 * w * cross
    return np.column_stack([turn, np.array(pose.translation_xyz) * MM_PER_M])


def _slopes(camera, tilt, query):
    """Pixels to the tilted plane, to the plane z = 1, and back through the distortion by fixed points."""
    k, d = camera.intrinsics, camera.distortion
    y = (query[:, 1] - k.cy) / k.fy
    x = (query[:, 0] - k.cx - k.skew * y) / k.fx
    cx, sx, cy, sy = np.cos(tilt[0]), np.sin(tilt[0]), np.cos(tilt[1]), np.sin(tilt[1])
    turn = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]]) @ np.array([[1, 0, 0], [0, cx, sx], [0, -sx, cx]])
    to_plane = np.linalg.inv(np.array([[turn[2, 2], 0, -turn[0, 2]], [0, turn[2, 2], -turn[1, 2]], [0, 0, 1]]) @ turn)
    bent = np.stack([x, y, np.ones(len(x))], axis=1) @ to_plane.T
    bent = bent[:, :2] / bent[:, 2:]
    plane = bent.copy()
    for _ in range(100):
        (u, v), r2 = plane.T, (plane**2).sum(axis=1)
        radial = 1 + r2 * (d.k1 + r2 * (d.k2 + r2 * d.k3))
        aside = [2 * d.p1 * u * v + d.p2 * (r2 + 2 * u * u), d.p1 * (r2 + 2 * v * v) + 2 * d.p2 * u * v]
        plane = (bent - np.stack(aside, axis=1)) / radial[:, None]
    return plane
