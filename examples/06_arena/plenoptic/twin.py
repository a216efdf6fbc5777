"""The twin: the stage of the camera, fitted to rows of the boards, from drawings that are off by its tolerances.

Its lens is that of the camera: what an owner knows, and no other program is told.
"""

from pathlib import Path

import numpy as np
from calibrating import true_numbers, write_drawings
from contestants.calibrate_twin import fitted, values_of, vision_poses
from judge import numbers_kept
from judging import Answer, Calibration, judged
from rows import Rows
from scipy.spatial import cKDTree
from truth import NOISE_PX, Truth

import pipeline
from pipeline.plugins.fits.free_numbers import FreeStage
from pipeline.plugins.fits.twin import Twin
from pipeline.results.ready_camera import ReadyCamera

_NEAR_MM = np.array([0.02, 0.02, 0.3])
"""Distances across and along the axis over which positions follow points by their derivatives [mm]: they are right to
2e-3 px rms, worst where light is cut off, and to 3e-5 px in the median."""
_LOST = 25.0
"""The same of rows that end on the way, where light is cut off, in units of these [1]: no search ends because of them.
"""
_STEP = 0.01
"""Moves that are differences of a search, in these units [1]: all of them follow the same rows."""
_APART = 1e3
"""Distance between microlenses in these units [1]: no row is near one of another microlens."""
_ACCURACY_PX = 1e-4
"""Error of solved positions [px]: that of the truth."""
MOST = 800
"""Most rows of a fit, evenly taken from all: its processor time grows with their number."""
_INNER = 0.35
"""Part of the pitch within which rows of an unfocused camera are taken [1]: a pixel farther out sees the rim of the
pupil, so that its rows come and go while numbers move, and a search among them ends astray."""
_SIGMAS = 5
"""Distance from the edge of the image within which no rows are taken, in sigma of noise [1]: it moves none out."""


class Solved:
    """A camera that images points by the solver of the truth, and points near them by derivatives: searches ask for
    many.

    `axial` (m, 2): k and l of the microlenses that numbers stand for. Those of the camera itself may be other ones: one
    end of a fitted array has some that the true array lacks.
    """

    def __init__(self, camera: ReadyCamera, axial: np.ndarray) -> None:
        self._camera = camera
        self._number_of = {pair: number for number, pair in enumerate(map(tuple, axial.tolist()))}
        self._scaled = np.empty((0, 4))
        self._x_px = np.empty((0, 2))
        self._slopes = np.empty((0, 2, 3))
        self._tree = cKDTree(self._scaled)
        self._asked, self._nearest = self._scaled, np.empty(0, int)

    def project(self, points_mm: np.ndarray, microlens: np.ndarray) -> np.ndarray:
        """Positions (n, 2) of points (n, 3) through microlenses (n,), NaN where there is none [px]."""
        scaled = np.column_stack([points_mm / _NEAR_MM, _APART * microlens])
        if scaled.shape != self._asked.shape or np.abs(scaled - self._asked).max(initial=0.0) > _STEP:
            self._asked, self._nearest = scaled, self._solved_near(scaled)
        x_px, there = np.full((len(scaled), 2), np.nan), self._nearest < len(self._scaled)
        near = self._nearest[there]
        moved_mm = (scaled[there] - self._scaled[near])[:, :3] * _NEAR_MM
        x_px[there] = self._x_px[near] + np.einsum("nij,nj->ni", self._slopes[near], moved_mm)
        return x_px

    def _solved_near(self, scaled: np.ndarray) -> np.ndarray:
        """Solved rows that are nearest to rows (n, 4), beyond the last one where there is none."""
        distance, nearest = self._tree.query(scaled, distance_upper_bound=1.0)
        if not (far := np.isinf(distance)).any():
            return nearest
        self._solve(scaled[far])
        return self._tree.query(scaled, distance_upper_bound=_LOST)[1]

    def _solve(self, scaled: np.ndarray) -> None:
        """Solve rows (n, 4), and keep those that the camera has."""
        points, point = np.unique(scaled[:, :3], axis=0, return_inverse=True)
        answer = self._camera.project(points * _NEAR_MM, accuracy_px=_ACCURACY_PX, derivatives=["point"])
        numbers = [self._number_of.get(pair, -1) for pair in map(tuple, answer.microlens.tolist())]
        row_of = {pair: row for row, pair in enumerate(zip(answer.point.tolist(), numbers, strict=True))}
        microlens = np.rint(scaled[:, 3] / _APART).astype(int)
        pairs = zip(point.ravel().tolist(), microlens.tolist(), strict=True)
        rows = np.array([row_of.get(pair, -1) for pair in pairs])
        slopes = answer.derivatives["point"]
        kept = np.flatnonzero((rows >= 0) & np.isfinite(slopes[rows]).all(axis=(1, 2)))
        x_px = np.stack([answer.x_px, answer.y_px], axis=1)[rows[kept]]
        self._scaled = np.concatenate([self._scaled, scaled[kept]])
        self._x_px = np.concatenate([self._x_px, x_px])
        self._slopes = np.concatenate([self._slopes, slopes[rows[kept]]])
        self._tree = cKDTree(self._scaled)


