"""Integrals over bundles that obstructions take a part of.

A ring has no point from which all of it is seen. But it is what would pass without the obstruction, less what would
meet it, and both are star-shaped: so each is integrated by itself, about a point of its own.
"""

from typing import NamedTuple

import numpy as np

from pipeline.camera.integrating.mixture import mixed
from pipeline.camera.integrating.quadrature import EMPTY, FINE, NOT_STAR_SHAPED, Edges, Effort, edges
from pipeline.camera.tracing.moments import FREE_WEIGHT, WEIGHT
from pipeline.camera.tracing.records import CameraArrays
from pipeline.camera.tracing.sampling_bounds import SKIP
from pipeline.optics.table import without_obstructions
from pipeline.records.shapes import Float64, Int64

_LEAST = 1e-6
"""Share of the light that obstructions leave below which a bundle is empty [1]: edges are known to 3e-8."""


class Regions(NamedTuple):
    """Regions with signs: what passes without obstructions, first, and what would meet them."""

    parts: list[tuple[float, Edges]]

    @property
    def rays(self) -> int:
        """Traced so far."""
        return sum(part.rays for _, part in self.parts)

    def moments(
        self, planes: Float64[np.ndarray, "n 2 4 3"], nodes: tuple[int, int], is_last: bool = True
    ) -> tuple[np.ndarray, np.ndarray, int]:
        """Moments of all bundles, as of `Edges.moments`."""
        each = [part.moments(planes, nodes, is_last) for _, part in self.parts]
        if len(each) == 1:
            return each[0]
        moments, outcomes = np.stack([one[0] for one in each], axis=1), np.stack([one[1] for one in each], axis=1)
        result, outcome = mixed(moments, np.array([sign for sign, _ in self.parts])), outcomes[:, 0].copy()
        result[:, FREE_WEIGHT] = moments[:, 0, FREE_WEIGHT]
        outcome[~(result[:, WEIGHT] > _LEAST * moments[:, 0, WEIGHT])] = EMPTY
        outcome[(outcomes == NOT_STAR_SHAPED).any(axis=1)] = NOT_STAR_SHAPED
        result[outcome == EMPTY, :WEIGHT], result[outcome == EMPTY, WEIGHT] = np.nan, 0.0
        return result, outcome, sum(rays for *_, rays in each)


def regions(
    arrays: CameraArrays,
    positions_mm: Float64[np.ndarray, "n 2"],
    microlens: Int64[np.ndarray, "n"],
    effort: Effort = FINE,
) -> Regions:
    """Find the regions of sensor positions (n, 2) behind their microlenses (n,)."""
    (sign, table), *others = without_obstructions(arrays.table)
    whole = edges(arrays._replace(table=table), positions_mm, microlens, effort)
    lit = np.where(np.isnan(whole.centres[:, 0]), SKIP, microlens)
    taken = [(s, edges(arrays._replace(table=part), positions_mm, lit, effort, whole)) for s, part in others]
    return Regions([(sign, whole), *taken])
