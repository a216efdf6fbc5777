"""What the evaluation varies, and all positions that it finds, traced and searched lot by lot."""

import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import precision
from corners import Corners
from sampling import SAMPLINGS
from windows import ACCEPTED, METHODS, PLAIN, VARIANTS, Variant, search

_LOT = 8
_OTHER_SEED = 77


@dataclass(frozen=True, slots=True, kw_only=True)
class Grid:
    """What is varied."""

    ks: tuple[int, ...]
    samples: tuple[int, ...]
    accuracies_px: tuple[float, ...] = (1e-2, 1e-3, 1e-4)
    judged_px: float = 1e-4


PAPER = Grid(
    ks=(1, 2, 4, 6, 8, 10),
    samples=(64**2, 128**2, 192**2, 256**2, 320**2),
)
SMALL = Grid(ks=(1, 2), samples=(32**2, 64**2), judged_px=1e-3)


@dataclass(frozen=True, slots=True, kw_only=True)
class Results:
    """Image positions by the half-pixel rule [px], NaN where a corner is not detected; n corners.

    Attributes
    ----------
    ks, samples, accuracies_px
        The grid.
    x_px : (kinds of rays, methods, ks, samples, n, 2)
        In the order of SAMPLINGS and METHODS; rays start anywhere on the fine pixel.
    status : the same without the last axis
        What became of each corner, see `windows`.
    sharp_px : (methods, ks, n, 2)
        Without noise and without the pixel's width: our rays from the centres of the fine pixels, 128 x 128.
    direct_px : (accuracies, n, 2)
    judged_px, judged_sigma_px : (n, 2)
        What random rays, as in a certificate, move the truth by, and their own standard error.
    variant_px, variant_status : (variants, methods, ks, samples, n, 2), and without the last axis
        In the order of VARIANTS, from the independent rays of `x_px`.
    traced_px : (ways of `precision`, n)
        What float32 moves J by where only the rays are traced in it.
    other_px : (ks, samples up to 128 x 128, n, 2)
        `two-plane` from independent rays of its own, where `x_px` has both methods from the same rays.
    wide_px : (methods, ks, n, 2)
        The fewest independent rays in windows that reach twice as far.
    truth_px, truth_sigma_px : (n, 2)
    blur_px, hit_fraction, distance_mm : (n,)
        The last one of the board's middle from the stop.
    exist, is_conventional : ()
        Rows that the corners were drawn from; whether there are no microlenses.
    """

    ks: np.ndarray
    samples: np.ndarray
    accuracies_px: np.ndarray
    x_px: np.ndarray
    status: np.ndarray
    sharp_px: np.ndarray
    variant_px: np.ndarray
    variant_status: np.ndarray
    traced_px: np.ndarray
    direct_px: np.ndarray
    judged_px: np.ndarray
    judged_sigma_px: np.ndarray
    other_px: np.ndarray
    wide_px: np.ndarray
    truth_px: np.ndarray
    truth_sigma_px: np.ndarray
    blur_px: np.ndarray
    hit_fraction: np.ndarray
    distance_mm: np.ndarray
    exist: np.ndarray
    is_conventional: np.ndarray

    def by(self, variant: Variant) -> "Results":
        """The same with positions from independent rays as a variant of the search finds them.

        Those of `other_px`, which only the paper's filters searched, become unknown.
        """
        if variant == PLAIN:
            return self
        number, independent = VARIANTS.index(variant), SAMPLINGS.index("independent")
        x_px, status = self.x_px.copy(), self.status.copy()
        x_px[independent], status[independent] = self.variant_px[number], self.variant_status[number]
        return replace(self, x_px=x_px, status=status, other_px=np.full_like(self.other_px, np.nan))

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
    **dict.fromkeys(("judged_px", "judged_sigma_px", "truth_px", "truth_sigma_px"), 0),
    **dict.fromkeys(("blur_px", "hit_fraction", "distance_mm"), 0),
    **dict.fromkeys(("direct_px", "traced_px"), 1),
    **dict.fromkeys(("sharp_px", "other_px", "wide_px"), 2),
    **dict.fromkeys(("x_px", "status", "variant_px", "variant_status"), 4),
}
"""Which axis counts corners."""


