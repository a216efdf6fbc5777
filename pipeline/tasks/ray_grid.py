"""The rays of a camera, read back from the files of other tasks."""

import numpy as np

from pipeline.files.exr import Part, read_exr
from pipeline.files.tables import read_table
from pipeline.tasks.cameras import Inputs
from pipeline.tasks.rays import MOMENTS
from pipeline.truth.grid import RayGrid


def read_grid(inputs: Inputs) -> RayGrid:
    """The rays of a camera, from rays.exr and, for a plenoptic one, micro_images.csv."""
    parts = read_exr(inputs["rays"]["rays.exr"])
    near, far = parts["near"], parts["far"]
    cell = np.zeros(near.shape, np.int64)
    microlenses, centres = np.zeros((1, 3), np.int64), None
    if "micro_images" in inputs:
        table = read_table(inputs["micro_images"]["micro_images.csv"])
        names = ("microlens_k", "microlens_l", "microlens_type")
        microlenses = np.stack([table.numbers(name) for name in names], axis=1).astype(np.int64)
        centres = np.stack([table.numbers("centre_x_px"), table.numbers("centre_y_px")], axis=1)
        cell = _rows_of(channels_of(parts["microlens"], "k", "l").astype(np.int64), microlenses)
    return RayGrid(
        supersampling=int(near.attributes["supersampling"]),
        near_mm=float(near.attributes["plane_z_mm"]),
        far_mm=float(far.attributes["plane_z_mm"]),
        near=channels_of(near, "X", "Y"),
        far=channels_of(far, "X", "Y"),
        covariance=channels_of(parts["moments"], *MOMENTS),
        hit_fraction=channels_of(parts["hit_fraction"], "Y")[..., 0],
        error_px=channels_of(parts["error"], "X", "Y"),
        cell=cell,
        microlenses=microlenses,
        centres_px=centres,
        square_steps=1.0 if near.attributes["footprint"] == "pixel" else 0.0,
    )


def channels_of(part: Part, *channels: str) -> np.ndarray:
    """Channels of a part side by side, (h, w, n) float64."""
    return np.stack([part.channels[name] for name in channels], axis=-1).astype(np.float64)


def _rows_of(axial: np.ndarray, microlenses: np.ndarray) -> np.ndarray:
    """Row in the table of microlenses for every (k, l) of an image, (h, w)."""
    low = microlenses[:, :2].min(axis=0)
    size = microlenses[:, :2].max(axis=0) - low + 1
    rows = np.full(size, -1)
    rows[tuple((microlenses[:, :2] - low).T)] = np.arange(len(microlenses))
    return rows[tuple(np.moveaxis(axial - low, -1, 0))]
