"""Rows that a stage predicts for observed positions, by the solver of the ground truth, and their derivatives.

A row is solved for each pair of a point and a microlens that was observed. Boards have poses of their own in the world,
one for each frame, which all cameras share. The centre of a micro-image is predicted by its chief ray.
"""

import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.camera.micro_images.light import micro_light
from pipeline.camera.parts.camera import Camera
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.formats import EXACT
from pipeline.plugins.fits.observations import Observations
from pipeline.records.shapes import Float64, Int64
from pipeline.scene.dataset import CameraEntry, Dataset
from pipeline.targets.points import TargetPoints
from pipeline.truth.derivatives import Neighbour, SolvedRows, Variation, derivatives
from pipeline.truth.direct.direct_rows import Guess, solve
from pipeline.truth.planes import Planes, tangent_planes
from pipeline.truth.positions.column_sets import column_set
from pipeline.truth.rows import Solutions

_LEAST_PX = 1e-9
"""Finest accuracy of rows [px]: finer than this, traces in double precision round."""
_OF_SIGMA = 1e-5
"""Error of rows over that of observations [1]: what it moves is no more than that part of any deviation."""
_POSE_STEP = 1e-4
"""Step of the pose of a board [rad, mm]: differences err by 1e-8 of the derivative, and round by less."""


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

    def poses(self, dataset: Dataset) -> np.ndarray:
        """Poses that a dataset states, (v, 4, 4) world_from_target [mm]."""
        frames = {frame.number: frame for frame in dataset.frames}
        return np.array([frames[frame].world_from_target[name] for frame, name in self.keys]).reshape(-1, 4, 4)


@dataclass(frozen=True, slots=True, kw_only=True)
class Slopes:
    """Derivatives of predicted positions by free numbers (n, 2, m) and by the pose of the own board (n, 2, 6): a turn
    [rad] about the origin of the board and a shift [mm], in the axes of the world. `arm_mm`: from that origin to the
    point, (n, 3), in these axes, too; 0 of a centre.
    """

    by_number: np.ndarray
    by_pose: np.ndarray
    arm_mm: np.ndarray


@functools.lru_cache(maxsize=4)
def _rig(camera: Camera, seed: int, square_px: float) -> Rig:
    return Rig.of(Tracer(camera, seed), square_px)


def rig_of(dataset: Dataset, entry: CameraEntry) -> Rig:
    """A camera of a dataset, made ready; predictions and derivatives at the same numbers share it."""
    return _rig(entry.camera, dataset.seed, entry.square_px)


def entries_of(dataset: Dataset) -> dict[str, CameraEntry]:
    """Cameras of a dataset in all their channels, by full name."""
    return {entry.full_name: entry for camera in dataset.cameras for entry in camera.in_channels}


def vision_from_world(dataset: Dataset, entry: CameraEntry) -> dict[int, np.ndarray]:
    """Poses of a camera by frame, (4, 4) [mm]."""
    return {frame.number: np.array(frame.camera_from_world[entry.name]) for frame in dataset.frames_of(entry)}


