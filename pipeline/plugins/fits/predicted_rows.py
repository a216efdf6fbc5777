"""Rows that a stage predicts for observed positions, by the solver of the ground truth, and their derivatives.

A row is solved for each pair of a point and a microlens that was observed. Boards have poses of their own in the world,
one for each frame, which all cameras share.
"""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.camera.integrals import Bundles, integrals
from pipeline.camera.parts.camera import Camera
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.moments import COVARIANCE, WEIGHT
from pipeline.errors import UsageError
from pipeline.plugins.fits.observations import Observations
from pipeline.scene.dataset import CameraEntry, Dataset
from pipeline.spelling import did_you_mean
from pipeline.targets.points import TargetPoints
from pipeline.truth.derivatives import Neighbour, SolvedRows, Variation, derivatives
from pipeline.truth.direct.candidates import inverse
from pipeline.truth.direct.direct_rows import Guess, solve
from pipeline.truth.grid.ray_grid import matrix_4
from pipeline.truth.planes import Planes, tangent_planes
from pipeline.truth.positions.column_sets import column_set
from pipeline.truth.rows import Solutions

_LEAST_PX = 1e-9
"""Finest accuracy of rows [px]: finer than this, traces in double precision round."""
_OF_SIGMA = 1e-5
"""Error of rows over that of observations [1]: what it moves is no more than that part of any deviation."""
_APART_MM = 10.0
"""Distance of the plane behind that of a point on which rays tell their slopes [mm]: they are straight."""
_LEVEL = 2
"""Level of quadrature, that of derivatives by numbers."""


@dataclass(frozen=True, slots=True)
class Views:
    """Boards in frames: the key of each (frame, target), and the view of each observation, (n,)."""

    keys: tuple[tuple[int, str], ...]
    of_rows: np.ndarray

    @classmethod
    def of(cls, observations: Observations) -> Self:
        """The views of observations whose targets are named."""
        keys = sorted(set(zip(observations.frame.tolist(), observations.target.tolist(), strict=True)))
        number = {key: i for i, key in enumerate(keys)}
        pairs = zip(observations.frame.tolist(), observations.target.tolist(), strict=True)
        return cls(tuple(keys), np.array([number[pair] for pair in pairs], int))


@dataclass(frozen=True, slots=True, kw_only=True)
class Predicted:
    """Predicted positions of all observations, (n, 2), NaN where the stage has no such row; and where J is."""

    x_px: np.ndarray
    exact_px: np.ndarray


@dataclass(frozen=True, slots=True, kw_only=True)
class Slopes:
    """Derivatives of predicted positions by free numbers (n, 2, m) and by the pose of the own board (n, 2, 6): a turn
    [rad] about the origin of the board and a shift [mm], in the axes of the world.
    """

    by_number: np.ndarray
    by_pose: np.ndarray


@functools.lru_cache(maxsize=4)
def _rig(camera: Camera, seed: int, square_px: float) -> Rig:
    """The rig of a camera: predictions and derivatives at the same numbers share it."""
    return Rig.of(Tracer(camera, seed), square_px)


