"""Centroids and outlines of micro-images: the light of every microlens, each from its own traced rays.

The light of a microlens is a double integral, over its aperture and over the sensor. Through one point of the aperture,
a pinhole, light fills the image of the exit pupil; from point to point of the aperture that image only moves and bends
a little. So a few points of the aperture suffice, whereas a few sensor positions would not: there light ends in a
penumbra.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.camera.boundary import unit_nodes, unit_vectors
from pipeline.camera.micro_images.centres import MicroImages
from pipeline.camera.micro_images.contours import RIM, Contours
from pipeline.camera.micro_images.pupil_images import BY_X, BY_Y, FILLED, LIGHT, SUMS, Apertures, Pencils
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.parts.lattice import cell
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.camera.parts.polygon import regular, rim_of
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing import microlens_kernels as column
from pipeline.camera.tracing.microlens_tables import on_apertures
from pipeline.camera.tracing.sampling_bounds import outlines_around
from pipeline.optics.table import without_obstructions
from pipeline.records.shapes import Float64, Int64

OUTLINE_DEG = tuple(range(0, 360, 15))
"""Directions of outlines [deg], from +x towards +y of the image."""
_NEIGHBOUR = 1e-3
"""Distance of the neighbours of an aperture point over the ring radius [1]: differences err by about a millionth."""
_INSIDE = 1 - 1e-9
"""Radius of the outermost rim points over that of the rim [1]: rounding must not put them outside."""
_SEARCH = 1.1
"""Radius of the search for a pupil's image over that of the sampling bounds [1]: a first guess, widened if lit."""
_STEP = 0.3
"""Search step over the smaller of the pupil image's least radius and the penumbra: a lit rim stays lit that far."""
_RING, _RINGS = 0.01, 12
"""Spacing of rings of rim points over the radius of the aperture [1], and their number: where two curved faces both
end, light may be cut up to 11 percent inside of the rim."""
_AT_ONCE = 512
"""Microlenses that are traced together: bounds memory, and no result depends on it."""


@dataclass(frozen=True, slots=True)
class MicroLight:
    """Light of microlenses that reaches the image, through the aperture of each alone, in whatever cell it falls."""

    rows: Int64[np.ndarray, "n"]  # rows of the microlenses in the lattice, ascending
    # Centroid of all irradiance on the sensor, also beyond the image; vision frame, NaN for a dark one
    centroid_mm: Float64[np.ndarray, "n 2"]
    pupil_area_mm2: Float64[np.ndarray, "n"]  # area of the pupil that light through the vertex fills
    # Radius of the light through the vertex, and of all light, from the centroid along `OUTLINE_DEG`; NaN where no
    # light through the vertex falls onto the centroid, or nothing is lit
    pupil_mm: Float64[np.ndarray, "n directions"]
    light_mm: Float64[np.ndarray, "n directions"]


def micro_light(
    tracer: Tracer, images: MicroImages, tile: int = 0, tiles: int = 1, rows: Int64[np.ndarray, "n"] | None = None
) -> MicroLight:
    """Trace the light of microlenses that reaches the image.

    `tile`, `tiles`: number of an equal share of them, and number of shares. `rows`: these rows of the lattice alone.
    """
    if tracer.camera.microlenses is None:
        raise CameraError("a conventional camera has no micro-images")
    if rows is None:
        rows = np.array_split(reaching(tracer, images), tiles)[tile]
    shift, limit = _motion(tracer, images, rows)
    lit = limit > 0
    rows, shift, limit = rows[lit], shift[lit], limit[lit]
    batches = [slice(i, i + _AT_ONCE) for i in range(0, len(rows), _AT_ONCE)]
    parts = [_traced_batch(tracer, images, rows[batch], shift[batch], limit[batch]) for batch in batches]
    if not parts:
        return MicroLight(rows, np.zeros((0, 2)), np.zeros(0), *np.zeros((2, 0, len(OUTLINE_DEG))))
    return MicroLight(rows, *(np.concatenate(values) for values in zip(*parts, strict=True)))


