"""Hits of the rays of bundles on planes, ray by ray, on nodes that move smoothly with the sensor position.

Nodes are polar: about one inner point for all positions near each other, at shares of the way to the traced edge. So
the hit of a node, and its weight, are smooth functions of the position, which random rays' are not. Vision frame, mm.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pipeline.camera.integrating import edge_kernels
from pipeline.camera.integrating.quadrature import bounded, inner_points
from pipeline.camera.integrating.ways import PROBES, holds_all
from pipeline.camera.tracing.records import CameraArrays
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.records.shapes import Bool, Float64, Int64

_INSIDE = 1 - 1e-7
"""Place of the outermost rays over that of the edge [1]: they must pass, and the edge is known to 3e-8 of the way to
the bound."""


@dataclass(frozen=True, slots=True)
class Hits:
    """Rays of n positions at a directions and r shares of the radius."""

    on_plane: Float64[np.ndarray, "n a r 2"]  # coordinates on the plane of each position
    # Weight per area of the unit disc: the integral over a bundle is that of density times share d(share) d(angle)
    density_sr: Float64[np.ndarray, "n a r"]
    # Whether every ray passes, none beyond the edge, and rays all over the bound where the edge says: the bundle is
    # star-shaped about its inner point, and all of it
    whole: Bool[np.ndarray, "n"]


class Polar(NamedTuple):
    """Nodes about an inner point."""

    shares: np.ndarray  # (r,) float64, shares of the way from the inner point to the edge
    directions: int
    about: int = 0  # the position whose inner point serves all of them


def bundle_hits(
    arrays: CameraArrays,
    positions_mm: Float64[np.ndarray, "n 2"],
    microlens: int,
    plane: Float64[np.ndarray, "4 3"],
    nodes: Polar,
) -> Hits:
    """Trace the bundles of neighbouring positions (n, 2) behind one microlens, or behind none.

    `plane`: rows origin, first axis, second axis, normal.
    """
    shares, directions, about = nodes
    n, behind = len(positions_mm), np.full(len(positions_mm), microlens)
    home, ways = inner_points(arrays, positions_mm[[about]], behind[:1]), bounded(arrays, positions_mm, behind)
    if np.isnan(home.centres).any() or (ways.counts < 3).any():
        nothing = np.full((n, directions, len(shares)), np.nan)
        return Hits(np.stack([nothing, nothing], axis=-1), nothing, np.zeros(n, bool))
    # Without a microlens what passes moves along with the position, by the drift of the outlines.
    drift = arrays.optics.drift if microlens == NO_MICROLENS else 0.0
    ways.centres[:] = home.centres + drift * (ways.positions - home.positions)
    owner, angle = ways.spokes(directions)
    radius, _, limit, _ = ways.find(owner, angle)
    held, _ = holds_all(ways, owner, angle, radius, np.full(len(owner), 2 * np.pi / directions), PROBES * directions)
    along = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = ways.centres[owner, None] + (_INSIDE * radius[:, None] * shares)[..., None] * along[:, None]
    shape, hit = (n, directions, len(shares)), edge_kernels.empty_hits(n * directions * len(shares))
    planes = np.repeat(np.ascontiguousarray(plane)[None], n, axis=0)
    starts = ways.positions, behind, np.repeat(owner, len(shares)), points.reshape(-1, 2)
    edge_kernels.hits(arrays, planes, *starts, hit)
    edge_kernels.hits.count(len(hit.density), len(arrays.table))
    whole = held & hit.passes.reshape(shape).all(axis=(1, 2)) & ways.nothing_beyond(owner, along, radius, limit)
    density = hit.density.reshape(shape) * (radius**2).reshape(n, directions, 1)
    return Hits(hit.on_plane.reshape(*shape, 2), density, whole)


def single_hits(
    arrays: CameraArrays,
    positions_mm: Float64[np.ndarray, "n 2"],
    microlens: Int64[np.ndarray, "n"],
    aims_mm: Float64[np.ndarray, "n 2"],
    planes: Float64[np.ndarray, "n 4 3"],
) -> np.ndarray:
    """Hits of rays from positions towards aims of the sampling plane on a plane of each, (n, 2); NaN: none."""
    hit = edge_kernels.empty_hits(len(positions_mm))
    given = map(np.ascontiguousarray, (planes, positions_mm, microlens, np.arange(len(microlens)), aims_mm))
    edge_kernels.hits(arrays, *given, hit)
    edge_kernels.hits.count(len(positions_mm), len(arrays.table))
    return np.where(hit.passes[:, None], hit.on_plane, np.nan)
