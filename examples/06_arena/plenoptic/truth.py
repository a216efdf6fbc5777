"""The truth of a plenoptic camera: rows of its boards, its micro-images, and points all over its field."""

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
import rows
from cameras import COLUMNS, ROWS, Rig
from rows import Rows

import pipeline
from pipeline.camera.figures.equivalent_pinhole import pinhole
from pipeline.results.ready_camera import ReadyCamera

_FIELD = 9, 7
"""Columns and rows of the points at which models are judged, over the image."""
_INSIDE = 0.96
"""Part of the image that they fill [1]: at its edge micro-images are cut."""
_FULL = 0.9
"""Least hit fraction of a row [1]: in the penumbra a part of the bundle is missing, and no model of a line can know."""
_ACCURACY_PX = 1e-4
"""Error of the truth [px]: far below that of any calibration."""
NOISE_PX = 0.1
"""Noise of each axis in the repeats of the calibration with noise [px]."""


class Model(Protocol):
    """A calibrated camera: where it images points of its own frame through microlenses of the true array."""

    def project(self, points_mm: np.ndarray, microlens: np.ndarray) -> np.ndarray:
        """Positions (n, 2) of points (n, 3) through microlenses (n,), NaN where the model knows none [px]."""


@dataclass(frozen=True, slots=True)
class Truth:
    """What is known of a camera.

    `boards` has points of the board's frame; `field` of the vision frame, and its views are numbers of `distances_mm`.
    Of each microlens: `vertex_mm` (m, 2) in the vision frame, `centre_px` and `centroid_px` (m, 2) of its micro-image,
    see docs/outputs.md.
    """

    rig: Rig
    ready: ReadyCamera
    poses: np.ndarray
    boards: Rows
    field: Rows
    distances_mm: np.ndarray
    vertex_mm: np.ndarray
    centre_px: np.ndarray
    centroid_px: np.ndarray

    def noisy(self, sigma_px: float, repeats: int) -> list[Rows]:
        """Rows of the boards with Gaussian noise on each axis, the same for every model that is fitted to them here."""
        return [self.boards.noisy(sigma_px, np.random.default_rng([7, 1 + number])) for number in range(repeats)]


def truth_of(rig: Rig, stage: Path, built: Path) -> Truth:
    """Solve the truth of the boards of a stage, and of points at their distances and half the way beyond.

    Centroids of micro-images are those of its build.
    """
    dataset, ready = pipeline.open_dataset(stage), pipeline.ready(stage)
    poses = np.array([frame.vision_from_target(ready.name, "Board") for frame in dataset.frames])
    near, *_, far = steps = np.array(rig.distances_mm)
    beyond = np.diff(steps)[[0, -1]] / 2
    distances = np.concatenate([[near - beyond[0]], steps, [far + beyond[1]]])
    tracer = ready.rig.tracer
    assert ready.rig.images is not None
    return Truth(
        rig,
        ready,
        poses,
        _boards(rig, ready, poses),
        _field(ready, distances),
        distances,
        tracer.vertices_mm,
        tracer.pixels_at(ready.rig.images.centre_mm),
        _centroids(built, ready),
    )


def read_table(path: Path) -> np.ndarray:
    """Rows of a table of ours or of an export, by the names of its columns; remarks are left out."""
    lines = path.read_text(encoding="utf-8").splitlines()
    return np.genfromtxt([line for line in lines if not line.startswith("#")], delimiter=",", names=True)


def _centroids(built: Path, ready: ReadyCamera) -> np.ndarray:
    table = read_table(built / f"cameras/{ready.name}/micro_images.csv")
    row = rows.numbers(ready, np.stack([table["microlens_k"], table["microlens_l"]], axis=1).astype(int))
    places = np.full((len(ready.rig.axial), 2), np.nan)
    places[row] = np.stack([table["centroid_x_px"], table["centroid_y_px"]], axis=1)
    return places


def from_opencv(rig: Rig) -> np.ndarray:
    """Our frame of the board from OpenCV's, (4, 4)."""
    return rows.board_from_opencv(COLUMNS, ROWS, rig.square_mm)


def _boards(rig: Rig, ready: ReadyCamera, poses: np.ndarray) -> Rows:
    turn = from_opencv(rig)
    points = rows.opencv_points(COLUMNS, ROWS, rig.square_mm) @ turn[:3, :3].T + turn[:3, 3]
    return rows.joined(
        [
            rows.seen(ready, points, pose, view, least=_FULL, normals=pose[:3, 2], accuracy_px=_ACCURACY_PX)
            for view, pose in enumerate(poses)
        ]
    )


def _field(ready: ReadyCamera, distances_mm: np.ndarray) -> Rows:
    stands_for, sensor = pinhole(ready.camera), ready.camera.sensor
    assert stands_for is not None
    half = _INSIDE * np.array([sensor.width_px, sensor.height_px]) / 2 / stands_for.distorted.principal_distance_px
    x, y = np.meshgrid(*(np.linspace(-size, size, count) for size, count in zip(half, _FIELD, strict=True)))
    slopes = np.stack([x.ravel(), y.ravel(), np.ones(x.size)], axis=1)
    planes = [stands_for.centre_mm + slopes * (distance - stands_for.centre_mm[2]) for distance in distances_mm]
    return rows.joined(
        [
            rows.seen(ready, points, np.eye(4), number, least=_FULL, accuracy_px=_ACCURACY_PX)
            for number, points in enumerate(planes)
        ]
    )
