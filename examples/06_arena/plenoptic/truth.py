"""The truth of a plenoptic camera: rows of its boards, its micro-images, and points all over its field."""

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from cameras import COLUMNS, ROWS, Rig

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


class Model(Protocol):
    """A calibrated camera: where it images points of its own frame through microlenses of the true array."""

    def project(self, points_mm: np.ndarray, microlens: np.ndarray) -> np.ndarray:
        """Positions (n, 2) of points (n, 3) through microlenses (n,), NaN where the model knows none [px]."""


@dataclass(frozen=True, slots=True)
class Rows:
    """Positions of points: points (n, 3) of the vision frame or of a board [mm], numbers of views or distances, of
    points and of microlenses (n,), positions (n, 2) [px]."""

    points_mm: np.ndarray
    view: np.ndarray
    point: np.ndarray
    microlens: np.ndarray
    image_px: np.ndarray

    def only(self, rows: np.ndarray) -> "Rows":
        """Some of them."""
        return Rows(*(getattr(self, name)[rows] for name in self.__slots__))

    def noisy(self, sigma_px: float, random: np.random.Generator) -> "Rows":
        """With Gaussian noise on each axis."""
        moved = self.image_px + random.normal(0, sigma_px, self.image_px.shape)
        return Rows(self.points_mm, self.view, self.point, self.microlens, moved)


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
        _rows(ready, board_mm(rig), poses),
        _field(ready, distances),
        distances,
        tracer.vertices_mm,
        tracer.pixels_at(ready.rig.images.centre_mm),
        _centroids(built, ready),
    )


def _centroids(built: Path, ready: ReadyCamera) -> np.ndarray:
    lines = (built / f"cameras/{ready.name}/micro_images.csv").read_text(encoding="utf-8").splitlines()
    table = np.genfromtxt([line for line in lines if not line.startswith("#")], delimiter=",", names=True)
    row_of = {pair: row for row, pair in enumerate(map(tuple, ready.rig.axial.tolist()))}
    rows = [row_of[int(k), int(l)] for k, l in zip(table["microlens_k"], table["microlens_l"], strict=True)]
    places = np.full((len(row_of), 2), np.nan)
    places[rows] = np.stack([table["centroid_x_px"], table["centroid_y_px"]], axis=1)
    return places


def board_mm(rig: Rig) -> np.ndarray:
    """Points of the board in its frame, by id, (54, 3)."""
    row, column = np.divmod(np.arange(COLUMNS * ROWS), COLUMNS)
    x, y = column - (COLUMNS - 1) / 2, (ROWS - 1) / 2 - row
    return rig.square_mm * np.stack([x, y, np.zeros(len(x))], axis=1)


def board_from_opencv(rig: Rig) -> np.ndarray:
    """Our frame of the board (its middle, y up, z to the viewer) from OpenCV's (its first corner, y down), (4, 4)."""
    result = np.diag([1.0, -1.0, -1.0, 1.0])
    result[:2, 3] = -(COLUMNS - 1) / 2 * rig.square_mm, (ROWS - 1) / 2 * rig.square_mm
    return result


def _rows(ready: ReadyCamera, points: np.ndarray, poses: np.ndarray) -> Rows:
    parts = []
    for view, pose in enumerate(poses):
        seen = ready.project(points @ pose[:3, :3].T + pose[:3, 3], normals=pose[:3, 2], accuracy_px=_ACCURACY_PX)
        parts.append(_lit(ready, seen, points, view))
    return _joined(parts)


def _field(ready: ReadyCamera, distances_mm: np.ndarray) -> Rows:
    stands_for, sensor = pinhole(ready.camera), ready.camera.sensor
    assert stands_for is not None
    columns, rows = _FIELD
    half = _INSIDE * np.array([sensor.width_px, sensor.height_px]) / 2 / stands_for.distorted.principal_distance_px
    x, y = np.meshgrid(np.linspace(-half[0], half[0], columns), np.linspace(-half[1], half[1], rows))
    slopes = np.stack([x.ravel(), y.ravel(), np.ones(x.size)], axis=1)
    parts = []
    for number, distance in enumerate(distances_mm):
        points = stands_for.centre_mm + slopes * (distance - stands_for.centre_mm[2])
        parts.append(_lit(ready, ready.project(points, accuracy_px=_ACCURACY_PX), points, number))
    return _joined(parts)


def _lit(ready: ReadyCamera, seen: "pipeline.results.answers.Projected", points: np.ndarray, view: int) -> Rows:
    row_of = {pair: row for row, pair in enumerate(map(tuple, ready.rig.axial.tolist()))}
    lit = seen.hit_fraction >= _FULL
    microlens = np.array([row_of[pair] for pair in map(tuple, seen.microlens[lit].tolist())], int)
    point, image = seen.point[lit], np.stack([seen.x_px, seen.y_px], axis=1)[lit]
    return Rows(points[point], np.full(len(point), view), point, microlens, image)


def _joined(parts: list[Rows]) -> Rows:
    return Rows(*(np.concatenate([getattr(part, name) for part in parts]) for name in Rows.__slots__))