@dataclass(frozen=True)
class Predictor:
    """Predictions for observations, each behind a named microlens if its camera has any.

    `offset_px`: from the position of J to that which the detector looks for, (n, 2); it hardly changes with a camera.
    """

    observations: Observations
    views: Views
    offset_px: np.ndarray | float = 0.0
    accuracy_px: float = field(init=False)

    def __post_init__(self) -> None:
        finest = float(self.observations.sigma_px.min()) * _OF_SIGMA
        object.__setattr__(self, "accuracy_px", min(max(finest, _LEAST_PX), 1e-3))

    def rig(self, dataset: Dataset, entry: CameraEntry) -> Rig:
        """A camera of a dataset, made ready."""
        return _rig(entry.camera, dataset.seed, entry.square_px)

    def predict(self, dataset: Dataset, poses: np.ndarray, start_px: np.ndarray) -> Predicted:
        """Positions with boards at `poses` (v, 4, 4) world_from_target [mm]; searches begin at `start_px` (n, 2)."""
        exact = np.full((len(self.observations), 2), np.nan)
        for entry, rows in self._cameras(dataset):
            solutions = self._solved(dataset, entry, rows, poses, start_px)
            exact[rows[solutions.point]] = solutions.xy_px
        return Predicted(x_px=exact + self.offset_px, exact_px=exact)

    def offsets(self, dataset: Dataset, poses: np.ndarray, start_px: np.ndarray) -> np.ndarray:
        """From positions of J to those that the detector looks for, (n, 2) [px]; NaN where a point has none."""
        offset_px = np.full((len(self.observations), 2), np.nan)
        for entry, rows in self._cameras(dataset):
            solutions = self._solved(dataset, entry, rows, poses, start_px)
            wanted = self._wanted(self.rig(dataset, entry), dataset, entry, rows, poses, solutions)
            offset_px[rows[solutions.point]] = wanted - solutions.xy_px
        return offset_px

    def _solved(
        self, dataset: Dataset, entry: CameraEntry, rows: np.ndarray, poses: np.ndarray, start_px: np.ndarray
    ) -> Solutions:
        rig, planes = self.rig(dataset, entry), self._planes(dataset, entry, rows, poses)
        guess = Guess(np.arange(len(rows)), self._cells(rig, rows), start_px[rows])
        return solve(rig, guess, planes, self.accuracy_px, 0.0).solutions

    def slopes(
        self,
        dataset: Dataset,
        around: Sequence[tuple[Dataset, Dataset]],
        steps: Sequence[float],
        poses: np.ndarray,
        exact_px: np.ndarray,
    ) -> Slopes:
        """Derivatives at solved positions, of which what is NaN is left out, by each number with its two neighbours."""
        by_number = np.full((len(exact_px), 2, len(around)), np.nan)
        by_pose = np.full((len(exact_px), 2, 6), np.nan)
        for entry, of_camera in self._cameras(dataset):
            rows = of_camera[np.isfinite(exact_px[of_camera, 0])]
            rig, planes = self.rig(dataset, entry), self._planes(dataset, entry, rows, poses)
            solved = SolvedRows(np.arange(len(rows)), self._cells(rig, rows), exact_px[rows], Planes(planes))
            by_number[rows], variations, places = 0.0, [], []
            for place, (ends, step) in enumerate(zip(around, steps, strict=True)):
                sides = [self._neighbour(end, entry, rows, poses, rig) for end in ends]
                if all(side.tracer is rig.tracer and np.array_equal(side.planes.of_points, planes) for side in sides):
                    continue  # the number is none of this camera's
                variations.append(Variation(step, *sides))
                places.append(place)
            rates = derivatives(rig, solved, variations)
            by_number[np.ix_(rows, [0, 1], places)] = rates.x_px.transpose(0, 2, 1)
            frames = {frame.number: np.array(frame.camera_from_world[entry.name]) for frame in dataset.frames}
            world = np.array([frames[self.views.keys[view][0]] for view in self.views.of_rows[rows]])
            origin = np.einsum("nij,nj->ni", world, poses[self.views.of_rows[rows], :, 3])[:, :3]
            hits = _by_pose(rig, solved, origin) @ np.kron(np.eye(2), world[:, None, :3, :3]).reshape(-1, 6, 6)
            by_pose[rows] = -inverse(rates.jacobian_mm_per_px) @ hits
        return Slopes(by_number=by_number, by_pose=by_pose)

    def _cameras(self, dataset: Dataset) -> list[tuple[CameraEntry, np.ndarray]]:
        entries = {entry.full_name: entry for camera in dataset.cameras for entry in camera.in_channels}
        names = np.unique(self.observations.camera).tolist()
        return [(entries[name], np.flatnonzero(self.observations.camera == name)) for name in names]

    def _cells(self, rig: Rig, rows: np.ndarray) -> np.ndarray:
        lattice, microlens = rig.tracer.lattice, self.observations.microlens
        if lattice is None or microlens is None:
            return np.zeros(len(rows), np.int64)
        return np.asarray(lattice.rows(*microlens[rows].T))

    def _neighbour(self, end: Dataset, entry: CameraEntry, rows: np.ndarray, poses: np.ndarray, rig: Rig) -> Neighbour:
        """The same rows before another reading of the stage."""
        there = next(each for each in end.cameras if each.name == entry.name)
        there = next(each for each in there.in_channels if each.full_name == entry.full_name)
        tracer = rig.tracer if there.camera == rig.tracer.camera else rig.tracer.next_to(there.camera)
        return Neighbour(tracer, Planes(self._planes(end, there, rows, poses)))

    def _planes(self, dataset: Dataset, entry: CameraEntry, rows: np.ndarray, poses: np.ndarray) -> np.ndarray:
        """Tangent planes at the point of each row, vision frame, (n, 4, 3)."""
        planes, points, frames = np.empty((len(rows), 4, 3)), points_of(dataset), {f.number: f for f in dataset.frames}
        for view in np.unique(self.views.of_rows[rows]):
            some = np.flatnonzero(self.views.of_rows[rows] == view)
            frame, target = self.views.keys[view]
            vision_from_target = np.array(frames[frame].camera_from_world[entry.name]) @ poses[view]
            ids, of = self.observations.point_id[rows[some]], points[target]
            planes[some] = tangent_planes(vision_from_target, of.position_mm[ids], of.plane_axes[ids])
        return planes

    def _wanted(
        self, rig: Rig, dataset: Dataset, entry: CameraEntry, rows: np.ndarray, poses: np.ndarray, solved: Solutions
    ) -> np.ndarray:
        """The positions that the detector looks for, of solved rows: J's, or others of the same points, NaN of none."""
        x_px = solved.xy_px
        targets, frames = {each.name: each for each in dataset.targets}, {each.number: each for each in dataset.frames}
        view = self.views.of_rows[rows[solved.point]]
        ids = self.observations.point_id[rows[solved.point]]
        for each in np.unique(view):
            some, (frame, name) = np.flatnonzero(view == each), self.views.keys[each]
            pose, target = np.array(frames[frame].camera_from_world[entry.name]) @ poses[each], targets[name].target
            points = target.points()
            planes = Planes(tangent_planes(pose, points.position_mm, points.plane_axes))
            of = Solutions(
                ids[some],
                solved.cell[some],
                solved.x_px[some],
                solved.y_px[some],
                solved.jacobian[some],
                np.zeros(len(some)),
            )
            x_px[some] = column_set(self.observations.position, rig, target, pose, planes, of).x_px
        return x_px


