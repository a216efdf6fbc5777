"""The wavefront that forms the image of a point: optical path and aperture over the traced exit pupil.

Rays are traced from the image position through the camera to a sphere around the object point, which they reach with
almost equal paths. By the reciprocity of light, what the paths lack of being equal is the wavefront error of the light
of that point at the image position. The pupil is described by direction cosines at the sensor: in them an extended,
evenly radiating surface fills it evenly (irradiance is the integral of cos theta d omega), and an unaberrated image is
its Fourier transform, at any aperture.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.camera.parts.errors import CameraError
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS, outlines_at
from pipeline.camera.wave.paths import PathRays, sent
from pipeline.optics.first_order import first_order
from pipeline.records.shapes import Float64

_COARSE = 65
"""Directions along an axis that find out where light passes: a pupil is then known to a thirtieth of its width."""
_SIZES = (256, 512, 1024)
"""Cells along an axis of the pupil: the first with which the image is far narrower than what the cells resolve."""
_FILLED = 0.25
"""Share of the field of an image, as the cells resolve it, that rays may reach from its middle: half of it would fill
it, and diffracted light goes on from there."""
_PARTS = 8
"""Parts along each axis of a cell at the pupil's edge: its share is right to about a hundredth."""
_ROUNDS = 3
"""Times that light is looked for in the square that the time before left: a pupil may be small in its bounds."""


@dataclass(frozen=True, slots=True)
class View:
    """An image position and the object that it sees."""

    position_mm: Float64[np.ndarray, "2"]  # position on the sensor, vision frame
    microlens: int  # row of the microlens that light passes, or `NO_MICROLENS`
    object_mm: float  # vision z of the plane of the object point; inf: infinitely far


@dataclass(frozen=True)
class Wavefront:
    """A pupil as square cells of direction cosines at the sensor, rows along y."""

    wavelength_mm: float
    # Direction cosines of the middle of the pupil, x and y of the vision frame, from the sensor to the scene
    centre: Float64[np.ndarray, "2"]
    step: float  # edge of a cell [1]
    path_mm: Float64[np.ndarray, "n n"]  # wavefront error in the middles of the cells; its mean over the pupil is 0
    share: Float64[np.ndarray, "n n"]  # share of each cell that light passes

    @property
    def cosines(self) -> tuple[np.ndarray, np.ndarray]:
        """Direction cosines of columns and of rows, (n,) each."""
        return _axes(self.centre, self.step, len(self.share))

    @property
    def area(self) -> float:
        """Integral of cos theta d omega over the pupil [sr]."""
        return float(self.share.sum() * self.step**2)

    @property
    def numerical_aperture(self) -> float:
        """Numerical aperture of the circle with the pupil's area."""
        return math.sqrt(self.area / math.pi)

    @cached_property
    def semi_axes(self) -> np.ndarray:
        """The matrix (2, 2) of the ellipse with the pupil's second moments, twice the root of its covariance."""
        a, b = self.cosines
        weight = self.share / self.share.sum()
        x, y = (a - weight.sum(axis=0) @ a, b - weight.sum(axis=1) @ b)
        xx, yy, xy = weight.sum(axis=0) @ x**2, weight.sum(axis=1) @ y**2, y @ weight @ x
        values, vectors = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]))
        return 2 * (vectors * np.sqrt(values)) @ vectors.T

    @cached_property
    def error_waves(self) -> tuple[float, float]:
        """Root mean square and extent of the wavefront error without piston and tilt [wavelengths]."""
        a, b = np.meshgrid(*self.cosines)
        lit = self.share > 0
        weight, path = np.sqrt(self.share[lit]), self.path_mm[lit]
        terms = np.stack([np.ones(len(path)), a[lit] - self.centre[0], b[lit] - self.centre[1]], axis=1)
        fit = np.linalg.lstsq(terms * weight[:, None], path * weight, rcond=None)[0]
        rest = (path - terms @ fit) / self.wavelength_mm
        return float(np.sqrt((weight**2 @ rest**2) / (weight @ weight))), float(np.ptp(rest))

    @cached_property
    def crossings_mm(self) -> np.ndarray:
        """Crossings of rays through the middles of the cells with the sensor, from the image position, (n, n, 2).

        By geometry: the gradient of the wavefront error by direction cosine.
        """
        dy, dx = np.gradient(self.path_mm, self.step)
        return np.stack([dx, dy], axis=-1)

    def perfect(self) -> "Wavefront":
        """The same pupil without any error."""
        return Wavefront(self.wavelength_mm, self.centre, self.step, np.zeros_like(self.path_mm), self.share)


