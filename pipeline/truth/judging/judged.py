"""Rows of tables that are to be judged, and samples of them."""

from dataclasses import dataclass, replace

import numpy as np

from pipeline.records.shapes import Bool, Float64, Int64

ROWS = 64
"""Most rows that are solved again for each camera, so that the cost does not grow with the build."""
_FEWEST, _ONE_IN = 16, 8
"""Rows that a build solves again: at least so many, else one in so many. More would cost more than the build itself."""


@dataclass(frozen=True, slots=True)
class Rows:
    """Rows of a table that are to be judged.

    Attributes
    ----------
    planes : (n, 4, 3) float64
        Tangent planes at their target points.
    cell : (n,) int64
        Index of their microlens; 0 for a conventional camera.
    x_px : (n, 2) float64
    is_direct : (n,) bool
        Whether they were found by quadrature.
    stands_for : (n,) float64 or None
        Number of rows of the table that each one represents; None: one each.
    """

    planes: Float64[np.ndarray, "n 4 3"]
    cell: Int64[np.ndarray, "n"]
    x_px: Float64[np.ndarray, "n 2"]
    is_direct: Bool[np.ndarray, "n"]
    stands_for: Float64[np.ndarray, "n"] | None = None

    def only(self, kept: Int64[np.ndarray, "n"]) -> "Rows":
        """The rows selected by a mask or by indices."""
        return Rows(self.planes[kept], self.cell[kept], self.x_px[kept], self.is_direct[kept], self.weights[kept])

    @property
    def weights(self) -> np.ndarray:
        """Number of rows of the table that each one represents, (n,)."""
        return np.ones(len(self.cell)) if self.stands_for is None else self.stands_for

    def drawn(self, seed: int, rows: int = ROWS) -> "Rows":
        """A sample of these rows with so many rows, which represents all of them."""
        chosen = sample(self.is_direct, seed, rows)
        of, drawn = np.bincount(self.is_direct, minlength=2), np.bincount(self.is_direct[chosen], minlength=2)
        kind = self.is_direct[chosen].astype(int)
        return replace(self.only(chosen), stands_for=of[kind] / drawn[kind])


def rows_of_build(of: int) -> int:
    """Number of rows that the certificate of a build solves again if the tables have `of` rows."""
    return min(ROWS, max(_FEWEST, of // _ONE_IN))


def sample(is_direct: Bool[np.ndarray, "n"], seed: int, rows: int = ROWS) -> np.ndarray:
    """Indices of up to so many rows, drawn without repetition, ascending; half of either kind if possible."""
    order = np.random.default_rng(seed).permutation(len(is_direct))
    others, direct = order[~is_direct[order]], order[is_direct[order]]
    others = others[: max(rows // 2, rows - len(direct))]
    return np.sort(np.concatenate([others, direct[: rows - len(others)]]))
