"""What the evaluation varies, and all positions that it finds."""

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from windows import ACCEPTED


@dataclass(frozen=True, slots=True, kw_only=True)
class Grid:
    """What is varied."""

    ks: tuple[int, ...]
    samples: tuple[int, ...]
    moments_samples: tuple[int, ...]
    accuracies_px: tuple[float, ...] = (1e-2, 1e-3, 1e-4)
    judged_px: float = 1e-4


PAPER = Grid(
    ks=(1, 2, 4, 6, 8, 10),
    samples=(64**2, 128**2, 192**2, 256**2, 320**2),
    moments_samples=(16**2, 32**2, 64**2),
)
SMALL = Grid(ks=(1, 2), samples=(32**2, 64**2), moments_samples=(16**2, 32**2), judged_px=1e-3)


@dataclass(frozen=True, slots=True, kw_only=True)
class Results:
    """Image positions by the half-pixel rule [px], NaN where a corner is not detected; n corners.

    Attributes
    ----------
    ks, samples, moments_samples, accuracies_px
        The grid.
    x_px : (kinds of rays, methods, ks, samples, n, 2)
        In the order of SAMPLINGS and METHODS; rays start anywhere on the fine pixel.
    status : the same without the last axis
        What became of each corner, see `windows`.
    sharp_px : (methods, ks, n, 2)
        Without noise and without the pixel's width: our rays from the centres of the fine pixels, 128 x 128.
    moments_px : (ks, moments_samples, n, 2)
    moments_kept : (ks, moments_samples, n)
        Whether the position image could answer; else the position is solved directly.
    direct_px : (accuracies, n, 2)
    judged_px, judged_sigma_px : (n, 2)
        What random rays, as in a certificate, move the truth by, and their own standard error.
    other_px : (ks, samples up to 128 x 128, n, 2)
        `two-plane` from independent rays of its own, where `x_px` has both methods from the same rays.
    wide_px : (methods, ks, n, 2)
        The fewest independent rays in windows that reach twice as far.
    truth_px, truth_sigma_px : (n, 2)
    blur_px, hit_fraction : (n,)
    exist : ()
        Rows that the corners were drawn from.
    """

    ks: np.ndarray
    samples: np.ndarray
    moments_samples: np.ndarray
    accuracies_px: np.ndarray
    x_px: np.ndarray
    status: np.ndarray
    sharp_px: np.ndarray
    moments_px: np.ndarray
    moments_kept: np.ndarray
    direct_px: np.ndarray
    judged_px: np.ndarray
    judged_sigma_px: np.ndarray
    other_px: np.ndarray
    wide_px: np.ndarray
    truth_px: np.ndarray
    truth_sigma_px: np.ndarray
    blur_px: np.ndarray
    hit_fraction: np.ndarray
    exist: np.ndarray

    def save(self, file: Path) -> None:
        """As a .npz file."""
        np.savez_compressed(file, **{field.name: getattr(self, field.name) for field in fields(self)})

    @classmethod
    def joined(cls, parts: "list[Results]") -> "Results":
        """Results of several lots of corners as one."""
        columns = {field.name: [getattr(part, field.name) for part in parts] for field in fields(cls)}
        axes = _CORNER_AXIS
        return cls(**{n: np.concatenate(v, axis=axes[n]) if n in axes else v[0] for n, v in columns.items()})

    @classmethod
    def load(cls, file: Path) -> "Results":
        """What `save` wrote."""
        with np.load(file) as arrays:
            return cls(**{field.name: arrays[field.name] for field in fields(cls)})


_CORNER_AXIS = {
    **dict.fromkeys(("judged_px", "judged_sigma_px", "truth_px", "truth_sigma_px", "blur_px", "hit_fraction"), 0),
    "direct_px": 1,
    **dict.fromkeys(("sharp_px", "other_px", "wide_px", "moments_px", "moments_kept"), 2),
    **dict.fromkeys(("x_px", "status"), 4),
}
"""Which axis counts corners."""


def detected(status: np.ndarray) -> np.ndarray:
    """Share of the corners that are accepted; the last axis counts them."""
    return np.mean(status == ACCEPTED, axis=-1)