def wavefront(tracer: Tracer, view: View, wavelength_nm: float) -> Wavefront:
    """Trace the wavefront of the light that a view receives; the camera of the tracer has the indices of that light.

    The object point is the one that the position sees by geometry: the mean of the crossings of its rays with the plane
    of the object (of their directions, if that is infinitely far).

    Raises CameraError: no light arrives, or the blur is so wide that diffraction has no part in it.
    """
    centre, width = _pupil(tracer, view)
    for size in _SIZES:
        front = _wavefront_of(tracer, view, wavelength_nm * 1e-6, (centre, width / (size - 2), size))
        lit = front.share > 0
        reach = np.hypot(*front.crossings_mm[lit].T).max()
        if reach < _FILLED * front.wavelength_mm / front.step:
            return front
    airy_mm = 0.61 * front.wavelength_mm / front.numerical_aperture
    blur = f"the blur of geometry is {reach / airy_mm:.0f} times as wide as the Airy disc"
    raise CameraError(f"{blur}: no wavefront is needed there", hint="choose an object nearer to the focus")


def aperture(tracer: Tracer, view: View, wavelength_nm: float, size: int) -> Wavefront | None:
    """The pupil of a view in so many cells along an axis, as if it had no aberrations; None where no light arrives."""
    try:
        centre, width = _pupil(tracer, view, size + 1, 1)
    except CameraError:
        return None
    step = width / (size - 2)
    share = _shares(tracer, view, (centre, step, size), 4)
    return Wavefront(wavelength_nm * 1e-6, centre, step, np.zeros((size, size)), share)


def _wavefront_of(tracer: Tracer, view: View, wavelength_mm: float, grid: tuple[np.ndarray, float, int]) -> Wavefront:
    """The wavefront in a grid of cells: middle, edge of a cell, cells along an axis."""
    centre, step, size = grid
    columns, rows = _axes(centre, step, size)
    rays = _sent(tracer, view, *np.meshgrid(columns, rows))
    share = _shares(tracer, view, grid, _PARTS)
    known = np.isfinite(rays.path_mm).reshape(size, size)
    share = np.where(known, share, 0.0)
    path = _to_object(rays, share.ravel(), view.object_mm, _aperture_mm(tracer, view)).reshape(size, size)
    path -= np.sum(np.where(known, path, 0.0) * share) / share.sum()
    return Wavefront(wavelength_mm, centre, step, np.where(known, path, 0.0), share)


