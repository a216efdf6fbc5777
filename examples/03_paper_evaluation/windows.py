"""Position images in a window around a corner, searched as a build searches them.

A window reaches half a pixel beyond the corner to all sides, and two positions more, which the search needs around the
quad that holds it. So it says no more about the corner than in which pixel it lies: noise of J is a few hundredths of a
pixel, and random numbers depend on the place in the whole fine grid, not in the window.
"""

from dataclasses import dataclass

import numpy as np
from corners import Corners
from sampling import PRECISIONS, means

from pipeline.camera.tracer import parallel_planes, target_plane
from pipeline.camera.tracing.sampling_bounds import SKIP
from pipeline.truth.grid.correspond import find
from pipeline.truth.grid.position_image import on_target
from pipeline.truth.grid.ray_grid import RayGrid, fine_from_image, image_from_fine
from pipeline.truth.settings import TruthSettings

METHODS = ("image", "two-plane")
BOARD_MM = 56.0, 35.0
"""Size of the board, on which texture coordinates grow by 1."""
ACCEPTED, NO_QUAD, WINDOW, LENGTHS, ANGLES = range(5)
"""What became of a corner."""
REJECTED = {NO_QUAD: "no quad", WINDOW: "window", LENGTHS: "lengths", ANGLES: "angles"}
_ROOM = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Variant:
    """Sums in one of PRECISIONS, and the filters of the search: the paper's but for what is given."""

    precision: str = "double"
    filter: str = "lengths-and-angles"
    lambda_d: float = 0.15
    lambda_alpha_deg: float = 10.0

    def settings(self, method: str) -> TruthSettings:
        """The search of a build by this method."""
        limits = {"lambda_d": self.lambda_d, "lambda_alpha_deg": self.lambda_alpha_deg}
        return TruthSettings(method=method, filter=self.filter, **limits)


PLAIN, SINGLE, NO_FILTER = Variant(), Variant(precision="single"), Variant(filter="none")
VARIANTS = (
    SINGLE,
    *(Variant(lambda_d=limit) for limit in (0.05, 0.1, 0.3, 0.6)),
    *(Variant(lambda_alpha_deg=limit) for limit in (2.5, 5.0, 20.0, 40.0)),
    NO_FILTER,
)


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
    rig, cell = corners.rig, corners.cell[number : number + 1]
    fine = first + np.stack(np.meshgrid(np.arange(size), np.arange(size)), axis=-1)
    positions = rig.tracer.positions_mm(*image_from_fine(fine.reshape(-1, 2).T.astype(float), k))
    (own,) = rig.microlens(cell)
    lens = np.where(rig.microlens_at(positions) == own, own, SKIP)
    return Window(k, first, fine, positions, lens.reshape(size, size))


def search(
    corners: Corners,
    number: int,
    k: int,
    sampling: str,
    samples: tuple[int, ...],
    footprint: str = "pixel",
    margin_px: float = 0.5,
    seed: int | None = None,
    variants: tuple[Variant, ...] = (PLAIN,),
) -> tuple[np.ndarray, np.ndarray]:
    """The paper's two methods on a corner, from the same rays in all variants.

    Returns
    -------
    (len(variants), len(METHODS), len(samples), 2) float64
        Image positions by the half-pixel rule; NaN where the corner is not detected.
    (len(variants), len(METHODS), len(samples)) int64
        ACCEPTED, or what rejected it.
    """
    around, tracer, pose = window(corners, number, k, margin_px), corners.rig.tracer, corners.pose[number]
    camera = tracer.camera
    planes = np.concatenate([[target_plane(pose)], parallel_planes(camera.near_mm, camera.far_mm)])
    width_mm = camera.sensor.pitch_mm / k if footprint == "pixel" else 0.0
    starts = around.positions_mm, around.lens.ravel(), around.fine.reshape(-1, 2)
    # A texture begins at a corner of the board; the two planes have coordinates in mm.
    spans = np.array([[[-size / 2, size] for size in BOARD_MM], *[[[0.0, 1.0]] * 2] * 2])
    crossings = means(tracer, sampling, *starts, planes, spans, samples, width_mm, seed)
    shape = len(variants), len(METHODS), len(samples)
    x, status = np.full((*shape, 2), np.nan), np.full(shape, NO_QUAD)
    for v, variant in enumerate(variants):
        sums = crossings[PRECISIONS.index(variant.precision)]
        for j in range(len(samples)):
            hit, near, far = (sums[:, j, p].reshape(*around.shape, 2) for p in range(3))
            images = hit, on_target(near, far, camera.near_mm, camera.far_mm, pose)
            for i, (method, image) in enumerate(zip(METHODS, images, strict=True)):
                search = image, around, corners.point_mm[number], variant.settings(method)
                x[v, i, j], status[v, i, j] = _first_position(*search)
    return x, status


def _first_position(
    image: np.ndarray, around: Window, point_mm: np.ndarray, settings: TruthSettings
) -> tuple[np.ndarray, int]:
    grid = position_grid(around.supersampling, around.cell)
    positions, counts = find(image, point_mm[None], grid, settings)
    if not len(positions.point):
        reasons = {WINDOW: "rejected_window", LENGTHS: "rejected_lengths", ANGLES: "rejected_angles"}
        return np.full(2, np.nan), next((code for code, name in reasons.items() if counts[name]), NO_QUAD)
    inside = np.array([positions.x_px[0], positions.y_px[0]])
    return inside + around.first / around.supersampling, ACCEPTED


def position_grid(k: int, cell: np.ndarray, microlenses: np.ndarray | None = None) -> RayGrid:
    """Positions as the search knows them, without bundles: by default of one micro-image."""
    blank = np.zeros((*cell.shape, 2))
    return RayGrid(
        supersampling=k,
        near_mm=0.0,
        far_mm=1.0,
        near=blank,
        far=blank,
        covariance=np.zeros((*cell.shape, 10)),
        hit_fraction=blank[..., 0],
        error_px=blank,
        cell=cell,
        microlenses=np.zeros((1, 3), np.int64) if microlenses is None else microlenses,
        centres_px=None,
    )
