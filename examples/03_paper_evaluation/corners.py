"""The corners that the evaluation looks at: a random sample of all that exist, with their positions solved directly."""

from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

import pipeline
from pipeline.camera.focusing.depth_of_field import focused
from pipeline.camera.parts.camera import Camera
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.optics.first_order import first_order
from pipeline.truth.direct.direct_rows import Guess, guesses, solve
from pipeline.truth.judging import Rows, differences
from pipeline.truth.planes import Exposed, tangent_planes

STAGE = Path(__file__).resolve().parent / "dataset.usda"
ROUGH_PX, ACCURACY_PX = 1e-2, 1e-5
"""Accuracy with which rows are listed, and with which those that are drawn are known."""
MIN_HIT_FRACTION = 0.05
SHARP_MM = 430.0
"""Distance that the camera without microlenses sees sharply: the middle of the boards' distances."""
_SEED = 2019


@dataclass(frozen=True, slots=True)
class Corners:
    """Pairs of a board's corner and a microlens that sees it, or the sensor of a camera without any, n of them.

    Attributes
    ----------
    rig : Rig
    exist : int
        Of so many they were drawn.
    pose : (n, 4, 4) float64
        vision_from_target.
    point_mm : (n, 3) float64
        Target frame.
    plane : (n, 4, 3) float64
        Tangent plane, as the solver wants it.
    cell : (n,) int64
    x_px, sigma_px : (n, 2) float64
        The truth, and its error.
    jacobian : (n, 2, 2) float64
        Derivative of J by image position.
    blur_px : (n,) float64
        Root mean square of a bundle's width per axis.
    hit_fraction : (n,) float64
    """

    rig: Rig
    exist: int
    pose: np.ndarray
    point_mm: np.ndarray
    plane: np.ndarray
    cell: np.ndarray
    x_px: np.ndarray
    sigma_px: np.ndarray
    jacobian: np.ndarray
    blur_px: np.ndarray
    hit_fraction: np.ndarray

    def __len__(self) -> int:
        return len(self.cell)

    def only(self, rows: slice) -> "Corners":
        """Some of them."""
        shared = ("rig", "exist")
        return Corners(
            **{f.name: getattr(self, f.name) if f.name in shared else getattr(self, f.name)[rows] for f in fields(self)}
        )

    def solved(self, accuracy_px: float) -> np.ndarray:
        """Positions by method `direct` from its own first guesses, (n, 2); NaN where it finds none."""
        positions_px = np.full((len(self), 2), np.nan)
        guess, _ = guesses(self.rig, self.plane)
        wanted = guess.only(guess.cell == self.cell[guess.point])
        rows = solve(self.rig, wanted, self.plane, accuracy_px, MIN_HIT_FRACTION).solutions
        positions_px[rows.point] = np.stack([rows.x_px, rows.y_px], axis=1)
        return positions_px

    def judged(self, claim_px: float) -> tuple[np.ndarray, np.ndarray]:
        """What random rays move the positions by, and their own standard error, (n, 2) each."""
        rows = Rows(Exposed.still(self.plane), self.cell, self.x_px, is_direct=True)
        return differences(self.rig, rows, claim_px)[:2]


def camera_and_boards() -> tuple[Camera, int, list[np.ndarray], np.ndarray]:
    """The camera of the dataset in focus, its seed, all poses of the board, and its corners (p, 3)."""
    dataset = pipeline.open_dataset(STAGE)
    (entry,), (board,) = dataset.cameras, dataset.targets
    poses = [frame.vision_from_target(entry.name, board.name) for frame in dataset.frames]
    return entry.camera, dataset.seed, poses, board.target.points().position_mm


def without_microlenses(camera: Camera) -> Camera:
    """The same lens, stop and pixels, with the sensor where SHARP_MM is in focus."""
    sensor_mm = -first_order(camera.prescription).image_mm(SHARP_MM)
    return focused(replace(camera, microlenses=None, sensor_distance_mm=sensor_mm, near_mm=None, far_mm=None))


def draw(
    count: int, frames: slice = slice(None), points: slice = slice(None), *, conventional: bool = False
) -> Corners:
    """So many pairs, drawn without repetition from all that exist in some frames for some corners.

    The first of many are those that are drawn where fewer are wanted.
    """
    camera, seed, poses, corners_mm = camera_and_boards()
    tracer = Tracer(without_microlenses(camera) if conventional else camera, seed)
    rig = Rig.of(tracer)
    poses, corners_mm = poses[frames], corners_mm[points]
    pose = np.repeat(poses, len(corners_mm), axis=0)
    point = np.tile(corners_mm, (len(poses), 1))
    plane = np.concatenate([tangent_planes(one, corners_mm) for one in poses])
    guess, _ = guesses(rig, plane)
    listed = solve(rig, guess, plane, ROUGH_PX, MIN_HIT_FRACTION)
    drawn = listed.only(np.random.default_rng(_SEED).permutation(len(listed.solutions.point))[:count])
    rough = drawn.solutions
    start = Guess(np.arange(len(rough.point)), rough.cell, np.stack([rough.x_px, rough.y_px], axis=1))
    sharp = solve(rig, start, plane[rough.point], ACCURACY_PX, 0.0)
    order = np.argsort(sharp.solutions.point)
    if len(order) != len(rough.point):
        raise RuntimeError(
            f"{len(rough.point) - len(order)} rows lie so close to the edge of a cell that they got lost"
        )
    sharp = sharp.only(order)
    chosen = rough.point
    return Corners(
        rig=rig,
        exist=len(listed.solutions.point),
        pose=pose[chosen],
        point_mm=point[chosen],
        plane=plane[chosen],
        cell=rough.cell,
        x_px=np.stack([sharp.solutions.x_px, sharp.solutions.y_px], axis=1),
        sigma_px=sharp.sigma_px,
        jacobian=sharp.solutions.jacobian,
        blur_px=np.sqrt(np.trace(sharp.blur_px2, axis1=1, axis2=2) / 2),
        hit_fraction=sharp.hit_fraction,
    )
