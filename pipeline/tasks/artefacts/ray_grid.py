"""Reading of the rays of a camera from the files of other tasks."""

import numpy as np

from pipeline.files.exr_bands import ExrWindows
from pipeline.files.tables import read_table
from pipeline.tasks.artefacts.cameras import Inputs
from pipeline.tasks.rays import MOMENTS
from pipeline.truth.grid.ray_grid import AnyRayGrid, RayGrid


class RayFile(AnyRayGrid):
    """The rays of a camera in rays.exr and, of a plenoptic one, micro_images.csv; read window by window.

    Attributes are those of `RayGrid`.
    """

    def __init__(self, inputs: Inputs) -> None:
        self._file = ExrWindows(inputs["rays"]["rays.exr"])
        near, far = (self._file.headers[name].texts for name in ("near", "far"))
        self.supersampling = int(near["supersampling"])
        self._planes_mm = float(near["plane_z_mm"]), float(far["plane_z_mm"])
        self._square_steps = 1.0 if near["footprint"] == "pixel" else 0.0
        self.microlenses: np.ndarray = np.zeros((1, 3), np.int64)
        self.centres_px: np.ndarray | None = None
        if "micro_images" in inputs:
            table = read_table(inputs["micro_images"]["micro_images.csv"])
            names = ("microlens_k", "microlens_l", "microlens_type")
            self.microlenses = np.stack([table.numbers(name) for name in names], axis=1).astype(np.int64)
            self.centres_px = np.stack([table.numbers("centre_x_px"), table.numbers("centre_y_px")], axis=1)

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the image."""
        height, width = self._file.headers["moments"].shape
        return width, height

    def window(self, rows: slice, columns: slice) -> RayGrid:
        """The bundles of some rows and columns of the image."""
        k = self.supersampling
        fine = slice(rows.start * k, rows.stop * k), slice(columns.start * k, columns.stop * k)
        near, far, error = (rows_of(self._file, name, *fine, "X", "Y") for name in ("near", "far", "error"))
        cell = np.zeros(near.shape[:2], np.int64)
        if self.centres_px is not None:
            cell = _rows_of(rows_of(self._file, "microlens", *fine, "k", "l").astype(np.int64), self.microlenses)
        return RayGrid(
            supersampling=k,
            near_mm=self._planes_mm[0],
            far_mm=self._planes_mm[1],
            near=near,
            far=far,
            covariance=rows_of(self._file, "moments", rows, columns, *MOMENTS),
            hit_fraction=rows_of(self._file, "hit_fraction", *fine, "Y")[..., 0],
            error_px=error,
            cell=cell,
            microlenses=self.microlenses,
            centres_px=self.centres_px,
            square_steps=self._square_steps,
            first_px=(columns.start, rows.start),
        )


def rows_of(file: ExrWindows, part: str, rows: slice, columns: slice, *channels: str) -> np.ndarray:
    """Channels of a window of a part side by side, (h, w, n) float64."""
    pixels = file.rows(part, rows.start, rows.stop)
    return np.stack([pixels[name][:, columns] for name in channels], axis=-1).astype(np.float64)


def _rows_of(axial: np.ndarray, microlenses: np.ndarray) -> np.ndarray:
    """Index in the table of microlenses for every (k, l) of an image, (h, w)."""
    low = microlenses[:, :2].min(axis=0)
    size = microlenses[:, :2].max(axis=0) - low + 1
    rows = np.full(size, -1)
    rows[tuple((microlenses[:, :2] - low).T)] = np.arange(len(microlenses))
    return rows[tuple(np.moveaxis(axial - low, -1, 0))]
