"""Noise on observations: Gaussian, outliers, missed points. A function of the seed and of what is observed alone.

Numbers come from a counter, as images' do from Sobol points: the same observation has the same noise whatever else is
exported. The mixing of 64 bits is the finaliser of SplitMix64: Steele, Lea, Flood, OOPSLA 2014.
"""

import hashlib
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.formats import ExportError
from pipeline.spelling import did_you_mean

if TYPE_CHECKING:  # every graph of tasks knows `Noise`, and few have exports
    from pipeline.exports.material import ExportView, Material

_STEP, _FIRST_FACTOR, _SECOND_FACTOR = (
    np.uint64(n) for n in (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB)
)
"""Constants of SplitMix64: the golden ratio as a step, and its two multipliers."""
_FRACTION = 2.0**-53
"""Distance of the numbers that 53 bits make of [0, 1)."""
_MISSED, _OUTLIER, _RADIUS, _ANGLE, _X, _Y = range(6)
"""Streams of one observation: each draws one number."""
_KINDS: dict[str, type] = {"noise_px": float, "outliers": float, "outlier_px": float, "missed": float, "seed": int}


@dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """Errors that a detector might make."""

    noise_px: float = 0.0  # standard deviation of the Gaussian on each axis
    outliers: float = 0.0  # share of the observations that are somewhere else
    outlier_px: float = 10.0  # half the width of the square about its true position in which an outlier lies
    missed: float = 0.0  # share of the observations that are left out
    seed: int = 1

    def __post_init__(self) -> None:
        for name in ("outliers", "missed"):
            if not 0 <= getattr(self, name) < 1:
                raise ExportError(f"{name} is a share from 0 to below 1, not {getattr(self, name)}")
        if not (0 <= self.noise_px < math.inf and 0 < self.outlier_px < math.inf):
            hint = "widths of noise are finite lengths in px: noise_px at least 0, outlier_px above 0"
            raise ExportError(f"noise_px is {self.noise_px} and outlier_px {self.outlier_px}", hint=hint)

    @property
    def is_none(self) -> bool:
        """Whether nothing is changed."""
        return not (self.noise_px or self.outliers or self.missed)


def noise_of(text: str) -> Noise:
    """Noise of a text, `0.1` or `0.1,outliers=0.01,missed=0.02,seed=3`; ExportError if a part means nothing."""
    values: dict[str, Any] = {}
    for part in text.split(","):
        name, equals, value = part.strip().rpartition("=")
        name = name.strip() if equals else "noise_px"
        if name not in _KINDS:
            hint = did_you_mean(name, _KINDS) or "for example 0.1,outliers=0.01,missed=0.02,seed=3"
            raise ExportError(f"noise has no {name!r}", hint=hint)
        try:
            values[name] = _KINDS[name](value)
        except ValueError:
            raise ExportError(f"noise: {name} is {_KINDS[name].__name__}, not {value!r}") from None
    return Noise(**values)


def with_noise(material: "Material", noise: Noise) -> "Material":
    """A material with noise on its observations, and remarks that say so."""
    if noise.is_none:
        return material
    views = tuple(_noisy(view, noise) for view in material.views)
    gaussian = f"Gaussian {noise.noise_px} px, {noise.outliers} outliers within {noise.outlier_px} px"
    remark = f"NOISE WAS ADDED: {gaussian}, {noise.missed} missed, seed {noise.seed}"
    return replace(material, remarks=(*material.remarks, remark), views=views)


def _noisy(view: "ExportView", noise: Noise) -> "ExportView":
    """A view whose positions are moved, and of whose observations some are left out.

    The counter of each observation is a hash of the seed, the view, the point and the microlens.
    """
    observations = view.observations
    key = hashlib.sha256(f"{noise.seed}\0{view.camera}\0{view.frame}\0{view.target}".encode()).digest()
    microlenses = () if observations.microlenses is None else observations.microlenses.T
    state = np.full(len(observations.ids), int.from_bytes(key[:8], "little"), np.uint64)
    for numbers in (observations.ids, *microlenses):
        state = _mixed(state ^ _mixed(numbers.astype(np.int64).view(np.uint64)))
    draws = [_uniform(state, stream) for stream in range(_Y + 1)]
    radius = noise.noise_px * np.sqrt(-2 * np.log1p(-draws[_RADIUS]))  # Box and Muller
    angle = 2 * np.pi * draws[_ANGLE]
    gaussian = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    in_square = noise.outlier_px * (2 * np.stack([draws[_X], draws[_Y]], axis=1) - 1)
    is_outlier = draws[_OUTLIER] < noise.outliers
    moved = observations.positions + np.where(is_outlier[:, None], in_square, gaussian)
    return replace(view, observations=replace(observations, positions=moved).only(draws[_MISSED] >= noise.missed))


def _uniform(state: np.ndarray, stream: int) -> np.ndarray:
    """Numbers of [0, 1), of 53 bits."""
    with np.errstate(over="ignore"):
        return (_mixed(state + np.uint64(stream + 1) * _STEP) >> np.uint64(11)) * _FRACTION


def _mixed(bits: np.ndarray) -> np.ndarray:
    """Sixty-four bits of which each depends on all that came in."""
    with np.errstate(over="ignore"):
        bits = (bits ^ (bits >> np.uint64(30))) * _FIRST_FACTOR
        bits = (bits ^ (bits >> np.uint64(27))) * _SECOND_FACTOR
        return bits ^ (bits >> np.uint64(31))