@dataclass(frozen=True)
class Predictor:
    """Predictions for observations, each behind a named microlens if its camera has any: positions of J, and of the
    chief rays of centres.
    """

    observations: Observations
    views: Views

    def positions(self, dataset: Dataset, poses: np.ndarray, start_px: np.ndarray) -> np.ndarray:
        """Positions (n, 2) with boards at `poses` (v, 4, 4) world_from_target [mm], NaN where the stage has no such
        row; searches begin at `start_px` (n, 2).
        """
        found_px = np.full((len(self.observations), 2), np.nan)
        for entry, points, centres in self._cameras(dataset):
            solutions = self._solved(dataset, entry, points, poses, start_px)
            found_px[points[solutions.point]] = solutions.xy_px
            if len(centres):
                found_px[centres] = chief_px(rig_of(dataset, entry), self._microlens[centres])
        return found_px

    def offsets(self, dataset: Dataset, poses: np.ndarray, start_px: np.ndarray) -> np.ndarray:
        """From these positions to those that the detector looks for, (n, 2) [px]; NaN where a point has none."""
        offset_px, sought = np.full((len(self.observations), 2), np.nan), self.observations.position
        offset_px[sought == EXACT] = 0.0
        for entry, points, centres in self._cameras(dataset):
            rig = rig_of(dataset, entry)
            for position in {*sought[points].tolist()} - {EXACT}:
                rows = points[sought[points] == position]
                solved = self._solved(dataset, entry, rows, poses, start_px)
                wanted_px = self._wanted(position, dataset, entry, poses, replace(solved, point=rows[solved.point]))
                offset_px[rows[solved.point]] = wanted_px - solved.xy_px
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
        finest_px = float(self.observations.sigma_px.min()) * _OF_SIGMA
        return solve(rig, guess, planes, min(max(finest_px, _LEAST_PX), 1e-3), 0.0).solutions

    def slopes(
        self,
        dataset: Dataset,
        around: Sequence[tuple[Dataset, Dataset]],
        steps: Sequence[float],
        poses: np.ndarray,
        solved_px: np.ndarray,
    ) -> Slopes:
        """Derivatives at solved positions, of which what is NaN is left out, by each number with its two neighbours."""
        by_number = np.full((len(solved_px), 2, len(around)), np.nan)
        by_pose = np.full((len(solved_px), 2, 6), np.nan)
        for entry, *of_camera in self._cameras(dataset):
            rows, centres = (each[np.isfinite(solved_px[each, 0])] for each in of_camera)
            rig, planes = rig_of(dataset, entry), self._planes(dataset, entry, rows, poses)
            by_number[rows], by_number[centres], by_pose[centres] = 0.0, 0.0, 0.0
            variations, places = [], []
            for axis in _POSE_STEP * np.eye(6):
                turned = (self._planes(dataset, entry, rows, moved(poses, by)) for by in (-axis, axis))
                variations.append(Variation(_POSE_STEP, *(Neighbour(rig.tracer, Planes(each)) for each in turned)))
            for place, (ends, step) in enumerate(zip(around, steps, strict=True)):
                sides = [self._neighbour(end, entry, rows, poses, rig) for end in ends]
                if all(side.tracer is rig.tracer and np.array_equal(side.planes.of_points, planes) for side in sides):
                    continue  # the number is none of this camera's
                variations.append(Variation(step, *sides))
                places.append(place)
                if len(centres):
                    less, more = (chief_px(Rig.of(side.tracer), self._microlens[centres]) for side in sides)
                    by_number[centres, :, place] = (more - less) / (2 * step)
            if len(rows):
                solved = SolvedRows(np.arange(len(rows)), self._cells(rig, rows), solved_px[rows], Planes(planes))
                rates = derivatives(rig, solved, variations).x_px.transpose(0, 2, 1)
                by_pose[rows], by_number[np.ix_(rows, [0, 1], places)] = rates[:, :, :6], rates[:, :, 6:]
        return Slopes(by_number=by_number, by_pose=by_pose, arm_mm=self._arms_mm(dataset, poses))

    def _arms_mm(self, dataset: Dataset, poses: np.ndarray) -> np.ndarray:
        arms_mm, points = np.zeros((len(self.observations), 3)), points_of(dataset)
        for view, (_, target) in enumerate(self.views.keys):
            rows = np.flatnonzero(self.views.of_rows == view)
            arms_mm[rows] = points[target].position_mm[self.observations.point_id[rows]] @ poses[view, :3, :3].T
        return arms_mm

    def _cameras(self, dataset: Dataset) -> Iterator[tuple[CameraEntry, np.ndarray, np.ndarray]]:
        """Cameras with their rows, of points and of centres."""
        entries = entries_of(dataset)
        for name in np.unique(self.observations.camera).tolist():
            of_camera, is_centre = self.observations.camera == name, self.observations.is_centre
            yield entries[name], np.flatnonzero(of_camera & ~is_centre), np.flatnonzero(of_camera & is_centre)

    @property
    def _microlens(self) -> np.ndarray:
        assert self.observations.microlens is not None
        return self.observations.microlens

    def _cells(self, rig: Rig, rows: np.ndarray) -> np.ndarray:
        lattice = rig.tracer.lattice
        return np.zeros(len(rows), np.int64) if lattice is None else lattice.rows(*self._microlens[rows].T)

    def _neighbour(self, end: Dataset, entry: CameraEntry, rows: np.ndarray, poses: np.ndarray, rig: Rig) -> Neighbour:
        """The same rows before another reading of the stage."""
        there = entries_of(end)[entry.full_name]
        tracer = rig.tracer if there.camera == rig.tracer.camera else rig.tracer.next_to(there.camera)
        return Neighbour(tracer, Planes(self._planes(end, there, rows, poses)))

    def _planes(self, dataset: Dataset, entry: CameraEntry, rows: np.ndarray, poses: np.ndarray) -> np.ndarray:
        """Tangent planes at the point of each row, vision frame, (n, 4, 3)."""
        planes, points, vision = np.empty((len(rows), 4, 3)), points_of(dataset), vision_from_world(dataset, entry)
        for view in np.unique(self.views.of_rows[rows]):
            some = np.flatnonzero(self.views.of_rows[rows] == view)
            frame, target = self.views.keys[view]
            ids, of = self.observations.point_id[rows[some]], points[target]
            planes[some] = tangent_planes(vision[frame] @ poses[view], of.position_mm[ids], of.plane_axes[ids])
        return planes

    def _wanted(
        self, position: str, dataset: Dataset, entry: CameraEntry, poses: np.ndarray, solved: Solutions
    ) -> np.ndarray:
        """Another position than J's of solved observations, (n, 2) [px]; NaN where a point has none."""
        x_px, rig, vision = solved.xy_px, rig_of(dataset, entry), vision_from_world(dataset, entry)
        targets = {each.name: each.target for each in dataset.targets}
        for view in np.unique(self.views.of_rows[solved.point]):
            some, (frame, name) = self.views.of_rows[solved.point] == view, self.views.keys[view]
            pose, points = vision[frame] @ poses[view], targets[name].points()
            planes = Planes(tangent_planes(pose, points.position_mm, points.plane_axes))
            of = replace(solved.only(some), point=self.observations.point_id[solved.point[some]])
            x_px[some] = column_set(position, rig, targets[name], pose, planes, of).x_px
        return x_px


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
    """Poses (v, 4, 4) turned about their own origins and shifted, in the axes of the world; `by`: (v, 6) or (6,)."""
    turned = poses.copy()
    turned[:, :3, :3] = Rotation.from_rotvec(by[..., :3]).as_matrix() @ poses[:, :3, :3]
    turned[:, :3, 3] += by[..., 3:]
    return turned


def points_of(dataset: Dataset) -> Mapping[str, TargetPoints]:
    """Points of each target of a dataset."""
    return {entry.name: _points(entry.target) for entry in dataset.targets}


_points = functools.lru_cache(maxsize=16)(lambda target: target.points())
