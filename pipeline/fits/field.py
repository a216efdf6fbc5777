"""Exact rays over the image of a camera's main lens: what models are fitted to, and what is said of the rays alone."""

from dataclasses import dataclass, replace

import numpy as np

from pipeline.camera.figures.equivalent_pinhole import paraxial_pinhole
from pipeline.camera.pupil.from_stop import WIDE_RAD
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.errors import UsageError
from pipeline.results.answers import PixelRays
from pipeline.results.ready_camera import ReadyCamera

COLUMNS, ROWS = 33, 25
"""Image positions along x and y, the corners of the image among them: residuals of lenses are smooth over a cell."""
_ACCURACY_PX = 1e-7
"""Error of the rays [px]: far below any residual that a model leaves."""
_LEAST_RAYS = 32
"""Fewest rays with light: more coordinates on two planes than any model has parameters."""
_BETWEEN = 5
"""Planes from the near to the far one on which residuals are looked at, these two included: the middle is in focus."""
_BEYOND = (2.0, 4.0, 10.0)
"""Distances behind the far plane at which residuals are looked at, over it [1]: away from it they settle."""


class FitError(UsageError):
    """A camera that a model cannot stand for, or a model that does not exist."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldRays:
    """Rays of image positions on a grid over the image, those without light left out."""

    x_px: np.ndarray  # (n, 2)
    rays: PixelRays
    planes_mm: tuple[float, float]  # vision z of the near and the far plane: those of J_near and J_far
    size_px: tuple[int, int]
    lit_share: float  # share of the positions that light reaches
    start: np.ndarray  # (4,), paraxial pinhole: principal distance, principal point [px], vision z [mm]

    def points(self, z_mm: float) -> np.ndarray:
        """Crossings with the plane at vision z, (n, 3) [mm]; points as far along the rays of a wide camera."""
        if (self.rays.direction[:, 2] < np.cos(WIDE_RAD)).any():
            return self.rays.origin_mm + z_mm * self.rays.direction
        return self.rays.at_distance(z_mm)

    @property
    def between_mm(self) -> tuple[float, ...]:
        """Vision z of planes from the near to the far one, in equal steps of 1 / z."""
        near, far = self.planes_mm
        middle = 1 / np.linspace(1 / near, 1 / far, _BETWEEN)[1:-1]
        return (near, *middle.tolist(), far)

    @property
    def distances_mm(self) -> tuple[float, ...]:
        """Vision z of these planes, and of some far behind."""
        return (*self.between_mm, *(self.planes_mm[1] * times for times in _BEYOND))


def field_rays(camera: ReadyCamera) -> FieldRays:
    """Trace the rays of a camera's main lens over its image, without the microlenses.

    Raises FitError: light reaches too little of the image.
    """
    tracer, rig = camera.rig.tracer, camera.rig
    bare = Tracer(replace(tracer.camera, microlenses=None), tracer.seed)
    main_lens = replace(camera, rig=Rig.of(bare, rig.square_px))
    size_px = main_lens.camera.sensor.width_px, main_lens.camera.sensor.height_px
    rays = main_lens.rays(*positions_px(size_px).T, accuracy_px=_ACCURACY_PX)
    return lit_field(camera.name, rays, main_lens.planes_mm, size_px, paraxial_pinhole(main_lens.camera))


def positions_px(size_px: tuple[int, int]) -> np.ndarray:
    """Image positions on a grid from corner to corner of an image, (n, 2)."""
    across, down = (np.linspace(-0.5, size - 0.5, count) for size, count in zip(size_px, (COLUMNS, ROWS), strict=True))
    return np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)


def lit_field(
    name: str, rays: PixelRays, planes_mm: tuple[float, float], size_px: tuple[int, int], start: np.ndarray
) -> FieldRays:
    """The field of a camera of that name, of rays at `positions_px`; the others are fields of it.

    Raises FitError: light reaches too little of the image.
    """
    lit = np.isfinite(rays.direction).all(axis=1)
    if lit.sum() < _LEAST_RAYS:
        raise FitError(f"light reaches {lit.sum()} of {len(lit)} positions of {name or 'the image'}")
    columns = ("x_px", "y_px", "origin_mm", "direction", "error_px", "hit_fraction")
    lit_rays = PixelRays(**{column: getattr(rays, column)[lit] for column in columns}, microlens=None)
    x_px = np.stack([lit_rays.x_px, lit_rays.y_px], axis=1)
    return FieldRays(
        x_px=x_px, rays=lit_rays, planes_mm=planes_mm, size_px=size_px, lit_share=float(lit.mean()), start=start
    )
