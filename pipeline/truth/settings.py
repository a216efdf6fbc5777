"""How ground truth is found in the position images of a camera."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class TruthSettings:
    """The authored `plen:truth:*` values of a camera that the search reads.

    Attributes
    ----------
    method : str
        `two-plane` (J from J_near and J_far), `moments` (corrected to second order) or `image` (J rendered per pose).
    search : str
        `quad` (cell of four neighbours and a local linear solve) or `nearest` (the paper's naive search).
    filter : str
        `lengths-and-angles` or `none`.
    lambda_d : float
        Largest relative deviation of a neighbour distance from its mean.
    lambda_alpha_deg : float
        Largest deviation of a grid angle from its mean.
    nearest_threshold_mm : float
        Largest distance on the target that the nearest search accepts.
    min_hit_fraction : float
        Correspondences below this hit fraction are dropped.
    """

    method: str = "two-plane"
    search: str = "quad"
    filter: str = "lengths-and-angles"
    lambda_d: float = 0.15
    lambda_alpha_deg: float = 10.0
    nearest_threshold_mm: float = 0.05
    min_hit_fraction: float = 0.05
