"""Settings of the ground truth of a camera."""

from dataclasses import dataclass, replace
from typing import Annotated

COLUMN_SETS = ("chief", "saddle", "centroid")
CLAIM_PX = 1e-3
"""Default claim [px]: `direct` keeps it, which the certificate of every build tests."""
ROWS = 135
"""Most rows solved again per camera, so that the cost does not grow with the dataset: if a twentieth of the rows of a
large dataset is wrong, a sample without any of them is drawn once in a thousand times."""
_FEWEST, _ONE_IN = 45, 8
"""Rows that a build solves again: a least number, else one in so many. More would cost more than the build itself;
these miss an error of a twentieth of the rows once in ten times."""
SHARPER = 3.0
"""Standard errors by which a row must keep its claim to get no more rays [1]."""
JUDGES_RAYS = tuple(1 << power for power in range(14, 23, 2))
"""Numbers of rays of a row, level by level. A row gets more rays only while it does not keep the claim by `SHARPER`
standard errors, and its own standard error exceeds half of the accepted one."""
LEVELS = LOOK_RAYS, RAYS, _, MOST_RAYS = 1 << 10, 1 << 14, 1 << 17, 1 << 20
"""Numbers of random rays, over all replicas: of a row that may be hidden, of a row found to be partly hidden, and of
one whose bundle is a tiny part of its sampling region. Most rows are entirely visible or hidden."""
LEAVING = 256
"""Rays that leave a camera and suffice to call a row entirely hidden [1]: of 3 % of its light seven arrive."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TruthSettings:
    """The authored `plen:truth:*` values of a camera that decide its rows; the schema is their manual."""

    method: Annotated[str, "plen:truth:method"] = "direct"
    search: Annotated[str, "plen:truth:search"] = "quad"
    filter: Annotated[str, "plen:truth:filter"] = "lengths-and-angles"
    lambda_d: Annotated[float, "plen:truth:lambdaD"] = 0.15
    lambda_alpha_deg: Annotated[float, "plen:truth:lambdaAlpha"] = 10.0
    nearest_threshold_mm: Annotated[float, "plen:truth:nearestThreshold"] = 0.05
    min_hit_fraction: Annotated[float, "plen:truth:minHitFraction"] = 0.05
    accuracy_px: Annotated[float | None, "plen:truth:accuracy"] = None
    columns: Annotated[tuple[str, ...], "plen:truth:columns"] = ()

    @property
    def column_sets(self) -> tuple[str, ...]:
        """The optional sets, each once, in the order of the table."""
        return tuple(name for name in COLUMN_SETS if name in self.columns)

    @property
    def claim_px(self) -> float | None:
        """The accuracy that rows claim [px]; None: nothing is authored, and the method has no default claim."""
        default = None if self.searches else CLAIM_PX
        return default if self.accuracy_px is None else self.accuracy_px

    @property
    def aim_px(self) -> float:
        """The accuracy that searches aim at [px]: the claim, or the default one where nothing is claimed."""
        return self.claim_px or CLAIM_PX

    @property
    def searches(self) -> bool:
        """Whether points are searched in position images, which must then be traced."""
        return self.method != "direct"

    @property
    def effective(self) -> "TruthSettings":
        """The settings without those of a search for a method that has none: they would not change a row."""
        if self.searches:
            return self
        rest = TruthSettings(method=self.method)
        return replace(rest, min_hit_fraction=self.min_hit_fraction, accuracy_px=self.accuracy_px, columns=self.columns)


def rows_of_build(table_rows: int) -> int:
    """Number of rows that the certificate of a build solves again, out of those in its tables."""
    return min(ROWS, max(_FEWEST, table_rows // _ONE_IN))
