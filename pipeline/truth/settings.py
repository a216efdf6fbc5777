"""Settings of the ground truth of a camera."""

from dataclasses import dataclass, replace
from typing import Annotated

COLUMN_SETS = ("chief", "saddle", "centroid")
CLAIM_PX = 1e-3
"""Claim where a stage states none [px]: `direct` keeps it, which the certificate of every build tests."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TruthSettings:
    """The authored `plen:truth:*` values of a camera that decide its rows; the schema says what each means."""

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
        """The accuracy that is aimed at [px]: the claim, or that of other methods where nothing is claimed."""
        return self.claim_px or CLAIM_PX

    @property
    def searches(self) -> bool:
        """Whether points are searched in position images, so that these must be traced."""
        return self.method != "direct"

    @property
    def that_count(self) -> "TruthSettings":
        """The settings without those of a search where there is none: they would not change a row."""
        if self.searches:
            return self
        rest = TruthSettings(method=self.method)
        return replace(rest, min_hit_fraction=self.min_hit_fraction, accuracy_px=self.accuracy_px, columns=self.columns)
