"""Rows that a stage predicts for observed positions, by the solver of the ground truth, and their derivatives.

A row is solved for each pair of a point and a microlens that was observed. Boards have poses of their own in the world,
one for each frame, which all cameras share. The centre of a micro-image is predicted by its chief ray.
"""

import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.camera.integrals import Bundles, integrals
from pipeline.camera.micro_images.light import micro_light
from pipeline.camera.parts.camera import Camera
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.moments import COVARIANCE, WEIGHT
from pipeline.formats import EXACT
from pipeline.plugins.fits.observations import Observations
from pipeline.records.shapes import Float64, Int64
from pipeline.scene.dataset import CameraEntry, Dataset
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
    """Boards in frames: the key of each (frame, target), and the view of each observation, (n,), -1 of a centre."""

    keys: tuple[tuple[int, str], ...]
    of_rows: np.ndarray

    @classmethod
    def of(cls, observations: Observations) -> Self:
        """The views of observations whose targets are named."""
        pairs = list(zip(observations.frame.tolist(), observations.target.tolist(), strict=True))
        keys = sorted({pair for pair, is_centre in zip(pairs, observations.is_centre, strict=True) if not is_centre})
        number = {key: i for i, key in enumerate(keys)}
        return cls(tuple(keys), np.array([number.get(pair, -1) for pair in pairs], int))


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
    return Rig.of(Tracer(camera, seed), square_px)


def rig_of(dataset: Dataset, entry: CameraEntry) -> Rig:
    """A camera of a dataset, made ready; predictions and derivatives at the same numbers share it."""
    return _rig(entry.camera, dataset.seed, entry.square_px)


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

    def predict(self, dataset: Dataset, poses: np.ndarray, start_px: np.ndarray) -> Predicted:
        """Positions with boards at `poses` (v, 4, 4) world_from_target [mm]; searches begin at `start_px` (n, 2)."""
        exact = np.full((len(self.observations), 2), np.nan)
        for entry, points, centres in self._cameras(dataset):
            solutions = self._solved(dataset, entry, points, poses, start_px)
            exact[points[solutions.point]] = solutions.xy_px
            if len(centres):
                exact[centres] = chief_px(rig_of(dataset, entry), self._microlens[centres])
        return Predicted(x_px=exact + self.offset_px, exact_px=exact)

    def offsets(self, dataset: Dataset, poses: np.ndarray, start_px: np.ndarray) -> np.ndarray:
        """From positions of J, and of chief rays of centres, to those that the detector looks for, (n, 2) [px]; NaN
        where a point has none.
        """
        offset_px, sought = np.full((len(self.observations), 2), np.nan), self.observations.position
        offset_px[sought == EXACT] = 0.0
        for entry, points, centres in self._cameras(dataset):
            rig = rig_of(dataset, entry)
            for position in {*sought[points].tolist()} - {EXACT}:
                rows = points[sought[points] == position]
                solved = self._solved(dataset, entry, rows, poses, start_px)
                wanted = self._wanted(position, dataset, entry, rows, poses, solved)
                offset_px[rows[solved.point]] = wanted - solved.xy_px
            offset_px[centres] = 0.0
            of_light = centres[sought[centres] == "centroid"]
            if len(of_light):
                microlens = self._microlens[of_light]
                offset_px[of_light] = centroids_px(rig, microlens) - chief_px(rig, microlens)
        return offset_px

    def _solved(
        self, dataset: Dataset, entry: CameraEntry, rows: np.ndarray, poses: np.ndarray, start_px: np.ndarray
    ) -> Solutions:
        rig, planes = rig_of(dataset, entry), self._planes(dataset, entry, rows, poses)
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
        for entry, *of_camera in self._cameras(dataset):
            rows, centres = (each[np.isfinite(exact_px[each, 0])] for each in of_camera)
            rig, planes = rig_of(dataset, entry), self._planes(dataset, entry, rows, poses)
            solved = SolvedRows(np.arange(len(rows)), self._cells(rig, rows), exact_px[rows], Planes(planes))
            by_number[rows], by_number[centres], by_pose[centres] = 0.0, 0.0, 0.0
            variations, places = [], []
            for place, (ends, step) in enumerate(zip(around, steps, strict=True)):
                sides = [self._neighbour(end, entry, rows, poses, rig) for end in ends]
                if all(side.tracer is rig.tracer and np.array_equal(side.planes.of_points, planes) for side in sides):
                    continue  # the number is none of this camera's
                variations.append(Variation(step, *sides))
                places.append(place)
                if len(centres):
                    less, more = (chief_px(Rig.of(side.tracer), self._microlens[centres]) for side in sides)
                    by_number[centres, :, place] = (more - less) / (2 * step)
            if not len(rows):
                continue
            rates = derivatives(rig, solved, variations)
            by_number[np.ix_(rows, [0, 1], places)] = rates.x_px.transpose(0, 2, 1)
            frames = {frame.number: np.array(frame.camera_from_world[entry.name]) for frame in dataset.frames_of(entry)}
            world = np.array([frames[self.views.keys[view][0]] for view in self.views.of_rows[rows]])
            origin = np.einsum("nij,nj->ni", world, poses[self.views.of_rows[rows], :, 3])[:, :3]
            hits = _by_pose(rig, solved, origin) @ np.kron(np.eye(2), world[:, None, :3, :3]).reshape(-1, 6, 6)
            by_pose[rows] = -inverse(rates.jacobian_mm_per_px) @ hits
        return Slopes(by_number=by_number, by_pose=by_pose)

    def _cameras(self, dataset: Dataset) -> Iterator[tuple[CameraEntry, np.ndarray, np.ndarray]]:
        """Cameras with their rows, of points and of centres."""
        entries = {entry.full_name: entry for camera in dataset.cameras for entry in camera.in_channels}
        for name in np.unique(self.observations.camera).tolist():
            of_camera, is_centre = self.observations.camera == name, self.observations.is_centre
            yield entries[name], np.flatnonzero(of_camera & ~is_centre), np.flatnonzero(of_camera & is_centre)

    @property
    def _microlens(self) -> np.ndarray:
        assert self.observations.microlens is not None
        return self.observations.microlens

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
        self,
        position: str,
        dataset: Dataset,
        entry: CameraEntry,
        rows: np.ndarray,
        poses: np.ndarray,
        solved: Solutions,
    ) -> np.ndarray:
        """Another position than J's of the points of solved rows, (n, 2) [px]; NaN where a point has none."""
        x_px, rig = solved.xy_px, rig_of(dataset, entry)
        targets, frames = {each.name: each for each in dataset.targets}, {each.number: each for each in dataset.frames}
        view = self.views.of_rows[rows[solved.point]]
        ids = self.observations.point_id[rows[solved.point]]
        for each in np.unique(view):
            some, (frame, name) = np.flatnonzero(view == each), self.views.keys[each]
            pose, target = np.array(frames[frame].camera_from_world[entry.name]) @ poses[each], targets[name].target
            points = target.points()
            planes = Planes(tangent_planes(pose, points.position_mm, points.plane_axes))
            of = replace(solved.only(some), point=ids[some])
            x_px[some] = column_set(position, rig, target, pose, planes, of).x_px
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