def _traced_batch(
    tracer: Tracer, images: MicroImages, rows: np.ndarray, shift: np.ndarray, limit: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Centroids, areas and both outlines of a batch of microlenses; `shift` and `limit` are those of `_motion`."""
    array, grid = tracer.camera.microlenses, tracer.lattice
    assert array is not None and grid is not None
    kind = grid.type[rows]
    camera = tracer.arrays
    # Integrate the light through quadrature nodes of the aperture, without obstructions less what these block.
    points, shares = _aperture_nodes(array)
    middle = np.ascontiguousarray(images.centre_mm[rows])
    sums = np.zeros((len(rows), SUMS))
    parts = without_obstructions(camera.table)
    for sign, part in parts:
        apertures = Apertures(camera._replace(table=part), Pencils(rows, kind, points), shares)
        sums += sign * apertures.light(middle, shift, limit)
    lit = sums[:, LIGHT] > 0
    centroid = np.full_like(middle, np.nan)
    area = np.where(lit, sums[:, FILLED], np.nan)
    centroid[lit] = middle[lit] + sums[lit, BY_X : BY_Y + 1] / sums[lit, LIGHT, None]
    # Find the outline of the light through the vertex; the image is the sensor frame, turned by 180 degrees about z.
    along = -unit_vectors(np.deg2rad(OUTLINE_DEG))
    unobstructed = camera._replace(table=parts[0][1])
    outer = Apertures(unobstructed, Pencils(rows, kind, points), shares)
    pupil = outer.reach(np.nan_to_num(centroid), along, limit)
    least = np.nan_to_num(pupil.min(axis=1), nan=0.0)
    least = np.where(least > 0, least, limit)
    # Find the outline of all light by a search from outside inwards, through points of the rim.
    rim = _rims(array)
    beyond = 1.05 * np.abs(shift) * np.hypot(*rim.T).max() + 0.01 * least
    outside = np.where(np.isnan(pupil), limit[:, None], pupil) + beyond[:, None]
    rims = Pencils(rows, kind, on_apertures(array, rim))
    contours = Contours(unobstructed, rims, np.nan_to_num(centroid), along)
    light = contours.distances(outside, _STEP * np.minimum(least, beyond))
    pupil[~lit], light[~lit] = np.nan, np.nan
    return centroid, area, pupil, light


def reaching(tracer: Tracer, images: MicroImages) -> np.ndarray:
    """Rows of the microlenses whose light may fall onto the image."""
    sensor = tracer.camera.sensor
    centre = tracer.pixels_at(images.centre_mm)
    outside_px = centre - np.clip(centre, -0.5, np.array(sensor.size_px) - 0.5)
    return np.flatnonzero(np.hypot(*outside_px.T) * sensor.pitch_mm <= images.reach_mm)


def _motion(tracer: Tracer, images: MicroImages, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Motion of the pupil's image per motion of the aperture point, and its radius by the sampling bounds; 0: dark."""
    microlenses = tracer.arrays.microlenses[rows]
    polygons = outlines_around(tracer.arrays, microlenses[:, [column.OUTLINE_X, column.OUTLINE_Y]])
    by_start = microlenses[:, column.BY_START]
    by_aim = microlenses[:, column.BY_AIM]
    # Map the outline of the lens back to the sensor by the microlens's linear map, for rays through its vertex.
    from_vertex = (polygons - microlenses[:, None, [column.BASE_X, column.BASE_Y]]) / by_start[:, None, None]
    edge = microlenses[:, None, :2] + from_vertex - images.centre_mm[rows, None]
    farthest = np.hypot(edge[..., 0], edge[..., 1]).max(axis=1, initial=0.0)
    limit = _SEARCH * farthest + microlenses[:, column.MARGIN] / np.abs(by_start)
    limit[np.ptp(polygons, axis=1).max(axis=1) == 0] = 0.0
    return -by_aim / by_start, limit


def _aperture_nodes(array: MicrolensArray) -> tuple[np.ndarray, np.ndarray]:
    """Quadrature over an aperture: vertex and a ring, exact for cubics: (types, m, 5, 3) with neighbours, (m,)."""
    if array.disc_diameter_mm is not None:
        radius = array.disc_diameter_mm / 2
        ring = np.sqrt(2 / 3) * radius * regular(6, np.cos(np.pi / 6), 0.0)
        shares = np.full(6, 1 / 8)
    else:
        ring, shares = _ring(cell(array))
    points = np.concatenate([np.zeros((1, 2)), ring])
    step = _NEIGHBOUR * np.hypot(*ring.T).max()
    near = points[:, None] + step * np.array([(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)])
    on_face = on_apertures(array, near.reshape(-1, 2)).reshape(len(array.focal_lengths_mm), *near.shape[:2], 3)
    return np.ascontiguousarray(on_face), np.concatenate([[1 - shares.sum()], shares])


def _ring(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points towards the corners of a cell, with weights that reproduce its second moments."""
    # Their distance makes the mean of r^4 right as well; on a regular hexagon the rule is exact to the fifth degree.
    # Nodes and weights of a fine quadrature over the cell, triangle by triangle about its middle.
    node, weight = unit_nodes(4)
    u, v = (grid.ravel() for grid in np.meshgrid(node, node))
    first = corners
    second = np.roll(corners, -1, axis=0)
    area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    inner = u[:, None] * ((1 - v)[:, None] * first[:, None] + v[:, None] * second[:, None])
    share = (area[:, None] * u * np.outer(weight, weight).ravel()).ravel()
    x, y = inner.reshape(-1, 2).T
    share = share / share.sum()
    # Place the ring by the mean of r^4, and solve for weights with the second moments of the cell.
    squared = x**2 + y**2
    ring = corners * np.sqrt((share @ squared**2) / (share @ squared) / (corners**2).sum(axis=1).mean())
    cell_moments = np.array([share @ x**2, share @ (x * y), share @ y**2])
    ring_moments = np.stack([ring[:, 0] ** 2, ring[:, 0] * ring[:, 1], ring[:, 1] ** 2])
    return ring, np.linalg.lstsq(ring_moments, cell_moments, rcond=None)[0]


def _rims(array: MicrolensArray) -> np.ndarray:
    """RIM points around an aperture, corners of a cell among them, (RIM, 2), through which the outermost light may
    pass.

    If two curved faces both end, further rings follow inside of the rim.
    """
    if array.disc_diameter_mm is not None:
        rim = array.disc_diameter_mm / 2 * regular(RIM, np.cos(np.pi / RIM), 0.0)
    else:
        rim = rim_of(cell(array), RIM)
    has_two = any(all(faces.curved) for faces in array.faces)
    return np.concatenate([(_INSIDE - _RING * ring) * rim for ring in range(_RINGS if has_two else 1)])