def _by_pose(rig: Rig, rows: SolvedRows, origin_mm: np.ndarray) -> np.ndarray:
    """Derivatives of J by a turn of the board about its origin (n, 3) and a shift, vision frame, (n, 2, 6) [mm].

    A ray that meets the plane at (x, y) with the slope s moves on it by s times the way of the plane along its normal
    there, less the way across. The way is linear in x and y, so that its mean needs those of s, x s and y s.
    """
    planes = rows.planes.of_points
    behind = planes.copy()
    behind[:, 0] += _APART_MM * planes[:, 3]
    bundles = Bundles(rows.x_px, rig.microlens(rows.cell), np.stack([planes, behind], axis=1), rig.square_px)
    moments = integrals(rig.tracer, bundles, _LEVEL).moments
    mean, spread = moments[:, :4], matrix_4(moments[:, COVARIANCE:WEIGHT])
    slope = (mean[:, 2:] - mean[:, :2]) / _APART_MM
    with_slope = (spread[:, :2, 2:] - spread[:, :2, :2]) / _APART_MM  # of x or y, with s
    axes, normal = planes[:, 1:3], planes[:, 3]
    hit = planes[:, 0] + np.einsum("nk,nkj->nj", mean[:, :2], axes) - origin_mm
    along = slope[:, :, None] * normal[:, None] - axes
    turned = np.cross(hit[:, None], along)
    for k in range(2):
        turned += with_slope[:, k, :, None] * np.cross(axes[:, k], normal)[:, None]
    return np.concatenate([turned, along], axis=2)