def detected(status: np.ndarray) -> np.ndarray:
    """Share of the corners that are accepted; the last axis counts them."""
    return np.mean(status == ACCEPTED, axis=-1)


def run(corners: Corners, grid: Grid, jobs: int, keep: Path | None = None) -> Results:
    """Everything, lot by lot; `keep` is a file that has all lots so far."""
    parts: list[Results] = []
    for first in range(0, len(corners), _LOT):
        parts.append(_run(corners.only(slice(first, first + _LOT)), grid, jobs))
        if keep:
            Results.joined(parts).save(keep)
    return Results.joined(parts)


def _run(corners: Corners, grid: Grid, jobs: int) -> Results:
    """A lot, corner by corner; threads share the work."""
    n, shape = len(corners), (len(SAMPLINGS), len(METHODS), len(grid.ks), len(grid.samples))
    x, status = np.full((*shape, n, 2), np.nan), np.full((*shape, n), -1)
    varied = np.full((len(VARIANTS), *x.shape[1:]), np.nan)
    varied_status = np.full((len(VARIANTS), *status.shape[1:]), -1)
    sharp, wide = (np.full((len(METHODS), len(grid.ks), n, 2), np.nan) for _ in range(2))
    few = tuple(count for count in grid.samples if count <= 128**2)
    other = np.full((len(grid.ks), len(few), n, 2), np.nan)

    def one(number: int) -> None:
        for i, k in enumerate(grid.ks):
            for s, sampling in enumerate(SAMPLINGS):
                variants = (PLAIN, *(VARIANTS if sampling == "independent" else ()))
                positions, codes = search(corners, number, k, sampling, grid.samples, variants=variants)
                x[s, :, i, :, number], status[s, :, i, :, number] = positions[0], codes[0]
                if sampling == "independent":
                    varied[:, :, i, :, number], varied_status[:, :, i, :, number] = positions[1:], codes[1:]
            sharp[:, i, number] = search(corners, number, k, "ours", (128**2,), footprint="point")[0][0, :, 0]
            other[i, :, number] = search(corners, number, k, "independent", few, seed=_OTHER_SEED)[0][0, 1]
            wide[:, i, number] = search(corners, number, k, "independent", grid.samples[:1], margin_px=1.0)[0][0, :, 0]

    _each(one, n, jobs)
    judged, judged_sigma = corners.judged(grid.judged_px)
    return Results(
        ks=np.array(grid.ks),
        samples=np.array(grid.samples),
        accuracies_px=np.array(grid.accuracies_px),
        x_px=x,
        status=status,
        sharp_px=sharp,
        variant_px=varied,
        variant_status=varied_status,
        traced_px=np.stack([precision.moved_px(corners, number, grid.samples[-1]) for number in range(n)], axis=1),
        direct_px=np.stack([corners.solved(accuracy) for accuracy in grid.accuracies_px]),
        judged_px=judged,
        judged_sigma_px=judged_sigma,
        other_px=other,
        wide_px=wide,
        truth_px=corners.x_px,
        truth_sigma_px=corners.sigma_px,
        blur_px=corners.blur_px,
        hit_fraction=corners.hit_fraction,
        distance_mm=corners.pose[:, 2, 3],
        exist=np.array(corners.exist),
        is_conventional=np.array(corners.rig.images is None),
    )


def _each(one: Callable[[int], None], count: int, jobs: int) -> None:
    """Do it for all corners; kernels let other threads run."""
    start = time.perf_counter()
    with ThreadPoolExecutor(jobs) as pool:
        for done, future in enumerate(as_completed([pool.submit(one, number) for number in range(count)]), 1):
            future.result()
            line = f"\r{done} of {count} corners, {time.perf_counter() - start:.0f} s"
            print(line, end="" if done < count else "\n", file=sys.stderr, flush=True)
