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
    angle: Float64[np.ndarray, "a"]  # from each direction to the next [rad]
    # Whether every ray passes, none does beyond the boundary, and probes over the polygon agree with it: the region is
    # star-shaped about its interior point, and complete
    is_star_shaped: Bool[np.ndarray, "n"]


class Polar(NamedTuple):
    """Nodes in polar coordinates about an interior point."""

    shares: np.ndarray  # (r,) float64, fractions of the radius of the boundary
    directions: int  # evenly spaced: a multiple of 16
    has_corners: bool = False  # with directions at corners, from `boundary.between`: at least as many


def bundle_hits(
    arrays: CameraArrays,
    positions_mm: Float64[np.ndarray, "n 2"],
    microlens: int,
    plane: Float64[np.ndarray, "4 3"],
    nodes: Polar,
) -> Hits:
    """Trace the bundles of neighbouring positions (n, 2) behind one microlens, or behind none, to a plane."""
    shares, directions, has_corners = nodes
    n = len(positions_mm)
    microlenses = np.full(n, microlens)
    # Bound all regions; the interior point of the middle position serves all.
    middle = inner_points(arrays, positions_mm[[n // 2]], microlenses[:1])
    bundles = bounded(arrays, positions_mm, microlenses)
    if np.isnan(middle.centres).any() or (bundles.counts < 3).any():
        no_hits = np.full((n, directions, len(shares)), np.nan)
        return Hits(np.stack([no_hits, no_hits], axis=-1), no_hits, no_hits[0, :, 0], np.zeros(n, bool))
    # Without a microlens the region moves along with the position, by the drift of the outlines.
    drift = arrays.optics.drift if microlens == NO_MICROLENS else 0.0
    bundles.centres[:] = middle.centres + drift * (bundles.positions - middle.positions)
    # Choose the directions of all positions, and find the boundary along each.
    corners = with_corners(middle).corners.angle if has_corners else np.zeros(0)
    angle, width = boundary.between(corners if len(corners) else np.zeros(1), directions)
    directions = len(angle)
    owner = np.repeat(np.arange(n), directions)
    angle = np.tile(angle, n)
    share = np.tile((width + np.roll(width, 1)) / 2, n)
    radius, _, limit, _ = bundles.edge_points(owner, angle)
    agrees, _ = agrees_with_probes(bundles, owner, angle, radius, share, PROBES * directions)
    # Trace the rays through all nodes to the plane.
    along = boundary.unit_vectors(angle)
    points = bundles.centres[owner, None] + (_INSIDE * radius[:, None] * shares)[..., None] * along[:, None]
    shape = n, directions, len(shares)
    hit = edge_kernels.empty_hits(n * directions * len(shares))
    planes = np.repeat(np.ascontiguousarray(plane)[None], n, axis=0)
    rays = bundles.positions, microlenses, np.repeat(owner, len(shares)), points.reshape(-1, 2)
    edge_kernels.hits(arrays, planes, *rays, hit)
    edge_kernels.hits.count(len(hit.density), len(arrays.table))
    # Accept regions that are star-shaped; scale densities to the unit disc.
    all_pass = hit.passes.reshape(shape).all(axis=(1, 2))
    star_shaped = agrees & all_pass & bundles.nothing_beyond(owner, along, radius, limit)
    density = hit.density.reshape(shape) * (radius**2).reshape(n, directions, 1)
    return Hits(hit.on_plane.reshape(*shape, 2), density, width, star_shaped)


def single_hits(
    arrays: CameraArrays,
    positions_mm: Float64[np.ndarray, "n 2"],
    microlens: Int64[np.ndarray, "n"],
    aims_mm: Float64[np.ndarray, "n 2"],
    planes: Float64[np.ndarray, "n 4 3"],
) -> np.ndarray:
    """Intersections of rays through points of the sampling plane with a plane for each, (n, 2); NaN: none."""
    hit = edge_kernels.empty_hits(len(positions_mm))
    rays = map(np.ascontiguousarray, (planes, positions_mm, microlens, np.arange(len(microlens)), aims_mm))
    edge_kernels.hits(arrays, *rays, hit)
    edge_kernels.hits.count(len(positions_mm), len(arrays.table))
    return np.where(hit.passes[:, None], hit.on_plane, np.nan)
