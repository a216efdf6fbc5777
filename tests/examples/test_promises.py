"""What example 01 promises: the whole board in every frame, large squares, and frames that are sharp."""

from pathlib import Path

import numpy as np
import pytest

import pipeline
from pipeline.camera.tracer import Tracer, target_plane
from pipeline.camera.tracing.moments import COVARIANCE
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.graph.poses import vision_from_target

STAGE = Path(__file__).parents[2] / "examples/01_conventional/dataset.usda"
SAMPLES = 256


@pytest.fixture(scope="module")
def dataset():
    return pipeline.open_dataset(STAGE)


def moments(dataset, frame, x_px, y_px):
    """Moments on the board's own plane, so that the mean is J in the target frame."""
    entry = dataset.cameras[0]
    tracer = Tracer(entry.camera, dataset.seed)
    pose = vision_from_target(frame, entry.name, dataset.targets[0].name)
    planes = np.stack([target_plane(pose)] * 2)
    pixels = np.stack([x_px, y_px], axis=1)
    lens = np.full(len(x_px), NO_MICROLENS)
    return tracer.moments(tracer.positions_mm(x_px, y_px), lens, planes, SAMPLES, pixels.astype(int))


def test_the_whole_board_with_its_margin_is_seen_in_every_frame(dataset):
    """Every pixel of the image's border looks past the board, and the middle of the image at it."""
    sensor, drawing = dataset.cameras[0].camera.sensor, dataset.targets[0].target.pattern.drawing
    half_x, half_y = drawing.half_x_mm, drawing.half_y_mm
    x, y = np.meshgrid(np.linspace(0, sensor.width_px - 1, 41), np.linspace(0, sensor.height_px - 1, 31))
    border = (x == 0) | (y == 0) | (x == x.max()) | (y == y.max())
    x, y = np.append(x[border], x.mean()), np.append(y[border], y.mean())
    for frame in dataset.frames:
        seen = moments(dataset, frame, x, y)[:, :2]
        inside = (np.abs(seen[:, 0]) <= half_x) & (np.abs(seen[:, 1]) <= half_y)
        assert not inside[:-1].any()
        assert inside[-1]


def test_squares_are_large_and_two_frames_are_sharp(dataset):
    """At least 12 px per square, everywhere; and blur_xx + blur_yy below 1 px^2 at all corners of two frames."""
    board, sensor = dataset.targets[0].target.pattern, dataset.cameras[0].camera.sensor
    x, y = (
        grid.ravel()
        for grid in np.meshgrid(np.arange(20.0, sensor.width_px, 40), np.arange(20.0, sensor.height_px, 40))
    )
    sharp = 0
    for frame in dataset.frames:
        here = moments(dataset, frame, x, y)
        jacobian = np.stack(
            [
                moments(dataset, frame, x + 1, y)[:, :2] - here[:, :2],
                moments(dataset, frame, x, y + 1)[:, :2] - here[:, :2],
            ],
            axis=-1,
        )
        corner = board.points_mm()[:, :2]
        on_board = (np.abs(here[:, :2]) <= np.abs(corner).max(axis=0) + board.square_mm).all(axis=1)
        pixels_per_mm = np.linalg.svd(np.linalg.inv(jacobian[on_board]), compute_uv=False)
        assert pixels_per_mm.min() * board.square_mm >= 12
        covariance = here[on_board][:, COVARIANCE + np.array([0, 1, 1, 4])].reshape(-1, 2, 2)
        inverse = np.linalg.inv(jacobian[on_board])
        blur = np.trace(inverse @ covariance @ inverse.transpose(0, 2, 1), axis1=1, axis2=2)
        sharp += bool(np.all(blur < 1))
    assert sharp >= 2
