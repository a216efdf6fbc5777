"""The wavefront that forms the image of a point: optical path and aperture over the traced exit pupil.

Rays are traced from the image position through the camera to a sphere around the object point, which they reach with
nearly equal optical paths. By reciprocity, the differences of these paths are the wavefront error W of the point's
light at the image position. The pupil is described by direction cosines at the sensor: in them an extended, evenly
radiating surface fills it evenly (irradiance is the integral of cos theta d omega), and an unaberrated image is its
Fourier transform, at any aperture.

The optical path of a ray is the sum of index times distance, surface by surface, through the models of
`camera.tracing.microlens_kernels`, for whole arrays. An ideal thin lens has no thickness: its path is the phase whose
gradient is the deflection of the rays, that which maps the light of a point to that of its image.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from pipeline.camera.parts.errors import CameraError
from pipeline.camera.pupil.from_stop import WIDE_RAD
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing import microlens_kernels as column
from pipeline.camera.tracing.microlens_kernels import PLAIN, THIN, TWO_PLANE
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS, outlines_around
from pipeline.frames import apply, inverse
from pipeline.optics.first_order import first_order
from pipeline.optics.rays import dot, traced
from pipeline.optics.table import INDEX_RATIO, POSE, TERMS, motion_of, towards_scene
from pipeline.records.shapes import Bool, Float64

_COARSE = 65
"""Directions along an axis of the first search for light: a pupil is then known to a thirtieth of its width."""
_SIZES = (256, 512, 1024)
"""Cells along an axis of the pupil: the first number that resolves much more than the width of the image."""
_FILLED = 0.25
"""Largest radius of the rays over the field of an image that the cells resolve [1]: half would fill it, and diffracted
light reaches farther."""
_PARTS = 8
"""Parts along each axis of a cell at the pupil's boundary: its share is right to about a hundredth."""
_ROUNDS = 3
"""Rounds of the search for light, each in the square that the previous one left: a pupil may be small in its bounds."""


class PathRays(NamedTuple):
    """Rays with their optical paths."""

    # A point of each ray and its unit direction; NaN where it missed a surface
    position_mm: Float64[np.ndarray, "n 3"]
    direction: Float64[np.ndarray, "n 3"]
    passes: Bool[np.ndarray, "n"]  # whether it has passed all apertures; blocked rays are carried along
    path_mm: Float64[np.ndarray, "n"]  # optical path from the start to the point
    medium: float = 1.0  # refractive index of the medium that the rays are in, relative to air

    @property
    def slope(self) -> np.ndarray:
        """dx/dz and dy/dz, (n, 2)."""
        return self.direction[:, :2] / self.direction[:, 2:]


def with_path(table: Float64[np.ndarray, "surfaces columns"], rays: PathRays) -> PathRays:
    """Trace rays through all surfaces of a table from `optics.table`, to the last one."""
    for row in table:
        position, direction, passes = traced(row[None], rays.position_mm, rays.direction)
        path = rays.path_mm + rays.medium * dot(position - rays.position_mm, rays.direction)
        behind = PathRays(position, direction, rays.passes & passes, path, rays.medium / row[INDEX_RATIO])
        if row[TERMS] < 0:
            behind = behind._replace(path_mm=path + _path_of_ideal_lens(row, behind, rays.direction))
        rays = behind
    return rays


def _path_of_ideal_lens(row: np.ndarray, behind: PathRays, before: np.ndarray) -> np.ndarray:
    """Path added by an ideal thin lens to rays behind it, by their directions before it, (n,) [mm]."""
    centred_from_surface = inverse(motion_of(row)) if row[POSE] else np.eye(4)
    offset = apply(centred_from_surface, behind.position_mm)[:, :2]
    directions = (direction @ centred_from_surface[:3, :3].T for direction in (before, behind.direction))
    slopes = (direction[:, :2] / direction[:, 2:] for direction in directions)
    return behind.medium * ideal_path(offset, *slopes)


def ideal_path(
    offset_mm: Float64[np.ndarray, "n 2"], before: Float64[np.ndarray, "n 2"], behind: Float64[np.ndarray, "n 2"]
) -> np.ndarray:
    """Path added by an ideal thin lens to rays from one point, 0 in its middle, (n,) [mm].

    With s the slope of a ray at the distance p from the middle and a that of the undeviated ray through the middle,
    light of a point has the path (a + s) p / (sqrt(1 + a^2) + sqrt(1 + s^2)) across the plane of the lens.
    """
    finite = np.isfinite(before).all(axis=1) & np.isfinite(offset_mm).all(axis=1)
    terms = np.column_stack([np.ones(len(offset_mm)), offset_mm])
    middle = np.linalg.lstsq(terms[finite], before[finite], rcond=None)[0][0]
    return _path_across(offset_mm, middle, behind) - _path_across(offset_mm, middle, before)


