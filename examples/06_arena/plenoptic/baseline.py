"""The floors of the arena: models fitted to all rows with the poses of the boards, by SciPy.

One is a thin lens before pinholes, the model of libpleno and its relatives without a tilt, as
`pipeline.plugins.fits.thin_plenoptic` states it, with the pitch of the array; the other is that of Bok and Nousias.
Both start at the first-order truth, so that what is left is the model's own error, and nothing that a search missed.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from judging import Calibration
from models import projective, projective_of_thin_lens
from rows import Rows
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from truth import Model, Truth

from pipeline.camera.figures.first_order_figures import report
from pipeline.fits.thin_lens import thin_lens
from pipeline.plugins.fits.thin_plenoptic import PARAMETERS, positions_mm

_UNITS = np.array([0.1, 0.1, 0.1, 0.01, 1e-4, 0.01, 0.01, 0.01, 0.01, 1e-5, 1e-7, 1e-9])
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
class Floor:
    """A model to be fitted."""

    names: tuple[str, ...]  # of its parameters
    first: np.ndarray  # values
    units: np.ndarray  # steps that move positions by something like a pixel
    model: Callable[[np.ndarray], Model]  # of such values
    front_z_mm: float  # where it has Z = 0, vision frame

    @property
    def true(self) -> dict[str, float]:
        """The first values by name."""
        return dict(zip(self.names, self.first.tolist(), strict=True))


def thin_lens_floor(truth: Truth) -> Floor:
    """The thin lens of the camera's first-order figures, with distortion, and shifts of array and sensor."""
    figures = report(truth.ready.camera)
    lens = thin_lens(figures, np.array([kind["focal_length_mm"] for kind in figures["mla"]["types"]]))
    origin_px = truth.ready.rig.tracer.pixels_at(np.zeros((1, 2)))[0]
    front_z_mm = figures["lens"]["principal_planes_mm"][0]
    free = [name for name in PARAMETERS if name != "lens_z_mm"]  # which the poses have
    rows = [PARAMETERS.index(name) for name in free]
    first = np.zeros(len(PARAMETERS))
    first[[PARAMETERS.index(name) for name in ("focal_mm", "main_lens_mm", "sensor_mm")]] = (
        lens.focal_mm, lens.main_lens_mm, lens.sensor_mm,
    )  # fmt: skip

    def model(values: np.ndarray) -> ThinLens:
        parameters = np.zeros(len(PARAMETERS))
        parameters[rows] = values
        return ThinLens(parameters, truth.vertex_mm, origin_px, truth.rig.pixel_mm)

    return Floor(tuple(free), first[rows], _UNITS[rows], model, front_z_mm)


def projective_floor(truth: Truth, thin: Floor) -> Floor:
    """The model of Bok and Nousias that is a thin lens, before the true centres of the micro-images."""
    first = projective_of_thin_lens(thin.first, thin.model(thin.first).origin_px, truth.rig.pixel_mm)
    return Floor(
        tuple(first),
        np.array([*first.values()]),
        np.array([0.1, 10.0, 10.0, 10.0, 1.0, 1.0]),
        lambda values: projective(values, truth.centre_px),
        thin.front_z_mm,
    )


def calibrate(truth: Truth, floor: Floor, rows: Rows) -> Calibration:
    """Fit parameters and poses to rows of boards."""
    free, views = len(floor.first), len(truth.poses)

    def split(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        motion = p[free:].reshape(views, 6) * ([1e-3] * 3 + [0.1] * 3)
        poses = truth.poses.copy()
        poses[:, :3, :3] = Rotation.from_rotvec(motion[:, :3]).as_matrix() @ poses[:, :3, :3]
        poses[:, :3, 3] += motion[:, 3:] - [0, 0, floor.front_z_mm]
        return floor.first + p[:free] * floor.units, poses

    def residuals(p: np.ndarray) -> np.ndarray:
        parameters, poses = split(p)
        points = np.einsum("nij,nj->ni", poses[rows.view, :3, :3], rows.points_mm) + poses[rows.view, :3, 3]
        return (floor.model(parameters).project(points, rows.microlens) - rows.image_px).ravel()

    def slopes(p: np.ndarray) -> np.ndarray:
        """Central differences; those of all poses together, because a row depends on one."""
        matrix = np.zeros((2 * len(rows.view), len(p)))
        for column in range(free + 6):
            step = np.zeros(len(p))
            step[column if column < free else slice(column, None, 6)] = _STEP
            change = (residuals(p + step) - residuals(p - step)) / (2 * _STEP)
            if column < free:
                matrix[:, column] = change
            else:
                view = np.repeat(rows.view, 2)
                matrix[np.arange(len(change)), free + 6 * view + column - free] = change
        return matrix

    ends = {"method": "lm", "x_scale": "jac", "xtol": 1e-9, "ftol": 1e-9}
    best = least_squares(residuals, np.zeros(free + 6 * views), jac=slopes, **ends).x
    parameters, poses = split(best)
    lengths = (residuals(best).reshape(-1, 2) ** 2).sum(axis=1)
    values = dict(zip(floor.names, parameters.tolist(), strict=True))
    return Calibration(floor.model(parameters), values, poses, np.arange(views), float(np.sqrt(lengths.mean())))
