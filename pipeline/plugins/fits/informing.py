"""`pipeline inform`: what a build tells a calibration, as lines, as data and as a picture."""

import math
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from pipeline.files.jsonfile import Json
from pipeline.fits.field import FitError
from pipeline.plugins.fits.knowledge import Knowledge, knowledge
from pipeline.plugins.fits.result import THIN_LENS
from pipeline.results.notebook import figure, svg_of
from pipeline.results.opening import ready
from pipeline.results.output import open_output

_DEFAULT = "brown"
"""Model that is asked about where none is named: what OpenCV fits by default."""
_LISTED, _DIRECTIONS = 40, 6
"""Most parameters, and most undetermined directions, that have lines of their own: control points of splines are
hundreds."""
_COLUMNS = 2
"""Maps side by side."""
_PANEL_IN, _WORDS_IN = 4.5, 0.8
"""Width of the map of a distance, and height of words [inch]."""


def inform(
    out: Path, name: str | None, model: str | None, noise_px: float, allow_roots: Iterable[str | Path] = ()
) -> Knowledge:
    """Ask the rows of a build about a camera; by default of OpenCV's five coefficients, or of a thin lens before
    pinholes.
    """
    output, live = open_output(out), ready(out, name, allow_roots)
    camera = output.cameras[live.name]
    wanted = model or (THIN_LENS if camera.is_plenoptic else _DEFAULT)
    return knowledge(output, camera, live, wanted, noise_px)


def page(known: Knowledge) -> Iterator[str]:
    """Lines for a terminal."""
    told = known.information
    rows, views = len(told.residual_px), len(told.views)
    yield f"{known.camera}: {rows} rows in {views} views, corners detected to {told.noise_px:g} px"
    yield f"{known.model}, all poses unknown, too; without noise it is wrong by {known.rms_px:.2e} px rms"
    count, rank = len(told.names), told.rank
    yield f"the views determine {rank} of its {count} parameters" + (", all that there are" if rank == count else "")
    if len(told.gauge) <= _DIRECTIONS:
        for direction in told.gauge:
            parts = [
                f"{name} {part:+.2f}" for name, part in zip(told.names, direction, strict=True) if abs(part) > 0.05
            ]
            yield f"  undetermined, in shares of their own deviations: {', '.join(parts)}"
    yield ""
    yield from _table(known)
    yield ""
    yield "deviation of projections over the image [px], one sigma along the longer axis"
    yield f"{'vision z':>14} {'least':>10} {'median':>10} {'largest':>10}"
    for each in known.predictions:
        shown = (f"{value:10.3g}" for value in np.quantile(each.deviation_px, (0, 0.5, 1), method="nearest"))
        yield f"{each.z_mm:11.1f} mm {' '.join(shown)}"


def _table(known: Knowledge) -> Iterator[str]:
    """Lines about each parameter, or about all of a spline's."""
    told = known.information
    if len(told.names) > _LISTED:
        finite = told.deviations[np.isfinite(told.deviations)]
        span = f", from {finite.min():.2g} to {finite.max():.2g}" if len(finite) else ""
        yield f"{len(finite)} parameters have deviations of their own{span}; the others are open, alone or together"
        return
    yield f"{'parameter':14} {'value':>16} {'deviation':>12}  most alike"
    for row in document(known)["parameters"]:
        alike = f"{row['alike']} ({row['correlation']:+.4f})" if row["alike"] else ""
        deviation = "undetermined" if row["deviation"] is None else f"{row['deviation']:.4g}"
        yield f"{row['name']:14} {row['value']:16.9g} {deviation:>12}  {alike}"


def document(known: Knowledge) -> Json:
    """The same as plain data, with the covariance and the maps; what is undetermined is null."""
    told = known.information
    size = np.sqrt(np.diag(told.covariance))
    with np.errstate(invalid="ignore", divide="ignore"):
        alike = np.nan_to_num(told.covariance / np.outer(size, size))
    np.fill_diagonal(alike, 0.0)
    alike[:, ~np.isfinite(told.deviations)] = 0.0
    nearest, rows = np.abs(alike).argmax(axis=1), []
    for i, (name, value, deviation) in enumerate(zip(told.names, told.parameters, told.deviations, strict=True)):
        is_known = math.isfinite(deviation)
        rows.append(
            {
                "name": name,
                "value": float(value),
                "deviation": float(deviation) if is_known else None,
                "alike": told.names[nearest[i]] if is_known else None,
                "correlation": float(alike[i, nearest[i]]) if is_known else None,
            }
        )
    return {
        "camera": known.camera,
        "model": known.model,
        "noise_px": told.noise_px,
        "views": len(told.views),
        "rows": len(told.residual_px),
        "rms_px": known.rms_px,
        "rank": told.rank,
        "gauge": [dict(zip(told.names, direction, strict=True)) for direction in told.gauge.tolist()],
        "parameters": rows,
        "covariance": told.covariance.tolist(),
        "projections": [
            {
                "z_mm": each.z_mm,
                "x_px": each.x_px.tolist(),
                "deviation_px": [value if math.isfinite(value) else None for value in each.deviation_px.tolist()],
            }
            for each in known.predictions
        ],
    }


def maps(known: Knowledge) -> str:
    """The drawing, or an empty text where there is nothing to draw."""
    try:
        return drawing(known)
    except FitError:
        return ""


def drawing(known: Knowledge) -> str:
    """The deviation of projections over the image, a map for each distance, as SVG; white where nothing is known.

    Raises FitError: the views leave all of them open. UsageError: matplotlib is not installed.
    """
    wide, high = known.size_px
    values = np.concatenate([each.deviation_px for each in known.predictions])
    known_px = values[np.isfinite(values) & (values > 0)]
    if not len(known_px):
        raise FitError("nothing to draw: the views leave all projections open", hint="take more views, or other poses")
    rows = math.ceil(len(known.predictions) / _COLUMNS)
    shown = figure(_COLUMNS * _PANEL_IN, rows * (_PANEL_IN * high / wide + _WORDS_IN))
    shown.suptitle(f"deviation of projections [px]: {known.camera}, {known.model}")
    cells = shown.subplots(rows, _COLUMNS, squeeze=False)
    for axes in cells.flat[len(known.predictions) :]:
        axes.axis("off")
    for each, axes in zip(known.predictions, cells.flat, strict=False):
        (x, column), (y, row) = (np.unique(axis, return_inverse=True) for axis in each.x_px.T)
        deviation_px = np.full((len(y), len(x)), np.nan)
        deviation_px[row, column] = each.deviation_px
        deviation_px[~np.isfinite(deviation_px)] = np.nan
        colours = {"edgecolor": "face", "cmap": "Blues", "norm": "log", "vmin": known_px.min(), "vmax": known_px.max()}
        tiles = axes.pcolormesh(x, y, np.ma.masked_invalid(deviation_px), shading="nearest", **colours)
        median = np.quantile(each.deviation_px, 0.5, method="nearest")
        axes.set_title(f"{each.z_mm:.4g} mm before the stop: median {median:.2g}", fontsize="medium")
        axes.set(xlim=(-0.5, wide - 0.5), ylim=(high - 0.5, -0.5), aspect="equal")
    shown.colorbar(tiles, ax=cells, shrink=0.8)
    return svg_of(shown)