def _path_across(offset: np.ndarray, middle: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Path of light of a point across the plane of the lens, by the formula of `ideal_path`, (n,) [mm]."""
    roots = np.sqrt(1 + middle @ middle) + np.sqrt(1 + dot(slope, slope))
    return dot(middle + slope, offset) / roots


def sent(
    tracer: Tracer, microlens: int, start_mm: Float64[np.ndarray, "2"], direction: Float64[np.ndarray, "n 3"]
) -> PathRays:
    """Rays that leave the camera through a microlens or NO_MICROLENS, on its front surface, with their paths."""
    count = len(direction)
    point = np.array([*start_mm, tracer.sensor_z_mm])
    rays = PathRays(np.tile(point, (count, 1)), direction, np.ones(count, bool), np.zeros(count))
    with np.errstate(all="ignore"):  # rays that miss a surface go on as NaN
        if microlens != NO_MICROLENS:
            plain = tracer.arrays.elements.model == PLAIN
            rays = _through_plain(tracer, microlens, rays) if plain else _through(tracer, microlens, rays)
        behind = tracer.camera.prescription.surfaces[-1].index
        film = tracer.camera.film.vision_from_film
        if film is not None:
            rays = rays._replace(position_mm=apply(film, rays.position_mm), direction=rays.direction @ film[:3, :3].T)
        return with_path(towards_scene(tracer.camera.prescription), rays._replace(medium=behind))


def _through_plain(tracer: Tracer, microlens: int, rays: PathRays) -> PathRays:
    """Trace rays through a thin microlens that is parallel to the sensor."""
    x, y, focal = tracer.arrays.microlenses[microlens, [column.X, column.Y, column.FOCAL]]
    path_mm = (tracer.film_z_mm - rays.position_mm[:, 2]) / rays.direction[:, 2]
    position = rays.position_mm + path_mm[:, None] * rays.direction
    offset = position[:, :2] - [x, y]
    disc = tracer.arrays.elements.disc_mm
    inside = np.hypot(*offset.T) <= disc if disc > 0 else _in_polygon(tracer.arrays.aperture, offset)
    return _bent_thinly(focal, offset, rays._replace(position_mm=position, path_mm=path_mm, passes=inside))


def _through(tracer: Tracer, microlens: int, rays: PathRays) -> PathRays:
    """Trace rays through a microlens of any other model."""
    elements = tracer.arrays.elements
    row = tracer.arrays.microlenses[microlens]
    kind = int(row[column.KIND])
    turn = elements.turn
    vertex = row[[column.X, column.Y, column.Z]]
    local = rays._replace(position_mm=(rays.position_mm - vertex) @ turn.T, direction=rays.direction @ turn.T)
    local = with_path(elements.faces[kind], local)
    if elements.model == THIN:
        local = _bent_thinly(row[column.FOCAL], local.position_mm[:, :2], local)
    elif elements.model == TWO_PLANE:
        bends = elements.bends[kind]
        local = _bent_by_normals(bends[column.CURVATURE_OF_NORMALS], bends[column.INDEX], local)
    return local._replace(position_mm=local.position_mm @ turn + vertex, direction=local.direction @ turn)


def _bent_thinly(focal_mm: float, offset: np.ndarray, rays: PathRays) -> PathRays:
    """Rays deflected by a thin microlens at these offsets from its vertex, (n, 2) [mm]."""
    slope = rays.slope - offset / focal_mm
    direction = np.column_stack([slope, np.ones(len(slope))])
    path = rays.path_mm + ideal_path(offset, rays.slope, slope)
    return rays._replace(direction=direction / np.linalg.norm(direction, axis=1, keepdims=True), path_mm=path)


def _bent_by_normals(curvature: float, mu: float, rays: PathRays) -> PathRays:
    """Snell's law at a plane with the normals of a sphere, for rays that leave a medium of index mu."""
    # The tangents of the waves change by -curvature * offset * step; the path is the integral of that from the vertex,
    # with the step, which hardly varies, as a plane and a paraboloid of the offset.
    offset = rays.position_mm[:, :2]
    squared = np.sum(offset**2, axis=1)
    normal = np.column_stack([-curvature * offset, np.sqrt(1 - curvature**2 * squared)])
    cosine = np.sum(normal * rays.direction, axis=1)
    step = np.sqrt(1 - mu * mu * (1 - cosine * cosine)) - mu * cosine
    terms = np.column_stack([np.ones(len(step)), offset, squared])
    finite = np.isfinite(step)
    fitted = np.linalg.lstsq(terms[finite], step[finite], rcond=None)[0]
    mean_step = terms @ (fitted * [1 / 2, 1 / 3, 1 / 3, 1 / 4])
    return rays._replace(
        direction=mu * rays.direction + step[:, None] * normal,
        passes=rays.passes & finite,
        path_mm=rays.path_mm - curvature * squared * mean_step,
        medium=1.0,
    )


def _in_polygon(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Whether points lie in a convex polygon, counter-clockwise."""
    edge = np.roll(corners, -1, axis=0) - corners
    normal = np.stack([edge[:, 1], -edge[:, 0]], axis=1)
    return (points @ normal.T <= np.sum(normal * corners, axis=1)).all(axis=1)


@dataclass(frozen=True, slots=True)
class View:
    """An image position and its object."""

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
    share: Float64[np.ndarray, "n n"]  # lit share of each cell

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
        # Subtract the plane of piston and tilt by weighted least squares.
        a, b = np.meshgrid(*self.cosines)
        lit = self.share > 0
        root_weight = np.sqrt(self.share[lit])
        path = self.path_mm[lit]
        terms = np.stack([np.ones(len(path)), a[lit] - self.centre[0], b[lit] - self.centre[1]], axis=1)
        plane = np.linalg.lstsq(terms * root_weight[:, None], path * root_weight, rcond=None)[0]
        error = (path - terms @ plane) / self.wavelength_mm
        rms = np.sqrt((root_weight**2 @ error**2) / (root_weight @ root_weight))
        return float(rms), float(np.ptp(error))

    @cached_property
    def crossings_mm(self) -> np.ndarray:
        """Hits of rays on the sensor, from the image position, (n, n, 2): the gradient of the path."""
        dy, dx = np.gradient(self.path_mm, self.step)
        return np.stack([dx, dy], axis=-1)

    def perfect(self) -> "Wavefront":
        """The pupil without aberrations."""
        return Wavefront(self.wavelength_mm, self.centre, self.step, np.zeros_like(self.path_mm), self.share)


def wavefront(tracer: Tracer, view: View, wavelength_nm: float) -> Wavefront:
    """Trace the wavefront of the light of a view; the camera of the tracer has the indices of that light.

    The object point is the geometric one of the position: the mean of the intersections of its rays with the plane of
    the object (of their directions, if that is infinitely far).

    Raises CameraError: no light arrives, or the blur is so wide that diffraction does not matter.
    """
    lens = first_order(tracer.camera.prescription)
    centre, width = _pupil(tracer, view)
    # Vision z of the image of the limiting aperture: the entrance pupil, or that of the microlenses.
    is_bare = view.microlens == NO_MICROLENS
    aperture_mm = lens.entrance_pupil.z_mm if is_bare else lens.object_mm(tracer.film_z_mm)
    for size in _SIZES:
        # Trace the cells of the pupil, and find the lit share of each.
        step = width / (size - 2)
        rays = _sent(tracer, view, *np.meshgrid(*_axes(centre, step, size)))
        finite = np.isfinite(rays.path_mm).reshape(size, size)
        if np.nanmax(rays.direction[rays.passes, 2], initial=0.0) < math.cos(WIDE_RAD):
            message = "its light comes from so far beside the lens that no plane in focus meets it"
            raise CameraError(
                message, hint="choose an image position nearer to the axis; images and truth have its blur"
            )
        share = np.where(finite, _shares(tracer, view, (centre, step, size), _PARTS), 0.0)
        # Complete the paths to the object, and accept them if the cells resolve the image.
        path = _to_object(rays, share.ravel(), view.object_mm, aperture_mm).reshape(size, size)
        path -= np.sum(np.where(finite, path, 0.0) * share) / share.sum()
        front = Wavefront(wavelength_nm * 1e-6, centre, step, np.where(finite, path, 0.0), share)
        lit = front.share > 0
        spot_mm = np.hypot(*front.crossings_mm[lit].T).max()
        if spot_mm < _FILLED * front.wavelength_mm / front.step:
            return front
    airy_mm = 0.61 * front.wavelength_mm / front.numerical_aperture
    blur = f"the blur of geometry is {spot_mm / airy_mm:.0f} times as wide as the Airy disc"
    raise CameraError(f"{blur}: no wavefront is needed there", hint="choose an object nearer to the focus")


def aperture(tracer: Tracer, view: View, wavelength_nm: float, size: int) -> Wavefront | None:
    """The pupil of a view in `size` cells along an axis, without aberrations; None where no light arrives."""
    try:
        centre, width = _pupil(tracer, view, size + 1, 1)
    except CameraError:
        return None
    step = width / (size - 2)
    share = _shares(tracer, view, (centre, step, size), 4)
    return Wavefront(wavelength_nm * 1e-6, centre, step, np.zeros((size, size)), share)


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
    """Middle and width of the square of direction cosines that contains all light of the view."""
    low, high = _outline(tracer, view)
    for _ in range(rounds):
        columns, rows = (np.linspace(low[i], high[i], count) for i in range(2))
        a, b = np.meshgrid(columns, rows)
        passes = _sent(tracer, view, a, b).passes.reshape(a.shape)
        if not passes.any():
            raise CameraError("no light arrives at that image position", hint="choose one inside of the image circle")
        # Narrow the square to the lit directions, and one cell around them.
        cell = (high - low) / (count - 1)
        lit = np.stack([a[passes], b[passes]])
        low = lit.min(axis=1) - cell
        high = lit.max(axis=1) + cell
    return (low + high) / 2, float((high - low).max())


def _outline(tracer: Tracer, view: View) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest direction cosines within the bounds of the camera, (2,) each."""
    optics = tracer.arrays.optics
    if view.microlens == NO_MICROLENS:
        corners = outlines_around(tracer.arrays, view.position_mm[None])[0]
    else:
        corners = tracer.arrays.microlenses[view.microlens, :2] + 1.05 * tracer.arrays.aperture
    height = optics.sampling_z_mm - optics.sensor_z_mm
    to_corners = np.column_stack([corners - view.position_mm, np.full(len(corners), height)])
    cosines = (to_corners / np.linalg.norm(to_corners, axis=1, keepdims=True))[:, :2]
    slack = 0.02 * np.ptp(cosines, axis=0).max()
    return cosines.min(axis=0) - slack, cosines.max(axis=0) + slack


def _shares(tracer: Tracer, view: View, grid: tuple[np.ndarray, float, int], parts: int) -> np.ndarray:
    """Lit share of each cell; cells at the boundary are sampled in parts."""
    # Trace the corners of all cells: a cell is lit, dark, or at the boundary.
    centre, step, size = grid
    corners = _axes(centre, step, size + 1)
    lit = _sent(tracer, view, *np.meshgrid(*corners)).passes.reshape(size + 1, size + 1)
    cell_corners = np.stack([lit[1:, 1:], lit[1:, :-1], lit[:-1, 1:], lit[:-1, :-1]])
    row, column = np.nonzero(cell_corners.any(axis=0) & ~cell_corners.all(axis=0))
    share = cell_corners.all(axis=0).astype(float)
    # Trace the middles of the parts of cells at the boundary.
    columns, rows = _axes(centre, step, size)
    offset = ((np.arange(parts) + 0.5) / parts - 0.5) * step
    a = columns[column][:, None, None] + offset[None, None, :] + 0 * offset[None, :, None]
    b = rows[row][:, None, None] + offset[None, :, None] + 0 * offset[None, None, :]
    share[row, column] = _sent(tracer, view, a, b).passes.reshape(-1, parts**2).mean(axis=1)
    return share


def _to_object(rays: PathRays, weight: np.ndarray, object_mm: float, aperture_mm: float) -> np.ndarray:
    """Path from the sensor to a sphere around the object point through the image of the aperture, (n,)."""
    # Rays that miss the point by m leave it through another part of the aperture, whose image is at the distance R:
    # their path is longer by m^2 / (2 R).
    lit = weight > 0
    weight = weight[lit] / weight.sum()
    position, direction = rays.position_mm, rays.direction
    mean = weight @ direction[lit]
    if math.isinf(object_mm):
        # The sphere is a plane across the mean direction, from which paths are counted backwards.
        return rays.path_mm - rays.medium * ((position - weight @ position[lit]) @ (mean / np.linalg.norm(mean)))
    # The object point is the mean of the intersections with its plane.
    to_plane = (object_mm - position[:, 2]) / direction[:, 2]
    crossing = position + to_plane[:, None] * direction
    point = weight @ crossing[lit]
    # Extend each ray to the foot of the perpendicular from the point, and add the path for its miss.
    to_foot = np.sum((point - position) * direction, axis=1)
    missed_squared = np.sum((point - position - to_foot[:, None] * direction) ** 2, axis=1)
    radius = (object_mm - aperture_mm) / mean[2]
    return rays.path_mm + rays.medium * (to_foot + missed_squared / (2 * radius))
