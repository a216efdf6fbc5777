"""Positions of points of a board on a sensor, behind microlenses or not."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.results.ready_camera import ReadyCamera


@dataclass(frozen=True, slots=True)
class Rows:
    """Positions of points: points (n, 3) of the vision frame or of a board [mm], numbers of views or distances, of
    points and of microlenses (n,), which are 0 where there are none, and positions (n, 2) [px]."""

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


def joined(parts: list[Rows]) -> Rows:
    """All of them, in this order."""
    return Rows(*(np.concatenate([getattr(part, name) for part in parts]) for name in Rows.__slots__))


def seen(
    ready: ReadyCamera, points_mm: np.ndarray, pose: np.ndarray, view: int, *, least: float = 0.0, **options: Any
) -> Rows:
    """Where a camera sees points of a frame with a pose, if so much of a bundle arrives; options are those of
    `ReadyCamera.project`."""
    answer = ready.project(points_mm @ pose[:3, :3].T + pose[:3, 3], **options)
    kept = answer.hit_fraction >= least
    point = answer.point[kept]
    microlens = np.zeros(len(point), int)
    if answer.microlens is not None:
        microlens = numbers(ready, answer.microlens[kept])
    image_px = np.stack([answer.x_px, answer.y_px], axis=1)[kept]
    return Rows(points_mm[point], np.full(len(point), view), point, microlens, image_px)


def numbers(ready: ReadyCamera, pairs: np.ndarray) -> np.ndarray:
    """Numbers of microlenses (n,) in the rig by their k and l (n, 2)."""
    number_of = {pair: number for number, pair in enumerate(map(tuple, ready.rig.axial.tolist()))}
    return np.array([number_of[pair] for pair in map(tuple, pairs.tolist())], int)


def opencv_points(columns: int, rows: int, square_mm: float) -> np.ndarray:
    """Points of a board as OpenCV has them, by id, (columns * rows, 3) [mm]: from the first corner, x right, y down."""
    row, column = np.divmod(np.arange(columns * rows), columns)
    return np.stack([column, row, np.zeros(len(row))], axis=1) * square_mm


def board_from_opencv(columns: int, rows: int, square_mm: float) -> np.ndarray:
    """Our frame of a board (its middle, y up, z to the viewer) from OpenCV's, (4, 4)."""
    result = np.diag([1.0, -1.0, -1.0, 1.0])
    result[:2, 3] = -(columns - 1) / 2 * square_mm, (rows - 1) / 2 * square_mm
    return result