def _axes(centre: np.ndarray, step: float, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Middles of the cells along x and y."""
    offset = (np.arange(size) - (size - 1) / 2) * step
    return centre[0] + offset, centre[1] + offset


def _sent(tracer: Tracer, view: View, a: np.ndarray, b: np.ndarray) -> PathRays:
    """Rays of the view with these direction cosines; those beyond 90 degrees do not pass."""
    a, b = a.ravel(), b.ravel()
    squared = a * a + b * b
    upright = np.sqrt(np.maximum(1 - squared, 1e-12))
    rays = sent(tracer, view.microlens, view.position_mm, np.column_stack([a, b, upright]))
    return rays._replace(passes=rays.passes & (squared < 1))


def _pupil(tracer: Tracer, view: View, count: int = _COARSE, rounds: int = _ROUNDS) -> tuple[np.ndarray, float]:
    """Middle and width of the square of direction cosines in which all light of the view lies."""
    low, high = _outline(tracer, view)
    for _ in range(rounds):
        columns, rows = (np.linspace(low[i], high[i], count) for i in range(2))
        a, b = np.meshgrid(columns, rows)
        passes = _sent(tracer, view, a, b).passes.reshape(a.shape)
        if not passes.any():
            raise CameraError("no light arrives at that image position", hint="choose one inside of the image circle")
        cell = (high - low) / (count - 1)
        low, high = (
            np.array([end(a[passes]), end(b[passes])]) + sign * cell for end, sign in ((np.min, -1), (np.max, 1))
        )
    return (low + high) / 2, float((high - low).max())


def _outline(tracer: Tracer, view: View) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest direction cosines within the bounds of the camera, (2,) each."""
    optics = tracer.arrays.optics
    if view.microlens == NO_MICROLENS:
        polygon = np.empty((1, tracer.arrays.outlines.shape[2], 2))
        outlines_at(optics.step_mm, tracer.arrays.outlines, view.position_mm[None].copy(), polygon)
        corners = polygon[0]
    else:
        corners = tracer.arrays.microlenses[view.microlens, :2] + 1.05 * tracer.arrays.aperture
    ahead = optics.sampling_z_mm - optics.sensor_z_mm
    across = np.column_stack([corners - view.position_mm, np.full(len(corners), ahead)])
    cosines = (across / np.linalg.norm(across, axis=1, keepdims=True))[:, :2]
    slack = 0.02 * np.ptp(cosines, axis=0).max()
    return cosines.min(axis=0) - slack, cosines.max(axis=0) + slack


def _shares(tracer: Tracer, view: View, grid: tuple[np.ndarray, float, int], parts: int) -> np.ndarray:
    """Share of each cell that light passes: of cells with an edge by parts of them."""
    centre, step, size = grid
    corners = _axes(centre, step, size + 1)
    at_corners = _sent(tracer, view, *np.meshgrid(*corners)).passes.reshape(size + 1, size + 1)
    of_cell = np.stack([at_corners[1:, 1:], at_corners[1:, :-1], at_corners[:-1, 1:], at_corners[:-1, :-1]])
    row, column = np.nonzero(of_cell.any(axis=0) & ~of_cell.all(axis=0))
    share = of_cell.all(axis=0).astype(float)
    columns, rows = _axes(centre, step, size)
    offset = ((np.arange(parts) + 0.5) / parts - 0.5) * step
    a = columns[column][:, None, None] + offset[None, None, :] + 0 * offset[None, :, None]
    b = rows[row][:, None, None] + offset[None, :, None] + 0 * offset[None, None, :]
    share[row, column] = _sent(tracer, view, a, b).passes.reshape(-1, parts**2).mean(axis=1)
    return share


def _to_object(rays: PathRays, weight: np.ndarray, object_mm: float, aperture_mm: float) -> np.ndarray:
    """Path from the sensor to a sphere around the object point through the image of the aperture, (n,).

    Rays that miss the point by m come from it by another way through the aperture, whose image is at the distance R:
    longer by m^2 / (2 R).
    """
    lit = weight > 0
    position, direction, weight = rays.position_mm, rays.direction, weight[lit] / weight.sum()
    mean = weight @ direction[lit]
    if math.isinf(object_mm):
        return rays.path_mm - (position - weight @ position[lit]) @ (mean / np.linalg.norm(mean))
    along = (object_mm - position[:, 2]) / direction[:, 2]
    crossing = position + along[:, None] * direction
    point = weight @ crossing[lit]
    ahead = np.sum((point - position) * direction, axis=1)
    missed = np.sum((point - position - ahead[:, None] * direction) ** 2, axis=1)
    radius = (object_mm - aperture_mm) / mean[2]
    return rays.path_mm + ahead + missed / (2 * radius)


def _aperture_mm(tracer: Tracer, view: View) -> float:
    """Vision z of the image of the limiting aperture: the entrance pupil, or that of the microlenses."""
    lens = first_order(tracer.camera.prescription)
    return lens.entrance_pupil.z_mm if view.microlens == NO_MICROLENS else lens.object_mm(tracer.film_z_mm)