def moved(poses: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Poses (v, 4, 4) turned about their own origins and shifted, in the axes of the world; `by`: (v, 6)."""
    turned = poses.copy()
    turned[:, :3, :3] = Rotation.from_rotvec(by[:, :3]).as_matrix() @ poses[:, :3, :3]
    turned[:, :3, 3] += by[:, 3:]
    return turned


def points_of(dataset: Dataset) -> Mapping[str, TargetPoints]:
    """Points of each target of a dataset."""
    return {entry.name: _points(entry.target) for entry in dataset.targets}


_points = functools.lru_cache(maxsize=16)(lambda target: target.points())


def placed(observations: Observations, dataset: Dataset) -> Observations:
    """Observations with cameras, targets and microlenses that a dataset has.

    UsageError: it has no such camera, target, frame, point or microlens, or a shutter scans while something moves.
    """
    entries = {entry.full_name: entry for camera in dataset.cameras for entry in camera.in_channels}
    frames = {frame.number: frame for frame in dataset.frames}
    camera = _named("camera", observations.camera, tuple(entries))
    target = _named("target", observations.target, tuple(entry.name for entry in dataset.targets))
    if missing := sorted(set(observations.frame.tolist()) - {*frames}):
        hint = "give it a time code for each image: endTimeCode, or plen:frames"
        raise UsageError(f"the dataset has no frame {missing[0]}", hint=hint)
    for name in np.unique(target).tolist():
        ids, count = observations.point_id[target == name], len(points_of(dataset)[name].position_mm)
        if ids.min() < 0 or ids.max() >= count:
            wrong = int(ids.min() if ids.min() < 0 else ids.max())
            raise UsageError(f"{name} has no point {wrong}", hint=f"its points are 0 to {count - 1}")
    return _behind_microlenses(replace(observations, camera=camera, target=target), dataset, entries)


def _named(kind: str, given: np.ndarray, known: tuple[str, ...]) -> np.ndarray:
    """Names of cameras or targets, the only one where the file names none."""
    if (given == "").any() and len(known) > 1:
        raise UsageError(f"the dataset has {len(known)} {kind}s, and the file names none", hint=", ".join(known))
    names = np.where(given == "", known[0], given)
    for name in sorted(set(names.tolist()) - {*known}):
        raise UsageError(f"the dataset has no {kind} {name!r}", hint=did_you_mean(name, known) or ", ".join(known))
    return names


def _behind_microlenses(found: Observations, dataset: Dataset, entries: Mapping[str, CameraEntry]) -> Observations:
    """Observations with the microlens of each: the one that is named, or that in whose micro-image the position is."""
    microlens = np.zeros((len(found), 2), np.int64) if found.microlens is None else found.microlens.copy()
    for name in np.unique(found.camera):
        rows = np.flatnonzero(found.camera == name)
        rig = _rig(entries[name].camera, dataset.seed, entries[name].square_px)
        outside = rows[~rig.in_image(found.x_px[rows])]
        if len(outside):
            x, y = found.x_px[outside[0]].tolist()
            width, height = entries[name].camera.sensor.size_px
            raise UsageError(f"({x:g}, {y:g}) px lies outside of the image of {name}, {width} x {height} px")
        if (lattice := rig.tracer.lattice) is None:
            continue
        if found.microlens is None:
            microlens[rows] = rig.axial[rig.microlens_at(rig.tracer.positions_mm(*found.x_px[rows].T))]
        elif len(unknown := rows[lattice.rows(microlens[rows, 0], microlens[rows, 1], -1) < 0]):
            raise UsageError(f"the array of {name} has no microlens {tuple(microlens[unknown[0]].tolist())}")
    return replace(found, microlens=microlens)
