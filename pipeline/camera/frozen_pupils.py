"""Bundle integrals at neighbouring positions with the pupil geometry frozen, so that finite differences are free of
search noise.

The search for the boundary of a bundle has a finite resolution, and a difference of two searches 1e-4 of a radius apart
would contain it. Here both bundles share interior points and the directions of nodes and corners, and their rays go
through equal fractions of the radii to their own boundaries, so that the motion of the boundary still counts.
"""

from collections.abc import Callable

import numpy as np

from pipeline.camera.integrals import NODES, Bundles, Integral
from pipeline.camera.integrating.quadrature import INTEGRATED, Effort, regions
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.moments import COLUMNS, mixed
from pipeline.records.shapes import Float64

HALF_PX = 1e-5
"""Half the step of differences by image position [px]. J rounds to 1e-8 of it. Behind microlenses corners turn by 150
degrees per px, and a node that a corner passes errs: at 1e-3 px by up to 4 % of the difference."""


class FrozenPupils:
    """Bundles with frozen interior points and directions, at one level of quadrature.

    `rays`: number of rays traced.
    """

    def __init__(self, tracer: Tracer, bundles: Bundles, level: int, effort: Effort) -> None:
        self._level = level
        self._base = tracer, bundles
        nodes, _ = bundles.at_nodes(level)
        self._regions = [
            regions(light.tracer.arrays, light.tracer.positions_mm(*nodes.x_px.T), nodes.microlens, effort)
            for light in tracer.lights
        ]
        self.rays = sum(part.rays for part in self._regions)

    def next_to(self, tracer: Tracer, bundles: Bundles) -> Integral:
        """Integrals over the bundles of a neighbouring camera or of neighbouring positions.

        Moments are NaN for an empty bundle, or one that is not star-shaped.
        """
        nodes, share = bundles.at_nodes(self._level)
        parts = []
        rays = 0
        n = len(bundles.x_px)
        base_tracer, base = self._base
        is_base = tracer is base_tracer and bundles.x_px is base.x_px and bundles.microlens is base.microlens
        for light, frozen in zip(tracer.lights, self._regions, strict=True):
            neighbour = frozen
            if not is_base:  # else all but the planes is the same, and boundaries are known
                positions_mm = light.tracer.positions_mm(*nodes.x_px.T)
                neighbour = frozen.next_to(light.tracer.arrays, positions_mm, nodes.microlens)
            moments, status, traced_rays = neighbour.moments(nodes.planes, NODES[self._level], is_last=False)
            moments[status != INTEGRATED] = np.nan
            parts.append(mixed(moments.reshape(n, len(share), COLUMNS), share) if len(share) > 1 else moments)
            rays += traced_rays
        self.rays += rays
        lights = np.array([light.share for light in tracer.lights])
        total = mixed(np.stack(parts, axis=1), lights) if len(parts) > 1 else parts[0]
        return Integral(total, np.full((n, 2), np.nan), np.zeros(n, bool), rays)


def by_x(
    values_at: Callable[[np.ndarray], np.ndarray], x_px: Float64[np.ndarray, "... 2"], half_px: float = HALF_PX
) -> np.ndarray:
    """Derivatives by image position of values such as moments, (..., 2), by central differences."""
    ends = [[values_at(x_px + sign * step) for sign in (1, -1)] for step in half_px * np.eye(2)]
    return np.stack([(upper - lower) / (2 * half_px) for upper, lower in ends], axis=-1)
