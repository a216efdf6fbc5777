"""A stage fitted to the boards by this project: `pipeline calibrate`, from drawings that are off by their tolerances.

An owner does not know how good his detector is: he fits with some sigma, and again with the one that makes chi squared
what noise leaves.
"""

import tempfile
from pathlib import Path

import numpy as np

import pipeline
from pipeline.camera.figures.equivalent_pinhole import pinhole
from pipeline.files.tables import write_table
from pipeline.plugins.fits.free_numbers import FreeStage
from pipeline.plugins.fits.observations import Stated
from pipeline.plugins.fits.predicted_rows import points_of
from pipeline.plugins.fits.twin import Twin
from pipeline.plugins.fits.twin import calibrate as fitted

ARENA = Path(__file__).resolve().parents[1]
"""Folder of the stages that the drawings lie over."""
SIGMA_PX, FINEST_PX, ENOUGH = 0.1, 1e-3, 1.5
"""Sigma of the first fit, the least of the second [px], and the ratio of both from which there is a second one."""


def calibrate(case, option):
    """Fit the drawings of the case."""
    stage = FreeStage(Path(str(case["drawings"])), ["Made"], [ARENA])
    twin = _fitted(stage, case, SIGMA_PX)
    everything = twin.group("all", np.ones(len(twin.observations), bool))
    sigma_px = max(SIGMA_PX * np.sqrt(everything.chi2 / everything.expected), FINEST_PX)
    if abs(np.log(sigma_px / SIGMA_PX)) > np.log(ENOUGH):
        twin = _fitted(stage, case, sigma_px)
    dataset = stage.at(twin.solution.by)
    ready = pipeline.ready(dataset.cameras[0].camera)
    centre_mm = np.array(pinhole(ready.camera).centre_mm)
    rays = ready.rays(*case["query_px"].T)
    slopes = rays.direction[:, :2] / rays.direction[:, 2:]
    start_mm = rays.origin_mm - centre_mm
    return {
        "slopes": slopes,
        "offsets_mm": start_mm[:, :2] - slopes * start_mm[:, 2:],
        "poses": _poses(twin, dataset, centre_mm),
        "rms_px": np.sqrt(np.mean(np.sum(twin.solution.residual_px**2, axis=1))),
        "values": np.array([number.before for number in stage.numbers]) + twin.solution.by,
        "sigmas": twin.solution.deviation,
        "names": np.array([number.name for number in stage.numbers]),
    }


def _fitted(stage: FreeStage, case, sigma_px: float) -> Twin:
    columns = {"frame": (case["view"] + 1).tolist(), "point_id": case["point"].tolist()}
    columns |= dict(zip(("x_px", "y_px"), case["image_px"].T.tolist(), strict=True))
    with tempfile.TemporaryDirectory() as folder:
        table = Path(folder) / "corners.csv"
        write_table(table, ["pixel_origin: 0", "position: exact"], columns)
        return fitted(stage, [table], Stated(sigma_px=sigma_px))


def _poses(twin: Twin, dataset, centre_mm: np.ndarray) -> np.ndarray:
    """Of boards as OpenCV has them, from their first point and y down, to a frame about the centre of projection."""
    ours = np.diag([1.0, -1.0, -1.0, 1.0])
    ours[:3, 3] = points_of(dataset)["Board"].position_mm[0]
    frame, camera = dataset.frames[0], dataset.cameras[0].name
    vision_from_world = frame.vision_from_target(camera, "Board") @ np.linalg.inv(frame.world_from_target["Board"])
    poses = vision_from_world @ twin.solution.poses @ ours
    poses[:, :3, 3] -= centre_mm
    return poses
