"""`pipeline inform`: what a build tells a calibration, as lines, as data and as a picture."""

import math
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from pipeline.files.jsonfile import Json
from pipeline.fits.field import FitError
from pipeline.plugins.fits.knowledge import Knowledge, knowledge_of
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
    """Fit a model to the rows of a camera in a build; by default OpenCV's five coefficients, or a thin lens before
    pinholes.
    """
    output, live = open_output(out), ready(out, name, allow_roots)
    camera = output.cameras[live.name]
    name_of_model = model or (THIN_LENS if camera.is_plenoptic else _DEFAULT)
    return knowledge_of(output, camera, live, name_of_model, noise_px)


def page(knowledge: Knowledge) -> Iterator[str]:
    """Lines for a terminal."""
    information = knowledge.information
    rows, views = len(information.residual_px), len(information.views)
    yield f"{knowledge.camera}: {rows} rows in {views} views, corners detected to {information.noise_px:g} px"
    yield f"{knowledge.model}, all poses unknown, too; without noise it is wrong by {knowledge.rms_px:.2e} px rms"
    count, rank = len(information.names), information.rank
    yield f"the views determine {rank} of its {count} parameters" + (", all that there are" if rank == count else "")
    if len(information.gauge) <= _DIRECTIONS:
        for direction in information.gauge:
            named = zip(information.names, direction, strict=True)
            parts = [f"{name} {part:+.2f}" for name, part in named if abs(part) > 0.05]
            yield f"  undetermined, in shares of their own deviations: {', '.join(parts)}"
    yield ""
    yield from _table(knowledge)
    yield ""
    yield "deviation of projections over the image [px], one sigma along the longer axis"
    yield f"{'vision z':>14} {'least':>10} {'median':>10} {'largest':>10}"
    for prediction in knowledge.predictions:
        quantiles = np.quantile(prediction.deviation_px, (0, 0.5, 1), method="nearest")
        yield f"{prediction.z_mm:11.1f} mm {' '.join(f'{value:10.3g}' for value in quantiles)}"


def _table(knowledge: Knowledge) -> Iterator[str]:
    """Lines about each parameter, or about all of a spline's."""
    information = knowledge.information
    if len(information.names) > _LISTED:
        finite = information.deviations[np.isfinite(information.deviations)]
        span = f", from {finite.min():.2g} to {finite.max():.2g}" if len(finite) else ""
        yield f"{len(finite)} parameters have deviations of their own{span}; the others are open, alone or together"
        return
    yield f"{'parameter':14} {'value':>16} {'deviation':>12}  most alike"
    for row in document(knowledge)["parameters"]:
        alike = f"{row['alike']} ({row['correlation']:+.4f})" if row["alike"] else ""
        deviation = "undetermined" if row["deviation"] is None else f"{row['deviation']:.4g}"
        yield f"{row['name']:14} {row['value']:16.9g} {deviation:>12}  {alike}"


def document(knowledge: Knowledge) -> Json:
    """The same as plain data, with the covariance and the maps; what is undetermined is null."""
    information = knowledge.information
    size = np.sqrt(np.diag(information.covariance))
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = np.nan_to_num(information.covariance / np.outer(size, size))
    np.fill_diagonal(correlation, 0.0)
    correlation[:, ~np.isfinite(information.deviations)] = 0.0
    most_alike, rows = np.abs(correlation).argmax(axis=1), []
    for i, name in enumerate(information.names):
        value, deviation = information.parameters[i], information.deviations[i]
        is_determined = math.isfinite(deviation)
        rows.append(
            {
                "name": name,
                "value": float(value),
                "deviation": float(deviation) if is_determined else None,
                "alike": information.names[most_alike[i]] if is_determined else None,
                "correlation": float(correlation[i, most_alike[i]]) if is_determined else None,
            }
        )
    return {
        "camera": knowledge.camera,
        "model": knowledge.model,
        "noise_px": information.noise_px,
        "views": len(information.views),
        "rows": len(information.residual_px),
        "rms_px": knowledge.rms_px,
        "rank": information.rank,
        "gauge": [dict(zip(information.names, direction, strict=True)) for direction in information.gauge.tolist()],
        "parameters": rows,
        "covariance": information.covariance.tolist(),
        "projections": [
            {
                "z_mm": prediction.z_mm,
                "x_px": prediction.x_px.tolist(),
                "deviation_px": [v if math.isfinite(v) else None for v in prediction.deviation_px.tolist()],
            }
            for prediction in knowledge.predictions
        ],
    }


def maps(knowledge: Knowledge) -> str:
    """The drawing, or an empty text where there is nothing to draw."""
    try:
        return drawing(knowledge)
    except FitError:
        return ""


def drawing(knowledge: Knowledge) -> str:
    """The deviation of projections over the image, a map for each distance, as SVG; white where nothing is known.

    Raises FitError: the views leave all of them open. UsageError: matplotlib is not installed.
    """
    wide, high = knowledge.size_px
    values = np.concatenate([prediction.deviation_px for prediction in knowledge.predictions])
    finite_px = values[np.isfinite(values) & (values > 0)]
    if not len(finite_px):
        raise FitError("nothing to draw: the views leave all projections open", hint="take more views, or other poses")
    rows = math.ceil(len(knowledge.predictions) / _COLUMNS)
    sheet = figure(_COLUMNS * _PANEL_IN, rows * (_PANEL_IN * high / wide + _WORDS_IN))
    sheet.suptitle(f"deviation of projections [px]: {knowledge.camera}, {knowledge.model}")
    panels = sheet.subplots(rows, _COLUMNS, squeeze=False)
    for axes in panels.flat[len(knowledge.predictions) :]:
        axes.axis("off")
    colours = {"edgecolor": "face", "cmap": "Blues", "norm": "log", "vmin": finite_px.min(), "vmax": finite_px.max()}
    for prediction, axes in zip(knowledge.predictions, panels.flat, strict=False):
        (x, column), (y, row) = (np.unique(axis, return_inverse=True) for axis in prediction.x_px.T)
        deviation_px = np.full((len(y), len(x)), np.nan)
        deviation_px[row, column] = prediction.deviation_px
        deviation_px[~np.isfinite(deviation_px)] = np.nan
        tiles = axes.pcolormesh(x, y, np.ma.masked_invalid(deviation_px), shading="nearest", **colours)
        median = np.quantile(prediction.deviation_px, 0.5, method="nearest")
        axes.set_title(f"{prediction.z_mm:.4g} mm before the stop: median {median:.2g}", fontsize="medium")
        axes.set(xlim=(-0.5, wide - 0.5), ylim=(high - 0.5, -0.5), aspect="equal")
    sheet.colorbar(tiles, ax=panels, shrink=0.8)
    return svg_of(sheet)
