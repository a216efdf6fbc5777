"""Position images in a window around a corner, searched as a build searches them.

A window reaches half a pixel beyond the corner to all sides, and two positions more, which the search needs around the
quad that holds it. So it says no more about the corner than in which pixel it lies: noise of J is a few hundredths of a
pixel, and random numbers depend on the place in the whole fine grid, not in the window.
"""

from dataclasses import dataclass

import numpy as np
from corners import Corners
from sampling import means

from pipeline.camera.tracer import parallel_planes, target_plane
from pipeline.camera.tracing.sampling_bounds import SKIP
from pipeline.truth.grid.correspond import find
from pipeline.truth.grid.position_image import corrected, on_target
from pipeline.truth.grid.ray_grid import RayGrid, fine_from_image, image_from_fine
from pipeline.truth.settings import TruthSettings

METHODS = ("image", "two-plane")
ACCEPTED, NO_QUAD, WINDOW, LENGTHS, ANGLES = range(5)
"""What became of a corner."""
REJECTED = {NO_QUAD: "no quad", WINDOW: "window", LENGTHS: "lengths", ANGLES: "angles"}
_ROOM = 2


@dataclass(frozen=True, slots=True)
class Window:
    """Positions (h, w) of the fine grid around a corner: the first column and row, and all of them."""

    supersampling: int
    first: np.ndarray
    fine: np.ndarray
    positions_mm: np.ndarray
    lens: np.ndarray

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.fine.shape[0], self.fine.shape[1]

    @property
    def cell(self) -> np.ndarray:
        """0 in the corner's own micro-image, elsewhere -1."""
        return np.where(self.lens == SKIP, -1, 0)


def window(corners: Corners, number: int, k: int, margin_px: float) -> Window:
    """The window around a corner."""
    half = int(np.ceil(margin_px * k)) + _ROOM
    return _window(
        corners, number, k, np.rint(fine_from_image(corners.x_px[number], k)).astype(int) - half, 2 * half + 1
    )


def _window(corners: Corners, number: int, k: int, first: np.ndarray, size: int) -> Window:
    rig = corners.rig
    fine = first + np.stack(np.meshgrid(np.arange(size), np.arange(size)), axis=-1)
    positions = rig.tracer.positions_mm(*image_from_fine(fine.reshape(-1, 2).T.astype(float), k))
    assert rig.images is not None
    own = rig.images.owner(positions) == corners.cell[number]
    return Window(k, first, fine, positions, np.where(own, corners.cell[number], SKIP).reshape(size, size))


def search(
    corners: Corners,
    number: int,
    k: int,
    sampling: str,
    samples: tuple[int, ...],
    footprint: str = "pixel",
    margin_px: float = 0.5,
    seed: int | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """The paper's two methods on a corner, with its filters and thresholds.

    Returns
    -------
    (len(METHODS), len(samples), 2) float64
        Image positions by the half-pixel rule; NaN where the corner is not detected.
    (len(METHODS), len(samples)) int64
        ACCEPTED, or what rejected it.
    """
    around, tracer, pose = window(corners, number, k, margin_px), corners.rig.tracer, corners.pose[number]
    camera = tracer.camera
    planes = np.concatenate([[target_plane(pose)], parallel_planes(camera.near_mm, camera.far_mm)])
    width_mm = camera.sensor.pitch_mm / k if footprint == "pixel" else 0.0
    starts = around.positions_mm, around.lens.ravel(), around.fine.reshape(-1, 2)
    crossings = means(tracer, sampling, *starts, planes, samples, width_mm, seed)
    x, status = np.full((len(METHODS), len(samples), 2), np.nan), np.full((len(METHODS), len(samples)), NO_QUAD)
    for j in range(len(samples)):
        hit, near, far = (crossings[:, j, p].reshape(*around.shape, 2) for p in range(3))
        images = hit, on_target(near, far, camera.near_mm, camera.far_mm, pose)
        for i, (method, image) in enumerate(zip(METHODS, images, strict=True)):
            x[i, j], status[i, j] = _found(image, around, corners.point_mm[number], TruthSettings(method=method))
    return x, status


def _found(image: np.ndarray, around: Window, point_mm: np.ndarray, settings: TruthSettings) -> tuple[np.ndarray, int]:
    grid = _grid(around, *(np.zeros((*around.shape, 2)),) * 2, np.zeros((*around.shape, 10)), (0.0, 1.0))
    found, counts = find(image, point_mm[None], grid, settings)
    if not len(found.point):
        reasons = {WINDOW: "rejected_window", LENGTHS: "rejected_lengths", ANGLES: "rejected_angles"}
        return np.full(2, np.nan), next((code for code, name in reasons.items() if counts[name]), NO_QUAD)
    inside = np.array([found.x_px[0], found.y_px[0]])
    return inside + around.first / around.supersampling, ACCEPTED


def _grid(
    around: Window, near: np.ndarray, far: np.ndarray, covariance: np.ndarray, planes_mm: tuple[float, float]
) -> RayGrid:
    """The window as the search knows a camera's position images: one micro-image."""
    blank = np.zeros(around.shape)
    return RayGrid(
        supersampling=around.supersampling,
        near_mm=planes_mm[0],
        far_mm=planes_mm[1],
        near=near,
        far=far,
        covariance=covariance,
        hit_fraction=blank,
        error_px=np.zeros((*around.shape, 2)),
        cell=around.cell,
        microlenses=np.zeros((1, 3), np.int64),
        centres_px=None,
    )


def moments(corners: Corners, number: int, k: int, samples: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Method `moments` on a corner, as far as its position image goes: position (2,), derivative of J, expected error.

    NaN where the search finds nothing. The window holds whole pixels, because second moments are kept once per pixel.
    """
    wide = 3 if k > 2 else 5
    first = (np.rint(corners.x_px[number]).astype(int) - wide // 2) * k
    around, tracer, pose = _window(corners, number, k, first, wide * k), corners.rig.tracer, corners.pose[number]
    z = tracer.camera.near_mm, tracer.camera.far_mm
    starts = around.positions_mm, around.lens.ravel(), parallel_planes(*z), samples, around.fine.reshape(-1, 2)
    bundle = tracer.moments(*starts)
    near, far = (bundle[:, i : i + 2].reshape(*around.shape, 2) for i in (0, 2))
    covariance = bundle[:, 4:14].reshape(*around.shape, 10)[k // 2 :: k, k // 2 :: k]
    grid = _grid(around, near, far, covariance, z)
    image = corrected(on_target(near, far, *z, pose), grid, pose)
    found, _ = find(image, corners.point_mm[number][None], grid, TruthSettings(method="moments"))
    if not len(found.point):
        return np.full(2, np.nan), np.full((2, 2), np.nan), float("nan")
    inside = np.array([found.x_px[0], found.y_px[0]])
    return inside + first / k, found.jacobian[0], float(found.error_px[0])
