"""Integrals over bundles of cameras next to one whose regions are held, for derivatives.

What passes a camera is found anew for each integral, with corners and inner points wherever a search ends: two cameras
that differ by 1e-4 of a radius then differ by that, and by the search. Here both share inner points and the directions
of nodes, and edges are found to rounding: the integral of a neighbour is a smooth function of what moved.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.camera.integrals import NODES, SQUARE_NODES, Bundles, square_nodes
from pipeline.camera.integrating.quadrature import INTEGRATED, SMOOTH, Regions, regions
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.moments import COLUMNS, mixed


@dataclass(frozen=True, slots=True)
class HeldBundles:
    """Bundles of positions of a camera whose regions are known.

    `of_light`: regions at the nodes of each position's square, by wavelength.
    """

    bundles: Bundles
    level: int
    of_light: tuple[Regions, ...]

    @classmethod
    def of(cls, tracer: Tracer, bundles: Bundles, level: int) -> "HeldBundles":
        """Find the regions of bundles for integrals of a level."""
        spread, _ = _spread(bundles, level)
        lit = (
            regions(light.tracer.arrays, light.tracer.positions_mm(*spread.x_px.T), spread.microlens, SMOOTH)
            for light in tracer.lights
        )
        return cls(bundles, level, tuple(lit))

    def moments(self, tracer: Tracer, bundles: Bundles) -> tuple[np.ndarray, int]:
        """Moments (n, COLUMNS) of the same bundles a little elsewhere, or of a camera next to theirs, and rays traced.

        NaN where what passes is not star-shaped.
        """
        spread, share = _spread(bundles, self.level)
        parts, rays = [], 0
        for light, held in zip(tracer.lights, self.of_light, strict=True):
            positions = light.tracer.positions_mm(*spread.x_px.T)
            there = held.next_to(light.tracer.arrays, positions, spread.microlens)
            moments, status, traced = there.moments(spread.planes, NODES[self.level], is_last=False)
            moments[status != INTEGRATED] = np.nan
            parts.append(mixed(moments.reshape(-1, len(share), COLUMNS), share) if len(share) > 1 else moments)
            rays += traced
        if len(parts) == 1:
            return parts[0], rays
        return mixed(np.stack(parts, axis=1), np.array([light.share for light in tracer.lights])), rays


def _spread(bundles: Bundles, level: int) -> tuple[Bundles, np.ndarray]:
    """Bundles of all nodes of the squares on which rays start, and the shares of the nodes of one."""
    if not bundles.square_px > 0:
        return bundles, np.ones(1)
    offset, share = square_nodes(SQUARE_NODES[level])
    x_px = (bundles.x_px[:, None] + bundles.square_px * offset).reshape(-1, 2)
    microlens, planes = (np.repeat(values, len(share), axis=0) for values in (bundles.microlens, bundles.planes))
    return Bundles(x_px, microlens, planes), share
