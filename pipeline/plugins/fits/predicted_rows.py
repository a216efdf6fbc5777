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
_SIGMA_SHARE = 1e-5
"""Error of rows over that of observations [1]: what it moves is no more than that part of any deviation."""
_ASTRAY = 1e3
"""Error that the search of a row states, over that which was asked, above which there is no row [1]: near the rim of a
micro-image it may end a pixel from any solution."""
_POSE_STEP = 1e-4
"""Step of the pose of a board [rad, mm]: differences err by 1e-8 of the derivative, and round by less."""


@dataclass(frozen=True, slots=True)
class Views:
    """Boards in frames: frame and target of each view, and the view of each observation, (n,), -1 of a centre."""

    keys: tuple[tuple[int, str], ...]
    of_rows: np.ndarray

    @classmethod
    def of(cls, observations: Observations) -> Self:
        """The views of observations whose targets are named."""
        pairs = list(zip(observations.frame.tolist(), observations.target.tolist(), strict=True))
        keys = sorted({pair for pair, is_centre in zip(pairs, observations.is_centre, strict=True) if not is_centre})
        view_of = {key: view for view, key in enumerate(keys)}
        return cls(tuple(keys), np.array([view_of.get(pair, -1) for pair in pairs], int))

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

    def positions(
        self, dataset: Dataset, poses: np.ndarray, start_px: np.ndarray, least_hit_fraction: float = 0.0
    ) -> np.ndarray:
        """Positions (n, 2) with boards at `poses` (v, 4, 4) world_from_target [mm], NaN where the stage has no such
        row, or less of its light than asked; searches begin at `start_px` (n, 2).
        """
        predicted_px = np.full((len(self.observations), 2), np.nan)
        for entry, points, centres in self._cameras(dataset):
            solutions = self._solved(dataset, entry, points, poses, start_px, least_hit_fraction)
            predicted_px[points[solutions.point]] = solutions.xy_px
            if len(centres):
                predicted_px[centres] = chief_px(rig_of(dataset, entry), self._microlens[centres])
        return predicted_px

    def offsets(self, dataset: Dataset, poses: np.ndarray, start_px: np.ndarray) -> np.ndarray:
        """From these positions to those that the detector looks for, (n, 2) [px]; NaN where a point has none."""
        position = self.observations.position
        offset_px = np.full((len(self.observations), 2), np.nan)
        offset_px[position == EXACT] = 0.0
        for entry, points, centres in self._cameras(dataset):
            for name in {*position[points].tolist()} - {EXACT}:
                rows = points[position[points] == name]
                solved = self._solved(dataset, entry, rows, poses, start_px)
                solved = replace(solved, point=rows[solved.point])
                offset_px[solved.point] = self._at_position(name, dataset, entry, poses, solved) - solved.xy_px
            offset_px[centres] = 0.0
            centroids = centres[position[centres] == "centroid"]
            if len(centroids):
                rig, microlens = rig_of(dataset, entry), self._microlens[centroids]
                offset_px[centroids] = centroids_px(rig, microlens) - chief_px(rig, microlens)
        return offset_px

    def _solved(
        self,
        dataset: Dataset,
        entry: CameraEntry,
        rows: np.ndarray,
        poses: np.ndarray,
        start_px: np.ndarray,
        least_hit_fraction: float = 0.0,
    ) -> Solutions:
        """Positions of J of rows, by their numbers among these, without those that the stage does not have."""
        rig, planes = rig_of(dataset, entry), self._planes(dataset, entry, rows, poses)
        guess = Guess(np.arange(len(rows)), self._cells(rig, rows), start_px[rows])
        asked_px = min(max(_SIGMA_SHARE * float(self.observations.sigma_px.min()), _LEAST_PX), 1e-3)
        solved = solve(rig, guess, planes, asked_px, least_hit_fraction)
        return solved.solutions.only(solved.sigma_px.max(axis=1) <= _ASTRAY * asked_px)

    def slopes(
        self,
        dataset: Dataset,
        neighbours: Sequence[tuple[Dataset, Dataset]],
        steps: Sequence[float],
        poses: np.ndarray,
        solved_px: np.ndarray,
    ) -> Slopes:
        """Derivatives at solved positions, where these are not NaN, by numbers whose neighbours are a step less and a
        step more.
        """
        ends = [((dataset, moved(poses, -turn)), (dataset, moved(poses, turn))) for turn in _POSE_STEP * np.eye(6)]
        ends += [((less, poses), (more, poses)) for less, more in neighbours]
        rates = np.full((len(solved_px), 2, len(ends)), np.nan)
        is_solved = np.isfinite(solved_px[:, 0])
        for entry, points, centres in self._cameras(dataset):
            points, centres = points[is_solved[points]], centres[is_solved[centres]]
            rates[points] = rates[centres] = 0.0
            rig, planes = rig_of(dataset, entry), self._planes(dataset, entry, points, poses)
            variations, columns = list[Variation](), list[int]()
            for column, step in enumerate([*[_POSE_STEP] * 6, *steps]):
                less, more = (self._neighbour(*end, entry, points, rig) for end in ends[column])
                has_new_camera = less.tracer is not rig.tracer or more.tracer is not rig.tracer
                if not has_new_camera and all(np.array_equal(end.planes.of_points, planes) for end in (less, more)):
                    continue  # it changes nothing before this camera
                variations.append(Variation(step, less, more))
                columns.append(column)
                if len(centres) and has_new_camera:
                    less_px, more_px = (chief_px(Rig.of(end.tracer), self._microlens[centres]) for end in (less, more))
                    rates[centres, :, column] = (more_px - less_px) / (2 * step)
            if len(points):
                solved = SolvedRows(np.arange(len(points)), self._cells(rig, points), solved_px[points], Planes(planes))
                of_rows = derivatives(rig, solved, variations).x_px.transpose(0, 2, 1)
                rates[np.ix_(points, [0, 1], columns)] = of_rows
        return Slopes(by_number=rates[:, :, 6:], by_pose=rates[:, :, :6], arm_mm=self._arms_mm(dataset, poses))

    def _arms_mm(self, dataset: Dataset, poses: np.ndarray) -> np.ndarray:
        """From origins of boards to points, in the axes of the world, (n, 3); 0 of centres."""
        arms_mm, points = np.zeros((len(self.observations), 3)), points_of(dataset)
        for view, (_, target) in enumerate(self.views.keys):
            rows = np.flatnonzero(self.views.of_rows == view)
            arms_mm[rows] = points[target].position_mm[self.observations.point_id[rows]] @ poses[view, :3, :3].T
        return arms_mm

    def _cameras(self, dataset: Dataset) -> Iterator[tuple[CameraEntry, np.ndarray, np.ndarray]]:
        """Cameras with their rows, of points and of centres."""
        entries = entries_of(dataset)
        for name in np.unique(self.observations.camera).tolist():
            is_of_camera, is_centre = self.observations.camera == name, self.observations.is_centre
            yield entries[name], np.flatnonzero(is_of_camera & ~is_centre), np.flatnonzero(is_of_camera & is_centre)

    @property
    def _microlens(self) -> np.ndarray:
        assert self.observations.microlens is not None
        return self.observations.microlens

    def _cells(self, rig: Rig, rows: np.ndarray) -> np.ndarray:
        lattice = rig.tracer.lattice
        return np.zeros(len(rows), np.int64) if lattice is None else lattice.rows(*self._microlens[rows].T)

    def _neighbour(self, end: Dataset, poses: np.ndarray, entry: CameraEntry, rows: np.ndarray, rig: Rig) -> Neighbour:
        """Rows of a camera by another reading of the stage, or with boards at other poses."""
        entry_at_end = entries_of(end)[entry.full_name]
        is_same = entry_at_end.camera == rig.tracer.camera
        tracer = rig.tracer if is_same else rig.tracer.next_to(entry_at_end.camera)
        return Neighbour(tracer, Planes(self._planes(end, entry_at_end, rows, poses)))

    def _planes(self, dataset: Dataset, entry: CameraEntry, rows: np.ndarray, poses: np.ndarray) -> np.ndarray:
        """Tangent planes at the point of each row, vision frame, (n, 4, 3)."""
        targets, camera_poses = points_of(dataset), vision_from_world(dataset, entry)
        planes = np.empty((len(rows), 4, 3))
        for view in np.unique(self.views.of_rows[rows]):
            frame, name = self.views.keys[view]
            in_view = self.views.of_rows[rows] == view
            ids, points = self.observations.point_id[rows[in_view]], targets[name]
            vision_from_target = camera_poses[frame] @ poses[view]
            planes[in_view] = tangent_planes(vision_from_target, points.position_mm[ids], points.plane_axes[ids])
        return planes

    def _at_position(
        self, position: str, dataset: Dataset, entry: CameraEntry, poses: np.ndarray, solved: Solutions
    ) -> np.ndarray:
        """Another position than J's of solved observations, (n, 2) [px]; NaN where a point has none."""
        rig, camera_poses = rig_of(dataset, entry), vision_from_world(dataset, entry)
        targets = {target.name: target.target for target in dataset.targets}
        view_of_row, x_px = self.views.of_rows[solved.point], solved.xy_px
        for view in np.unique(view_of_row):
            frame, name = self.views.keys[view]
            in_view, vision_from_target = view_of_row == view, camera_poses[frame] @ poses[view]
            points = targets[name].points()
            planes = Planes(tangent_planes(vision_from_target, points.position_mm, points.plane_axes))
            of_target = replace(solved.only(in_view), point=self.observations.point_id[solved.point[in_view]])
            x_px[in_view] = column_set(position, rig, targets[name], vision_from_target, planes, of_target).x_px
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


def moved(poses: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Poses (v, 4, 4) turned about their own origins [rad] and shifted [mm], in the axes of the world; `steps`: (v, 6)
    or (6,).
    """
    moved_poses = poses.copy()
    moved_poses[:, :3, :3] = Rotation.from_rotvec(steps[..., :3]).as_matrix() @ poses[:, :3, :3]
    moved_poses[:, :3, 3] += steps[..., 3:]
    return moved_poses


def points_of(dataset: Dataset) -> Mapping[str, TargetPoints]:
    """Points of each target of a dataset."""
    return {entry.name: _points(entry.target) for entry in dataset.targets}


_points = functools.lru_cache(maxsize=16)(lambda target: target.points())
