"""A picture of a fit, as SVG: the residual field, residuals by distance, and the entrance pupil over the field."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from pipeline.files import svg
from pipeline.fits.fitting import Fit
from pipeline.fits.result import FittedCamera, by_distance

_WIDTH_PX, _MARGIN_PX, _PLOT_PX = 1000, 60, 260
"""Width of the picture, blank edge with room for numbers, and height of the two plots [px]."""
_NEAR, _FAR, _GREY, _DARK = "#1f5fa8", "#c0392b", "#bbbbbb", "#333333"
"""Colours: of the near and of the far plane, of frames, of words."""
_ARROW = 0.9
"""Length of the longest arrow over the distance of two positions of the grid [1]: arrows do not touch."""
_MARKED = 50
"""Most points that are joined by a line: more are a scatter, as rays of a lens with displaced surfaces are."""
_TICKS = 5
"""Numbers along an edge of a plot, about."""


def picture(camera: FittedCamera, fit: Fit) -> str:
    """The picture of one of the fits of a camera as the text of an SVG file."""
    wide, high = camera.field.size_px
    inner = _WIDTH_PX - 2 * _MARGIN_PX
    tall = inner * high / wide
    half = (inner - _MARGIN_PX) / 2
    below = 2 * _MARGIN_PX + tall + 20
    distances = by_distance(fit, camera.field)
    curves = _plot(
        (_MARGIN_PX, below, half, _PLOT_PX),
        ("residual at other distances [px]: rms (blue), largest (red)", "1 / z [1/m]"),
        np.array([1e3 / row["z_mm"] for row in distances]),
        [np.array([row[name] for row in distances]) for name in ("rms_px", "max_px")],
    )
    pupil = _plot(
        (2 * _MARGIN_PX + half, below, half, _PLOT_PX),
        ("entrance pupil: vision z [mm] where rays pass the axis", "angle [°]"),
        camera.pupil.angle_deg,
        [camera.pupil.z_mm],
    )
    title = f"{camera.name}: {fit.model.consumer}. rms {fit.rms_px:.2e} px, largest {fit.max_px:.2e} px"
    items = [svg.words(title, (_MARGIN_PX, 26), font_size=15, fill=_DARK)]
    items += [*_arrows(camera, fit, inner / wide), *curves, *pupil]
    size = (_WIDTH_PX, below + _PLOT_PX + _MARGIN_PX)
    return svg.document(size, *items, font_family="sans-serif")


def _arrows(camera: FittedCamera, fit: Fit, scale: float) -> Iterator[str]:
    """The residual field: from each position of the image, as many times longer as the legend says."""
    wide, high = camera.field.size_px
    left, top = float(_MARGIN_PX), float(_MARGIN_PX)
    yield svg.element(
        "rect", x=left, y=top, width=wide * scale, height=high * scale, fill="none", stroke=_GREY, stroke_width=1
    )
    step = np.diff(np.unique(camera.field.x_px[:, 0]))[0] * scale
    length = fit.max_px or 1.0
    starts = (np.array([left, top]) + (camera.field.x_px + 0.5) * scale).tolist()
    for residuals, colour in zip(fit.residual_px, (_NEAR, _FAR), strict=True):
        ends = (np.array(starts) + residuals / length * _ARROW * step).tolist()
        arrows = [
            (letter, [point])
            for pair in zip(starts, ends, strict=True)
            for letter, point in zip("ML", pair, strict=True)
        ]
        yield svg.path(arrows, stroke=colour, stroke_width=1)
    yield _dots(starts, _DARK, 1.5)
    near, far = camera.field.planes_mm
    caption = (
        f"model minus ray; the longest arrow is {fit.max_px:.2e} px; blue on the plane {near:.4g} mm, red {far:.4g} mm"
    )
    yield svg.words(caption, (left, top - 10), font_size=12, fill=_DARK)


def _dots(points: Sequence[svg.Point], colour: str, width_px: float) -> str:
    """Dots as one path: lines without length have round ends."""
    steps = [(letter, [point]) for point in points for letter in "ML"]
    return svg.path(steps, stroke=colour, stroke_width=width_px, stroke_linecap="round")


def _plot(
    box: tuple[float, float, float, float], words: tuple[str, str], x: np.ndarray, ys: Sequence[np.ndarray]
) -> Iterator[str]:
    """Curves over one another in a box: x, y of its corner, width, height; words above and below it."""
    (left, top, wide, tall), (above, below) = box, words
    yield svg.words(above, (left, top - 10), font_size=12, fill=_DARK)
    yield svg.element("rect", x=left, y=top, width=wide, height=tall, fill="none", stroke=_GREY, stroke_width=1)
    if not len(x):
        return
    across, up = _ticks(x), _ticks(np.concatenate(list(ys)))

    def point(x: float, y: float) -> svg.Point:
        right, high = ((v - ticks[0]) / (ticks[-1] - ticks[0]) for v, ticks in ((x, across), (y, up)))
        return left + right * wide, top + (1 - high) * tall

    for tick in across:
        at = point(tick, up[0])[0], top + tall + 16
        yield svg.words(f"{tick:.6g}", at, font_size=11, fill=_DARK, text_anchor="middle")
    for tick in up:
        y_px = point(across[0], tick)[1]
        yield svg.line([(left, y_px), (left + wide, y_px)], stroke=_GREY, stroke_width=0.5)
        yield svg.words(f"{tick:.6g}", (left - 6, y_px + 4), font_size=11, fill=_DARK, text_anchor="end")
    yield svg.words(below, (left + wide / 2, top + tall + 34), font_size=12, fill=_DARK, text_anchor="middle")
    for values, colour in zip(ys, (_NEAR, _FAR), strict=False):
        points = [point(*pair) for pair in zip(x.tolist(), values.tolist(), strict=True)]
        if len(points) <= _MARKED:
            yield svg.line(points, stroke=colour, stroke_width=1.5)
        yield _dots(points, colour, 4)


def _ticks(values: np.ndarray) -> list[float]:
    """Round numbers from below the smallest value to above the largest."""
    low, high = float(values.min()), float(values.max())
    span = (high - low) or abs(high) or 1.0
    decade = 10 ** math.floor(math.log10(span / _TICKS))
    step = decade * next(times for times in (1, 2, 5, 10) if span / (decade * times) <= _TICKS)
    first, last = math.floor(low / step), math.ceil(high / step)
    return [number * step for number in range(first, max(last, first + 1) + 1)]
