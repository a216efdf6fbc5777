"""Hits of chosen rays: through polar nodes of the bundles of neighbouring positions, and one for each position.

Rays through polar nodes about one interior point for all neighbouring positions, at fixed fractions of the radius of
the boundary, have hits that are smooth functions of the position, unlike those of random rays.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pipeline.camera import boundary
from pipeline.camera.integrating import edge_kernels
from pipeline.camera.integrating.quadrature import bounded, inner_points, with_corners
from pipeline.camera.integrating.radials import PROBES, agrees_with_probes
from pipeline.camera.tracing.records import CameraArrays
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.records.shapes import Bool, Float64, Int64

_INSIDE = 1 - 1e-7
"""Radius of the outermost rays over that of the boundary [1]: they must pass, and it is known to 3e-8."""


@dataclass(frozen=True, slots=True)
class Hits:
    """Hits of rays of n positions, in a directions and at r fractions of the radius."""

    on_plane: Float64[np.ndarray, "n a r 2"]  # coordinates on the plane of each position
    # Weight per area of the unit disc: the integral over a bundle is that of density times s ds dphi, s the fraction
    density_sr: Float64[np.ndarray, "n a r"]
    angle_to_next_rad: Float64[np.ndarray, "a"]  # from each direction to the next
    # Whether every ray passes, none does beyond the boundary, and probes over the polygon agree with it: the region is
    # star-shaped about its interior point, and complete
    is_star_shaped: Bool[np.ndarray, "n"]


class Polar(NamedTuple):
    """Nodes in polar coordinates about an interior point."""

    radial_fractions: np.ndarray  # (r,) float64, fractions of the radius of the boundary
    least_directions: int  # a multiple of 16; as many, evenly spaced, without corners
    has_corners: bool = False  # with directions at corners, from `boundary.between`: at least as many


def bundle_hits(
    arrays: CameraArrays,
    positions_mm: Float64[np.ndarray, "n 2"],
    microlens: int,
    plane: Float64[np.ndarray, "4 3"],
    nodes: Polar,
) -> Hits:
    """Trace the bundles of neighbouring positions (n, 2) behind one microlens, or behind none, to a plane.

    The nodes of a position lie in its region: the part of the sampling plane through which its rays pass.
    `plane`: origin, both axes and normal, by rows; vision frame [mm].

    If any position is dark, all hits are NaN and no region counts as star-shaped: no field over the positions is then
    smooth.
    """
    radial_fractions, least_directions, has_corners = nodes
    n = len(positions_mm)
    microlens_of_position = np.full(n, microlens)
    # Bound all regions. The interior point of the middle position serves all: hits are smooth functions of the position
    # only if the nodes of all lie about one point, in the same directions.
    region_of_middle = inner_points(arrays, positions_mm[[n // 2]], microlens_of_position[:1])
    bundles = bounded(arrays, positions_mm, microlens_of_position)
    if np.isnan(region_of_middle.centres).any() or (bundles.counts < 3).any():  # a polygon has three vertices at least
        return _no_hits(n, least_directions, len(radial_fractions))
    # Without a microlens the region moves along with the position, by the drift of the outlines.
    drift = arrays.optics.drift if microlens == NO_MICROLENS else 0.0
    bundles.centres[:] = region_of_middle.centres + drift * (bundles.positions - region_of_middle.positions)
    # Choose the directions of all positions. Without a corner, one arc runs from the angle 0 all around.
    corners = with_corners(region_of_middle).corners.angle if has_corners else np.zeros(0)
    arc_starts = corners if len(corners) else np.array([0.0])
    angle_of_direction, angle_to_next = boundary.between(arc_starts, least_directions)
    directions = len(angle_of_direction)
    position_of_ray = np.repeat(np.arange(n), directions)
    angle = np.tile(angle_of_direction, n)
    # Find the boundary along each, and compare it with probes. By the trapezoidal rule a direction weighs half of the
    # angles to both of its neighbours.
    angular_weight = np.tile((angle_to_next + np.roll(angle_to_next, 1)) / 2, n)
    radius, _, polygon_radius, _ = bundles.edge_points(position_of_ray, angle)
    probes = PROBES * directions  # for each position
    agrees_with_boundary, _ = agrees_with_probes(bundles, position_of_ray, angle, radius, angular_weight, probes)
    # Trace the rays through all nodes to the plane.
    along = boundary.unit_vectors(angle)
    node_radius = _INSIDE * radius[:, None] * radial_fractions
    points = bundles.centres[position_of_ray, None] + node_radius[..., None] * along[:, None]
    shape = n, directions, len(radial_fractions)
    hit = edge_kernels.empty_hits(n * directions * len(radial_fractions))
    planes = np.repeat(np.ascontiguousarray(plane)[None], n, axis=0)
    position_of_node = np.repeat(position_of_ray, len(radial_fractions))
    rays = bundles.positions, microlens_of_position, position_of_node, points.reshape(-1, 2)
    edge_kernels.hits(arrays, planes, *rays, hit)
    edge_kernels.hits.count(len(hit.density), len(arrays.table))  # of the work that is told
    # Accept regions that are star-shaped; scale densities to the unit disc.
    all_pass = hit.passes.reshape(shape).all(axis=(1, 2))
    nothing_beyond = bundles.nothing_beyond(position_of_ray, along, radius, polygon_radius)
    density = hit.density.reshape(shape) * (radius**2).reshape(n, directions, 1)
    return Hits(
        on_plane=hit.on_plane.reshape(*shape, 2),
        density_sr=density,
        angle_to_next_rad=angle_to_next,
        is_star_shaped=agrees_with_boundary & all_pass & nothing_beyond,
    )


def _no_hits(positions: int, directions: int, radii: int) -> Hits:
    """Hits of positions of which one is dark."""
    nothing = np.full((positions, directions, radii), np.nan)
    return Hits(
        on_plane=np.stack([nothing, nothing], axis=-1),
        density_sr=nothing,
        angle_to_next_rad=nothing[0, :, 0],
        is_star_shaped=np.zeros(positions, bool),
    )


def single_hits(
    arrays: CameraArrays,
    positions_mm: Float64[np.ndarray, "n 2"],
    microlens: Int64[np.ndarray, "n"],
    aims_mm: Float64[np.ndarray, "n 2"],
    planes: Float64[np.ndarray, "n 4 3"],
) -> np.ndarray:
    """Intersections of rays through points of the sampling plane with a plane for each, (n, 2); NaN: none.

    `planes`: origin, both axes and normal of each, by rows; vision frame [mm], as `positions_mm` and `aims_mm`.
    Intersections are coordinates along the axes of the plane [mm].
    """
    hit = edge_kernels.empty_hits(len(positions_mm))
    rays = map(np.ascontiguousarray, (planes, positions_mm, microlens, np.arange(len(microlens)), aims_mm))
    edge_kernels.hits(arrays, *rays, hit)
    edge_kernels.hits.count(len(positions_mm), len(arrays.table))
    return np.where(hit.passes[:, None], hit.on_plane, np.nan)
