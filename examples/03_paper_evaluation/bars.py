"""From positions to bars: mean difference, its standard error, and the share of detected corners."""

import csv
import itertools
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np
from results import Results
from sampling import SAMPLINGS
from windows import ACCEPTED, METHODS, REJECTED

from pipeline.truth.grid.ray_grid import fine_from_image

MAPPINGS = ("printed", "half-pixel")
SETTINGS = tuple(itertools.product(MAPPINGS, SAMPLINGS))
"""Mapping of the fine grid to the image x kind of rays."""


@dataclass(frozen=True, slots=True)
class Bar:
    """One bar of a figure.

    Attributes
    ----------
    method, mapping, sampling : str
    k, samples : int
        0 where there is none.
    corners : int
        That exist.
    detected : float
        Share of them.
    mean_px, sem_px : float
        Difference from the truth, as a length, of those detected; its standard error. Of `direct`, which is the truth:
        from what random rays say.
    k10_px, k10_sem_px : float
        The same from the setting's own `image` at the largest K and samples, of those that both detect.
    no_quad, window, lengths, angles : int
        What rejected the others.
    """

    method: str
    mapping: str
    sampling: str
    k: int
    samples: int
    corners: int
    detected: float
    mean_px: float
    sem_px: float
    k10_px: float
    k10_sem_px: float
    no_quad: int = 0
    window: int = 0
    lengths: int = 0
    angles: int = 0


def mapped(x_px: np.ndarray, k: int, mapping: str) -> np.ndarray:
    """Positions by a mapping, from those by the half-pixel rule; the paper prints x = x_K / K."""
    return fine_from_image(x_px, k) / k if mapping == "printed" else x_px


def lengths(x_px: np.ndarray, other_px: np.ndarray) -> np.ndarray:
    """Differences as lengths, (n,) [px]; NaN where one is missing."""
    return np.hypot(*np.moveaxis(x_px - other_px, -1, 0))


def mean_and_error(values: np.ndarray) -> tuple[float, float]:
    """Mean and its standard error, of what is there; NaN of nothing."""
    finite = values[~np.isnan(values)]
    if len(finite) < 2:
        return (float(finite[0]) if len(finite) else float("nan")), float("nan")
    return float(finite.mean()), float(finite.std(ddof=1) / np.sqrt(len(finite)))


def reference(results: Results, sampling: str, mapping: str) -> np.ndarray:
    """The paper's reference: method `image` at the largest K and samples, by the same mapping and rays, (n, 2)."""
    x = results.x_px[SAMPLINGS.index(sampling), METHODS.index("image"), -1, -1]
    return mapped(x, int(results.ks[-1]), mapping)


def bars(results: Results) -> list[Bar]:
    """All bars."""
    return [*_of_the_paper(results), *_of_direct(results)]


def _of_the_paper(results: Results) -> Iterator[Bar]:
    for (mapping, sampling), (m, method) in itertools.product(SETTINGS, enumerate(METHODS)):
        s, k10 = SAMPLINGS.index(sampling), reference(results, sampling, mapping)
        for (i, k), (j, samples) in itertools.product(enumerate(results.ks), enumerate(results.samples)):
            x, status = mapped(results.x_px[s, m, i, j], int(k), mapping), results.status[s, m, i, j]
            rejected = [int(np.sum(status == code)) for code in REJECTED]
            errors = *mean_and_error(lengths(x, results.truth_px)), *mean_and_error(lengths(x, k10))
            share = float(np.mean(status == ACCEPTED))
            yield Bar(method, mapping, sampling, int(k), int(samples), len(status), share, *errors, *rejected)


def _of_direct(results: Results) -> Iterator[Bar]:
    """Against itself `direct` has no error: judged by random rays."""
    k10 = reference(results, "ours", "half-pixel")
    x = results.direct_px[-1]
    errors = *mean_and_error(np.hypot(*results.judged_px.T)), *mean_and_error(lengths(x, k10))
    yield Bar("direct", "half-pixel", "quadrature", 0, 0, len(x), _share_of_positions(x), *errors)


def _share_of_positions(x_px: np.ndarray) -> float:
    return float(np.mean(np.isfinite(x_px).all(axis=-1)))


def write(file: Path, bars_of: dict[str, list[Bar]]) -> None:
    """The bars of each camera as a table."""
    with file.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["camera", *(field.name for field in fields(Bar))])
        for camera, all_bars in bars_of.items():
            writer.writerows([camera, *map(_plain, asdict(bar).values())] for bar in all_bars)


def _plain(value: object) -> object:
    """Six digits; empty for what is unknown."""
    if not isinstance(value, float):
        return value
    return "" if np.isnan(value) else float(f"{value:.6g}")