def build(snapshots: Path | None, programs: Path) -> None:
    """Nothing: it is this project."""


def run(programs: Path, task: Path, facts: Answer) -> Answer:
    """Nothing: fits need the truth's rows, as floors do."""
    return {}


def twin_judged(truth: Truth, answer: Answer, task: Path, facts: Answer) -> Answer:
    """Fits to exact rows and to noisy ones as floors get them, each from drawings of its own."""
    stage = task.parent / "dataset.usda"
    task.mkdir(exist_ok=True)
    boards, taken = [truth.boards, *truth.noisy(NOISE_PX, facts["noisy"])], taken_rows(truth)
    exact, *repeats = [fitted_to(truth, stage, rows.only(taken), task / f"{n}.usda") for n, rows in enumerate(boards)]
    true = true_numbers(stage)
    result = judged(truth, {"exact": _calibration(truth, exact)}, [_calibration(truth, twin) for twin in repeats], true)
    if repeats:
        values = np.array([values_of(twin) for twin in repeats])
        sigmas = np.array([twin.solution.deviation for twin in repeats])
        result["honesty"] = [numbers_kept([*true], values, sigmas, np.array([*true.values()]))]
    return result


def taken_rows(truth: Truth) -> np.ndarray:
    """Numbers of the rows of the boards that are fitted, exact or noisy, by their exact positions: of those near a
    border that is drawn through noisy ones, the noise on average points inwards.
    """
    rig, boards = truth.rig, truth.boards
    half_px = np.array(rig.size_px) / 2
    is_taken = (np.abs(boards.image_px + 0.5 - half_px) < half_px - _SIGMAS * NOISE_PX).all(axis=1)
    if rig.sensor_mm is not None:
        off_px = np.hypot(*(boards.image_px - truth.centre_px[boards.microlens]).T)
        is_taken &= off_px < _INNER * rig.pitch_mm / rig.pixel_mm
    taken = np.flatnonzero(is_taken)
    return taken[:: -(-len(taken) // MOST)]


def fitted_to(truth: Truth, stage: Path, boards: Rows, drawings: Path) -> Twin:
    """The twin of rows, from drawings that are written for it."""
    write_drawings(stage, drawings, f"{truth.rig.name} {drawings.stem}")
    twin = fitted(FreeStage(drawings, ["Made"], [stage.parent]), table_of(truth, boards), "exact")
    print(f"    {drawings.stem}: {twin.solution.ending}", *twin.doubts, sep="\n    ", flush=True)
    return twin


def table_of(truth: Truth, boards: Rows) -> dict[str, np.ndarray]:
    """Columns of a table of positions."""
    microlens_k, microlens_l = truth.ready.rig.axial[boards.microlens].T
    x_px, y_px = boards.image_px.T
    rows = {"frame": boards.view + 1, "point_id": boards.point}
    return rows | {"microlens_k": microlens_k, "microlens_l": microlens_l, "x_px": x_px, "y_px": y_px}


def _calibration(truth: Truth, twin: Twin) -> Calibration:
    names = [number.name for number in twin.stage.numbers]
    values = dict(zip(names, values_of(twin).tolist(), strict=True))
    views = np.array([frame - 1 for frame, _ in twin.views.keys])
    rms_px = float(np.sqrt(np.nanmean((twin.solution.residual_px**2).sum(axis=1))))
    camera = pipeline.ready(twin.stage.at(twin.solution.correction).cameras[0].camera)
    return Calibration(Solved(camera, truth.ready.rig.axial), values, vision_poses(twin), views, rms_px)
