"""`pipeline inform`: what a build tells a calibration, as lines, as data and as a picture."""

import math
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from pipeline.files import svg
from pipeline.files.jsonfile import Json
from pipeline.fits.field import FitError
from pipeline.fits.knowledge import Knowledge, Prediction, knowledge
from pipeline.fits.result import THIN_LENS
from pipeline.results.opening import ready
from pipeline.results.output import open_output

_DEFAULT = "brown"
"""Model that is asked about where none is named: what OpenCV fits by default."""
_LISTED, _DIRECTIONS = 40, 6
"""Most parameters, and most undetermined directions, that have lines of their own: control points of splines are
hundreds."""
_COLUMNS = 2
"""Maps side by side."""
_PANEL_PX, _MARGIN_PX = 420, 40
"""Width of the map of a distance, and blank edge [px]."""
_CLEAR, _DARK = (247, 251, 255), (8, 48, 107)
"""Colours of the least and the largest deviation of a picture, red, green and blue."""


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
    """The deviation of projections over the image, a map for each distance, as SVG.

    Raises FitError: the views leave all of them open.
    """
    wide, high = known.size_px
    tall, inner = _PANEL_PX * high / wide, 2 * _MARGIN_PX
    values = np.concatenate([each.deviation_px for each in known.predictions])
    known_px = values[np.isfinite(values) & (values > 0)]
    if not len(known_px):
        raise FitError("nothing to draw: the views leave all projections open", hint="take more views, or other poses")
    least, most = known_px.min(), known_px.max()
    span = np.log([least, most])
    title = f"deviation of projections [px], from {least:.2g} to {most:.2g}"
    items = [svg.words(title, (_MARGIN_PX, 26), font_size=15)]
    items.append(svg.words(f"{known.camera}, {known.model}", (_MARGIN_PX, 44), font_size=12))
    for number, each in enumerate(known.predictions):
        row, column = divmod(number, _COLUMNS)
        corner = _MARGIN_PX + column * (_PANEL_PX + _MARGIN_PX), inner + row * (tall + inner)
        items += _map(each, corner, _PANEL_PX / wide, span)
    rows = math.ceil(len(known.predictions) / _COLUMNS)
    size = _MARGIN_PX + _COLUMNS * (_PANEL_PX + _MARGIN_PX), inner + rows * (tall + inner)
    return svg.document(size, *items, font_family="sans-serif")


def _map(each: Prediction, corner: tuple[float, float], scale: float, span: np.ndarray) -> Iterator[str]:
    """One distance: a tile for each position, the darker the less is known; those of no knowledge are left out."""
    (left, top), steps = corner, [np.diff(np.unique(axis))[0] * scale for axis in each.x_px.T]
    shown = f"{np.quantile(each.deviation_px, 0.5, method='nearest'):.2g}"
    yield svg.words(f"{each.z_mm:.4g} mm before the stop: median {shown}", (left, top - 10), font_size=12)
    for (x, y), deviation in zip(each.x_px.tolist(), each.deviation_px.tolist(), strict=True):
        if math.isfinite(deviation):
            share = (math.log(max(deviation, 1e-300)) - span[0]) / max(span[1] - span[0], 1e-9)
            colour = [round(a + min(max(share, 0.0), 1.0) * (b - a)) for a, b in zip(_CLEAR, _DARK, strict=True)]
            at = left + (x + 0.5) * scale - steps[0] / 2, top + (y + 0.5) * scale - steps[1] / 2
            fill = "#{:02x}{:02x}{:02x}".format(*colour)
            yield svg.element(
                "rect", x=at[0], y=at[1], width=steps[0], height=steps[1], fill=fill, shape_rendering="crispEdges"
            )
