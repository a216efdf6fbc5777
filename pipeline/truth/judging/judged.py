"""Rows of tables that shall be judged, and samples of them."""

from dataclasses import dataclass, replace

import numpy as np

from pipeline.records.shapes import Bool, Float64, Int64

ROWS = 64
"""Rows at most that are solved again for each camera, so that a large build pays no more for them."""
_FEWEST, _ONE_IN = 16, 8
"""Rows that a build solves again: one in so many, but so many at least. More would cost more than the build itself."""


@dataclass(frozen=True, slots=True)
class Rows:
    """Rows of a table that shall be judged.

    Attributes
    ----------
    planes : (n, 4, 3) float64
        Tangent planes at their target points.
    cell : (n,) int64
        Row of their microlens; 0 for a conventional camera.
    x_px : (n, 2) float64
    is_direct : (n,) bool
        Whether they were found by quadrature.
    stands_for : (n,) float64 or None
        Rows of the table that each was drawn for; None: one each.
    """

    planes: Float64[np.ndarray, "n 4 3"]
    cell: Int64[np.ndarray, "n"]
    x_px: Float64[np.ndarray, "n 2"]
    is_direct: Bool[np.ndarray, "n"]
    stands_for: Float64[np.ndarray, "n"] | None = None

    def only(self, kept: Int64[np.ndarray, "n"]) -> "Rows":
        """The rows that `kept` says or numbers."""
        return Rows(self.planes[kept], self.cell[kept], self.x_px[kept], self.is_direct[kept], self.weights[kept])

    @property
    def weights(self) -> np.ndarray:
        """Rows of the table that each stands for, (n,)."""
        return np.ones(len(self.cell)) if self.stands_for is None else self.stands_for

    def drawn(self, seed: int, rows: int = ROWS) -> "Rows":
        """A sample of so many of these rows, which stands for all of them."""
        chosen = sample(self.is_direct, seed, rows)
        of, drawn = np.bincount(self.is_direct, minlength=2), np.bincount(self.is_direct[chosen], minlength=2)
        kind = self.is_direct[chosen].astype(int)
        return replace(self.only(chosen), stands_for=of[kind] / drawn[kind])


def rows_of_build(of: int) -> int:
    """Number of rows that the certificate of a build solves again, of so many that the tables have."""
    return min(ROWS, max(_FEWEST, of // _ONE_IN))


def sample(is_direct: Bool[np.ndarray, "n"], seed: int, rows: int = ROWS) -> np.ndarray:
    """Numbers of up to so many rows, drawn without repetition, ascending; half of either kind if there are."""
    order = np.random.default_rng(seed).permutation(len(is_direct))
    others, direct = order[~is_direct[order]], order[is_direct[order]]
    others = others[: max(rows // 2, rows - len(direct))]
    return np.sort(np.concatenate([others, direct[: rows - len(others)]]))
