"""The twin: the stage of the camera, fitted to rows of the boards, from drawings that are off by its tolerances.

Its lens is that of the camera: what an owner knows, and no other program is told.
"""

from pathlib import Path

import numpy as np
import rows
from calibrating import true_numbers, write_drawings
from contestants.calibrate_twin import fitted, values_of, vision_poses
from judge import numbers_kept
from judging import Answer, Calibration, judged
from rows import Rows
from scipy.spatial import cKDTree
from truth import Truth

import pipeline
from pipeline.plugins.fits.free_numbers import FreeStage
from pipeline.plugins.fits.twin import Twin
from pipeline.results.ready_camera import ReadyCamera

_NEAR_MM = 0.02
"""Distance over which positions follow points by their derivatives [mm]: even near focus they are right to 1e-3 px."""
_ACCURACY_PX, _NOISE_PX = 1e-4, 0.1
_MOST = 800
"""Most rows of a fit, evenly taken from all: its processor time grows with their number."""


class Solved:
    """A camera that images points by the solver of the truth, and those near them by derivatives: searches ask for
    many.
    """

    def __init__(self, ready: ReadyCamera) -> None:
        self._ready = ready
        self._at, self._x_px, self._slopes = np.empty((0, 4)), np.empty((0, 2)), np.empty((0, 2, 3))

    def project(self, points_mm: np.ndarray, microlens: np.ndarray) -> np.ndarray:
        """Positions (n, 2) of points (n, 3) through microlenses (n,), NaN where there is none [px]."""
        at = np.column_stack([points_mm / _NEAR_MM, 10.0 * microlens])
        distance, row = cKDTree(self._at).query(at, distance_upper_bound=1.0)
        if (far := np.isinf(distance)).any():
            self._solve(at[far], points_mm[far], microlens[far])
            distance, row = cKDTree(self._at).query(at, distance_upper_bound=1.0)
        near, x_px = np.isfinite(distance), np.full((len(at), 2), np.nan)
        by_mm = (at[near] - self._at[row[near]])[:, :3] * _NEAR_MM
        x_px[near] = self._x_px[row[near]] + np.einsum("nij,nj->ni", self._slopes[row[near]], by_mm)
        return x_px

    def _solve(self, at: np.ndarray, points_mm: np.ndarray, microlens: np.ndarray) -> None:
        points, of = np.unique(points_mm, axis=0, return_inverse=True)
        seen = self._ready.project(points, accuracy_px=_ACCURACY_PX, derivatives=["point"])
        pairs = zip(seen.point.tolist(), rows.numbers(self._ready, seen.microlens).tolist(), strict=True)
        row_of = {pair: row for row, pair in enumerate(pairs)}
        found = np.array([row_of.get(pair, -1) for pair in zip(of.ravel().tolist(), microlens.tolist(), strict=True)])
        slopes = seen.derivatives["point"]
        kept = np.flatnonzero((found >= 0) & np.isfinite(slopes[found]).all(axis=(1, 2)))
        self._at = np.concatenate([self._at, at[kept]])
        self._x_px = np.concatenate([self._x_px, np.stack([seen.x_px, seen.y_px], axis=1)[found[kept]]])
        self._slopes = np.concatenate([self._slopes, slopes[found[kept]]])


def build(snapshots: Path | None, programs: Path) -> None:
    """Nothing: it is this project."""


def run(programs: Path, task: Path, known: Answer) -> Answer:
    """How many repeats with noise there are: fits need the truth's rows, as floors do."""
    return {"noises": len(list(task.glob("noise_*")))}


def twin_judged(truth: Truth, answer: Answer, task: Path, known: Answer) -> Answer:
    """Fits to exact rows and to noisy ones as floors get them, each from drawings of its own."""
    stage = task.parent / "dataset.usda"
    noisy = [truth.boards.noisy(_NOISE_PX, np.random.default_rng([7, 1 + n])) for n in range(answer["noises"])]
    exact, *repeats = [_fitted(truth, stage, some, task / f"{n}.usda") for n, some in enumerate([truth.boards, *noisy])]
    true = true_numbers(stage)
    result = judged(truth, {"exact": _calibration(exact)}, [*map(_calibration, repeats)], true)
    if repeats:
        values, sigmas = np.array([(values_of(twin), twin.solution.deviation) for twin in repeats]).swapaxes(0, 1)
        result["honesty"] = [numbers_kept([*true], values, sigmas, np.array([*true.values()]))]
    return result


def _fitted(truth: Truth, stage: Path, boards: Rows, drawings: Path) -> Twin:
    half_px = np.array(truth.rig.size_px) / 2
    inside = np.flatnonzero((np.abs(boards.image_px + 0.5 - half_px) < half_px).all(axis=1))  # noise moves some out
    boards = boards.only(inside[:: -(-len(inside) // _MOST)])
    write_drawings(stage, drawings, f"{truth.rig.name} {drawings.stem}")
    columns = {"frame": boards.view + 1, "point_id": boards.point}
    columns |= dict(zip(("microlens_k", "microlens_l"), truth.ready.rig.axial[boards.microlens].T, strict=True))
    columns |= dict(zip(("x_px", "y_px"), boards.image_px.T, strict=True))
    return fitted(FreeStage(drawings, ["Made"], [stage.parent]), columns, "exact")


def _calibration(twin: Twin) -> Calibration:
    names = [number.name for number in twin.stage.numbers]
    values = dict(zip(names, values_of(twin).tolist(), strict=True))
    views = np.array([frame - 1 for frame, _ in twin.views.keys])
    rms_px = float(np.sqrt(np.nanmean((twin.solution.residual_px**2).sum(axis=1))))
    camera = pipeline.ready(twin.stage.at(twin.solution.by).cameras[0].camera)
    return Calibration(Solved(camera), values, vision_poses(twin), views, rms_px)
