"""Integrals of bundles next to others, with what passes held: differences of them are those of light, not of searches.

A search of what passes ends somewhere, and two bundles that differ by 1e-4 of a radius would differ by that, and by the
search. Here both share inner points and the directions of nodes and corners, and their rays go through the same shares
of the ways to their own edges, so that the rim of what passes counts as it moves.
"""

from collections.abc import Callable

import numpy as np

from pipeline.camera.integrals import NODES, Bundles, Integral
from pipeline.camera.integrating.quadrature import INTEGRATED, Effort, regions
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.moments import COLUMNS, mixed
from pipeline.records.shapes import Float64

HALF_PX = 1e-5
"""Half the step of differences by image position [px]. J rounds to 1e-8 of it. Behind microlenses corners wander by 150
degrees per px, and a node that a corner passes errs: at 1e-3 px by up to 4 % of the difference."""


class Held:
    """Bundles of which is held what passes, at a level of quadrature.

    `rays`: number of rays traced so far.
    """

    def __init__(self, tracer: Tracer, bundles: Bundles, level: int, effort: Effort) -> None:
        self._level, nodes = level, bundles.at_nodes(level)[0]
        self._regions = [
            regions(light.tracer.arrays, light.tracer.positions_mm(*nodes.x_px.T), nodes.microlens, effort)
            for light in tracer.lights
        ]
        self.rays = sum(part.rays for part in self._regions)

    def next_to(self, tracer: Tracer, bundles: Bundles) -> Integral:
        """Integrals over the bundles of a camera next to those that are held; moments are NaN where what passes is in
        pieces, or nothing passes.
        """
        nodes, share = bundles.at_nodes(self._level)
        parts, rays, n = [], 0, len(bundles.x_px)
        for light, held in zip(tracer.lights, self._regions, strict=True):
            there = held.next_to(light.tracer.arrays, light.tracer.positions_mm(*nodes.x_px.T), nodes.microlens)
            moments, status, more = there.moments(nodes.planes, NODES[self._level], is_last=False)
            moments[status != INTEGRATED] = np.nan
            parts.append(mixed(moments.reshape(n, len(share), COLUMNS), share) if len(share) > 1 else moments)
            rays += more
        self.rays += rays
        lights = np.array([light.share for light in tracer.lights])
        whole = mixed(np.stack(parts, axis=1), lights) if len(parts) > 1 else parts[0]
        return Integral(whole, np.full((n, 2), np.nan), np.zeros(n, bool), rays)


def by_x(
    moments_at: Callable[[np.ndarray], np.ndarray], x_px: Float64[np.ndarray, "n 2"], half_px: float = HALF_PX
) -> np.ndarray:
    """Derivatives of moments by image position, (n, COLUMNS, 2): central differences over half a step to both sides."""
    ends = [[moments_at(x_px + sign * step) for sign in (1, -1)] for step in half_px * np.eye(2)]
    return np.stack([(more - less) / (2 * half_px) for more, less in ends], axis=-1)
