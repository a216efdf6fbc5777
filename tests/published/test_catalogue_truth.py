"""Claim: with the indices of catalogue glasses instead of its printed ones the paper's rig moves its truth by about
0.02 px on average and 0.04 px at the edges of micro-images and far from focus.

The image position of a target point solves J(x) = X. Both lenses are traced from the same positions with the same
rays, so what is left of their J over its slope is the move of x, without noise from sampling.
"""

from dataclasses import replace

import numpy as np
import pytest
from laws import rigs
from tolerances import MOVED_TRUTH_PX

from pipeline.camera.micro_images.centres import micro_images
from pipeline.camera.parts.camera import Camera
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.optics.glass.catalogue import find

GLASSES = {1.67: "hikari:BAF10", 1.699: "schott:SF15", 1.603: "schott:F5", 1.658: "ohara:LAL11", 1.717: "hoya:LAF3"}
D_NM = 587.5618
NEAR_MM, FAR_MM = 375.0, 470.0
"""Depths of the boards of the plenoptic example."""


def with_catalogue_indices(camera: Camera) -> Camera:
    lens = camera.prescription
    surfaces = [replace(s, index=find(GLASSES[s.index]).index(D_NM) if s.index != 1 else 1.0) for s in lens.surfaces]
    return replace(camera, prescription=replace(lens, surfaces=tuple(surfaces)))


@pytest.fixture(scope="module")
def cameras() -> tuple[Camera, Camera]:
    """The paper's rig with 800 x 600 pixels, printed and catalogue."""
    printed = rigs.plenoptic(width_px=800, height_px=600)
    return printed, with_catalogue_indices(printed)


def test_the_truth_moves_by_hundredths_of_a_pixel(cameras: tuple[Camera, Camera]) -> None:
    """At 25 positions of each of 40 micro-images all over the sensor, for targets at both planes."""
    tracers = [Tracer(camera, seed=1) for camera in cameras]
    images = micro_images(tracers[0])
    inside = np.flatnonzero((abs(images.centre_mm) < [3.85, 2.85]).all(axis=1))
    owner = np.repeat(inside[:: len(inside) // 40], 25)
    grid = np.stack(np.meshgrid(*[np.arange(-7.0, 8.0, 3.5)] * 2), axis=-1).reshape(-1, 2) * 0.01
    start = images.centre_mm[owner] + np.tile(grid, (len(owner) // 25, 1))
    step_mm = 0.0025
    planes, pixels = parallel_planes(NEAR_MM, FAR_MM), np.zeros((len(owner), 2), int)

    def crossings(tracer: Tracer, dx_mm: float = 0.0, dy_mm: float = 0.0) -> np.ndarray:
        """Where the mean ray meets both planes, (n, plane, 2)."""
        return tracer.moments(start + np.array([dx_mm, dy_mm]), owner, planes, 1024, pixels)[:, :4].reshape(-1, 2, 2)

    printed, catalogue = tracers
    slope = np.stack(
        [
            (crossings(printed, dx, dy) - crossings(printed, -dx, -dy)) / (2 * step_mm)
            for dx, dy in ((step_mm, 0.0), (0.0, step_mm))
        ],
        axis=-1,
    )
    gap = crossings(catalogue) - crossings(printed)
    moved_px = np.linalg.norm(np.linalg.solve(slope, gap[..., None])[..., 0], axis=-1) / 0.01
    assert moved_px.max() < MOVED_TRUTH_PX
    assert moved_px.mean() > MOVED_TRUTH_PX / 4
