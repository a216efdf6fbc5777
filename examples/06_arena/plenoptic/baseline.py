"""The floor of the arena: a thin lens before pinholes, fitted to all rows with the poses of the boards, by SciPy.

It is the model of libpleno and its relatives without a tilt, as `pipeline.fits.thin_plenoptic` states it. It starts at
the truth and its pitch is that of the array, so that what is left is the model's own error, and nothing that a search
missed.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from truth import Rows, Truth

from pipeline.fits.thin_plenoptic import PARAMETERS, positions_mm

_SCALES = np.array([0.1, 0.1, 0.1, 0.01, 1e-4, 0.01, 0.01, 0.01, 0.01, 1e-5, 1e-7, 1e-9])
"""Units in which the parameters are counted: each moves positions by something like a pixel."""
_STEP = 1e-4
"""Step of differences, in these units: errors of 1e-8 and of rounding are as small."""


@dataclass(frozen=True, slots=True)
class ThinLens:
    """A thin lens before pinholes: parameters in the order of `PARAMETERS`."""

    parameters: np.ndarray
    vertex_mm: np.ndarray
    origin_px: np.ndarray
    pixel_mm: float

    def project(self, points_mm: np.ndarray, microlens: np.ndarray) -> np.ndarray:
        """Positions (n, 2) of points (n, 3) through microlenses (n,) [px]."""
        places = positions_mm(self.parameters, points_mm, self.vertex_mm[microlens])
        return self.origin_px - (places - self.parameters[7:9]) / self.pixel_mm


@dataclass(frozen=True, slots=True)
class Calibration:
    """A fitted model, the poses of its views (v, 4, 4), and the residual that a calibration would print [px]."""

    model: ThinLens
    poses: np.ndarray
    rms_px: float


def start(truth: Truth) -> ThinLens:
    """The thin lens of the camera's first-order figures."""
    from pipeline.camera.figures.first_order_figures import report
    from pipeline.exports.thin_lens import thin_lens

    figures = report(truth.ready.camera)
    lens = thin_lens(figures, np.array([kind["focal_length_mm"] for kind in figures["mla"]["types"]]))
    parameters = np.zeros(len(PARAMETERS))
    parameters[:4] = lens.focal_mm, figures["lens"]["principal_planes_mm"][0], lens.main_lens_mm, lens.sensor_mm
    tracer = truth.ready.rig.tracer
    return ThinLens(parameters, truth.vertex_mm, tracer.pixels_at(np.zeros((1, 2)))[0], truth.rig.pixel_mm)


def calibrate(truth: Truth, first: ThinLens, rows: Rows) -> Calibration:
    """Fit lens and poses to rows of boards, from a first lens on."""
    views = len(truth.poses)
    free = np.flatnonzero([name != "lens_z_mm" for name in PARAMETERS])  # which the poses have

    def split(p: np.ndarray) -> tuple[ThinLens, np.ndarray]:
        parameters = first.parameters.copy()
        parameters[free] += p[: len(free)] * _SCALES[free]
        motion = p[len(free) :].reshape(views, 6) * ([1e-3] * 3 + [0.1] * 3)
        poses = truth.poses.copy()
        poses[:, :3, :3] = Rotation.from_rotvec(motion[:, :3]).as_matrix() @ poses[:, :3, :3]
        poses[:, :3, 3] += motion[:, 3:]
        return ThinLens(parameters, first.vertex_mm, first.origin_px, first.pixel_mm), poses

    def residuals(p: np.ndarray) -> np.ndarray:
        model, poses = split(p)
        points = np.einsum("nij,nj->ni", poses[rows.view, :3, :3], rows.points_mm) + poses[rows.view, :3, 3]
        return (model.project(points, rows.microlens) - rows.image_px).ravel()

    def slopes(p: np.ndarray) -> np.ndarray:
        """Central differences; those of all poses together, because a row depends on one."""
        matrix = np.zeros((2 * len(rows.view), len(p)))
        for column in range(len(free) + 6):
            step = np.zeros(len(p))
            step[column if column < len(free) else slice(column, None, 6)] = _STEP
            change = (residuals(p + step) - residuals(p - step)) / (2 * _STEP)
            if column < len(free):
                matrix[:, column] = change
            else:
                view = np.repeat(rows.view, 2)
                matrix[np.arange(len(change)), len(free) + 6 * view + column - len(free)] = change
        return matrix

    ends = {"method": "lm", "x_scale": "jac", "xtol": 1e-9, "ftol": 1e-9}
    best = least_squares(residuals, np.zeros(len(free) + 6 * views), jac=slopes, **ends).x
    model, poses = split(best)
    lengths = (residuals(best).reshape(-1, 2) ** 2).sum(axis=1)
    return Calibration(model, poses, float(np.sqrt(lengths.mean())))
