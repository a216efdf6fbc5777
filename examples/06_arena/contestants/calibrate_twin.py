"""A stage fitted to the boards by this project: `pipeline calibrate`, from drawings that are off by their tolerances.

An owner does not know how good his detector is: he fits with some sigma, and again with the one that makes chi squared
what noise leaves. If that fit does not converge, he keeps the first.
"""

import tempfile
from pathlib import Path

import numpy as np

import pipeline
from pipeline.camera.figures.equivalent_pinhole import pinhole
from pipeline.files.tables import write_table
from pipeline.plugins.fits.calibration import calibrate as fitted_with
from pipeline.plugins.fits.free_numbers import FreeStage
from pipeline.plugins.fits.observations import Stated
from pipeline.plugins.fits.predicted_rows import points_of
from pipeline.plugins.fits.twin import Twin
from pipeline.results.ready_camera import ReadyCamera

ARENA = Path(__file__).resolve().parents[1]
"""Folder of the stages that the drawings lie over."""
SIGMA_PX, FINEST_PX, ENOUGH = 0.1, 1e-3, 1.5
"""Sigma of the first fit, the least of the second [px], and the ratio of both from which there is a second one."""


def calibrate(case, option):
    """Fit the drawings of the case."""
    stage = FreeStage(Path(str(case["drawings"])), ["Made"], [ARENA])
    columns = {"frame": case["view"] + 1, "point_id": case["point"]}
    twin = fitted(stage, columns | dict(zip(("x_px", "y_px"), case["image_px"].T, strict=True)), str(case["position"]))
    by, (variances, axes) = twin.solution.correction, np.linalg.eigh(twin.solution.covariance)
    one_sigma = [axis * np.sqrt(max(variance, 0.0)) for variance, axis in zip(variances, axes.T, strict=True)]
    cameras = [pipeline.ready(stage.at(by + more).cameras[0].camera) for more in (np.zeros(len(by)), *one_sigma)]
    centre_mm = np.array(pinhole(cameras[0].camera).centre_mm)
    slopes, offsets_mm = np.array([_lines(camera, case["query_px"], centre_mm) for camera in cameras]).swapaxes(0, 1)
    ours = np.diag([1.0, -1.0, -1.0, 1.0])  # the board as OpenCV has it: from its first point, with y down
    ours[:3, 3] = points_of(stage.nominal)["Board"].position_mm[0]
    poses = vision_poses(twin) @ ours
    poses[:, :3, 3] -= centre_mm
    return {
        "slopes": slopes[0],
        "offsets_mm": offsets_mm[0],
        "moved_slopes": slopes[1:],
        "moved_offsets_mm": offsets_mm[1:],
        "poses": poses,
        "rms_px": np.sqrt(np.mean(np.sum(twin.solution.residual_px**2, axis=1))),
        "values": values_of(twin),
        "sigmas": twin.solution.deviation,
        "names": np.array([number.name for number in stage.numbers]),
    }


def _lines(camera: ReadyCamera, query_px: np.ndarray, centre_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slopes of the rays of positions, and where they cross the plane of a centre, from there [mm]; (m, 2) each."""
    rays = camera.rays(*query_px.T)
    slopes, start_mm = rays.direction[:, :2] / rays.direction[:, 2:], rays.origin_mm - centre_mm
    return slopes, start_mm[:, :2] - slopes * start_mm[:, 2:]


def fitted(stage: FreeStage, columns: dict[str, np.ndarray], position: str) -> Twin:
    """The twin of a table of positions, of a kind that `calibrate` knows, with the sigma that they turn out to have."""
    with tempfile.TemporaryDirectory() as folder:
        table = Path(folder) / "corners.csv"
        lists = {name: column.tolist() for name, column in columns.items()}
        write_table(table, ["pixel_origin: 0", f"position: {position}"], lists)
        twin = fitted_with(stage, [table], Stated(sigma_px=SIGMA_PX))
        everything = twin.group("all", np.ones(len(twin.observations), bool))
        sigma_px = max(SIGMA_PX * np.sqrt(everything.chi2 / everything.expected), FINEST_PX)
        is_fair = abs(np.log(sigma_px / SIGMA_PX)) < np.log(ENOUGH)
        if is_fair:
            return twin
        again = fitted_with(stage, [table], Stated(sigma_px=sigma_px))
        return again if again.solution.converged else twin


def values_of(twin: Twin) -> np.ndarray:
    """Fitted values of the free numbers."""
    return np.array([number.before for number in twin.stage.numbers]) + twin.solution.correction


def vision_poses(twin: Twin) -> np.ndarray:
    """Poses of the boards, (v, 4, 4), to the vision frame of a camera that stands still."""
    nominal = twin.stage.nominal
    frame, camera = nominal.frames[0], nominal.cameras[0].name
    vision_from_world = frame.vision_from_target(camera, "Board") @ np.linalg.inv(frame.world_from_target["Board"])
    return np.asarray(vision_from_world @ twin.solution.poses)
