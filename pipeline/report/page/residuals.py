"""Statistics of the rows of a camera: errors, light, blur, and what a pinhole with distortion leaves."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from pipeline.frames import apply
from pipeline.report.page.records import Histogram, Residuals
from pipeline.results.records import BuiltCamera, BuiltPinhole, BuiltView
from pipeline.results.spots import drawn

_BINS = 40
"""Bins of a histogram."""
_POINTS = 4000
"""Most points of a map: more are a blot, and bytes."""


def residuals(camera: BuiltCamera, certificate: Mapping[str, Any] | None) -> Residuals:
    """Statistics over all frames; maps show evenly taken rows. The certificate is that of the manifest, if any."""
    claim_px = certificate["claim_px"] if certificate else None
    apart = np.array(certificate["differences_px"] if certificate else (), float)
    rows = camera.correspondences
    empty = np.zeros(0)
    if len(rows) == 0:
        return Residuals(histograms=(), **dict.fromkeys(("x_px", "y_px", "rho_px", "dx_px", "dy_px"), ()))
    off = _off_pinhole(camera)
    sigma = np.hypot(rows.sigma_x_px, rows.sigma_y_px)
    histograms = [
        _logarithmic(f"Differences that the certificate found, {len(apart)} of {len(rows):,} rows", apart, claim_px),
        _logarithmic("Stated standard error of a row", sigma, claim_px),
        _linear("Signed blur radius", "px", rows.rho_px),
        _linear("Hit fraction", "", rows.hit_fraction),
    ]
    if off is not None:
        pinhole = camera.pinhole_with_distortion
        rms = None if pinhole is None else pinhole.rms_px
        histograms.append(_logarithmic("Left by the pinhole with distortion", np.hypot(*off.T), rms, "its rms"))
    chosen = np.unique(np.linspace(0, len(rows) - 1, min(_POINTS, len(rows))).astype(int))
    dx, dy = (empty, empty) if off is None else off[chosen].T
    return Residuals(
        histograms=tuple(histogram for histogram in histograms if histogram is not None),
        x_px=drawn(rows.x_px[chosen]),
        y_px=drawn(rows.y_px[chosen]),
        rho_px=drawn(rows.rho_px[chosen]),
        dx_px=tuple(dx.tolist()),
        dy_px=tuple(dy.tolist()),
    )


def _off_pinhole(camera: BuiltCamera) -> np.ndarray | None:
    """Positions minus those of the equivalent pinhole with distortion, (n, 2) [px]; None of plenoptic cameras."""
    pinhole = camera.pinhole_with_distortion
    if pinhole is None or camera.is_plenoptic:
        return None
    parts = [_off_in_view(view, pinhole) for view in camera.views]
    return np.concatenate([part for part in parts if part is not None]) if parts else None


def _off_in_view(view: BuiltView, pinhole: BuiltPinhole) -> np.ndarray:
    rows, off = view.correspondences, np.full((len(view.correspondences), 2), np.nan)
    for name, pose in view.poses.pinhole_from_target.items():
        on_target = rows.target == name
        points = np.column_stack([rows[f"target_{axis}_mm"][on_target] for axis in "xyz"])
        seen_px = np.column_stack([rows.x_px[on_target], rows.y_px[on_target]])
        off[on_target] = seen_px - pinhole.projected(apply(pose, points))
    return off


def _linear(title: str, unit: str, values: np.ndarray) -> Histogram | None:
    values = values[np.isfinite(values)]
    if not values.size:
        return None
    counts, edges = np.histogram(values, _BINS)
    return _histogram(title, unit, (edges, counts), is_logarithmic=False)


def _logarithmic(
    title: str, values: np.ndarray, mark: float | None = None, mark_name: str = "the claim"
) -> Histogram | None:
    """A histogram over decades of lengths in px; zeros have no place on it."""
    values = values[np.isfinite(values) & (values > 0)]
    if not values.size:
        return None
    low, high = (math.log10(float(end)) for end in (values.min(), values.max()))
    counts, edges = np.histogram(np.log10(values), _BINS, range=(low, high) if high > low else (low - 0.5, low + 0.5))
    return _histogram(title, "px", (10.0**edges, counts), is_logarithmic=True, mark=mark, mark_name=mark_name)


def _histogram(
    title: str,
    unit: str,
    bins: tuple[np.ndarray, np.ndarray],
    *,
    is_logarithmic: bool,
    mark: float | None = None,
    mark_name: str = "",
) -> Histogram:
    edges, counts = bins
    return Histogram(
        title=title,
        unit=unit,
        is_logarithmic=is_logarithmic,
        edges=tuple(edges.tolist()),
        counts=tuple(counts.tolist()),
        mark=mark,
        mark_name=mark_name,
    )