def chief_px(rig: Rig, microlens: Int64[np.ndarray, "n 2"]) -> np.ndarray:
    """Hits of the chief rays through microlenses, by k and l, (n, 2) [px]; NaN where the array has no such one."""
    assert rig.images is not None
    return _of_rows(rig, microlens, rig.images.centre_mm)


def centroids_px(rig: Rig, microlens: Int64[np.ndarray, "n 2"]) -> np.ndarray:
    """Centroids of all light through microlenses, by k and l, (n, 2) [px]; NaN of a dark one."""
    assert rig.images is not None and rig.tracer.lattice is not None
    rows = np.unique(rig.tracer.lattice.rows(microlens[:, 0], microlens[:, 1], -1))
    light = micro_light(rig.tracer, rig.images, rows=rows[rows >= 0])
    centroid_mm = np.full_like(rig.images.centre_mm, np.nan)
    centroid_mm[light.rows] = light.centroid_mm
    return _of_rows(rig, microlens, centroid_mm)


def _of_rows(rig: Rig, microlens: np.ndarray, positions_mm: Float64[np.ndarray, "m 2"]) -> np.ndarray:
    assert rig.tracer.lattice is not None
    rows = rig.tracer.lattice.rows(microlens[:, 0], microlens[:, 1], -1)
    return np.where(rows[:, None] >= 0, rig.tracer.pixels_at(positions_mm[rows]), np.nan)


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
