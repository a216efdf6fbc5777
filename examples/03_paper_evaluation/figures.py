"""Bars with error whiskers and dots for shares, drawn like the paper's figures; Pillow and nothing else."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from pipeline.files.png import write_png

COLOURS = ((68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (240, 200, 30))
INK, FAINT = (20, 20, 20), (222, 222, 222)
_SCALE = 2
"""Drawn so many times larger, then shrunk: edges become smooth."""
_WIDTH, _HEIGHT = 620, 330
_LEFT, _RIGHT, _TOP, _BOTTOM = 62, 58, 34, 42


@dataclass(frozen=True, slots=True, kw_only=True)
class Panel:
    """One diagram: groups of bars, one bar per series.

    Attributes
    ----------
    title, left_label, right_label : str
    groups, series : tuple of str
        Along x, and by colour.
    bars, errors : (groups, series) float64
        Heights and half lengths of whiskers; NaN draws nothing.
    dots : (groups, series) float64
        Drawn against the right axis, which ends at `dot_top`.
    square : bool
        Dots are squares.
    dot_top : float
    percent : bool
        The right axis counts per cent.
    """

    title: str
    left_label: str
    right_label: str
    groups: tuple[str, ...]
    series: tuple[str, ...]
    bars: np.ndarray
    errors: np.ndarray
    dots: np.ndarray
    dot_top: float = 1.0
    square: bool = False
    percent: bool = True


def draw(file: Path, panels: list[Panel], columns: int) -> None:
    """Panels in rows of so many, with one legend below."""
    rows = -(-len(panels) // columns)
    sheet = _Sheet(columns * _WIDTH, rows * _HEIGHT + 30)
    for number, panel in enumerate(panels):
        _panel(sheet, panel, number % columns * _WIDTH, number // columns * _HEIGHT)
    _legend(sheet, panels[0].series, rows * _HEIGHT + 8)
    sheet.save(file)


def _panel(sheet: "_Sheet", panel: Panel, left: float, top: float) -> None:
    x0, x1, y0, y1 = left + _LEFT, left + _WIDTH - _RIGHT, top + _TOP, top + _HEIGHT - _BOTTOM
    highest = np.nanmax(panel.bars + np.nan_to_num(panel.errors), initial=1e-6)
    step = _step(float(highest))
    full = step * np.ceil(highest / step * 1.02)
    for value in np.arange(0, full + step / 2, step):
        y = y1 - (y1 - y0) * value / full
        sheet.line((x0, y, x1, y), FAINT)
        sheet.text(x0 - 6, y, f"{value:g}" if value < 1e6 else "", "rm", 11)
    for share in np.linspace(0, 1, 6):
        value = share * panel.dot_top
        sheet.text(x1 + 6, y1 - (y1 - y0) * share, f"{value:.0%}" if panel.percent else f"{value:.3g}", "lm", 11)
    for g, group in enumerate(panel.groups):
        width = (x1 - x0) / len(panel.groups)
        _group(sheet, panel, g, (x0 + g * width, width), (y0, y1), full)
        sheet.text(x0 + (g + 0.5) * width, y1 + 12, group, "mm", 12)
    sheet.box((x0, y0, x1, y1), INK)
    sheet.text((x0 + x1) / 2, top + 16, panel.title, "mm", 13)
    sheet.text(x0 - 46, y0 - 13, panel.left_label, "lm", 11)
    sheet.text(x1 + 50, y0 - 13, panel.right_label, "rm", 11)


def _group(
    sheet: "_Sheet", panel: Panel, g: int, along: tuple[float, float], up: tuple[float, float], full: float
) -> None:
    (x, width), (y0, y1) = along, up
    bar = 0.8 * width / len(panel.series)
    for s in range(len(panel.series)):
        a, value, error = x + 0.1 * width + s * bar, panel.bars[g, s], panel.errors[g, s]
        middle = a + bar / 2
        if not np.isnan(value):
            sheet.fill((a + 0.5, y1 - (y1 - y0) * value / full, a + bar - 0.5, y1), COLOURS[s % len(COLOURS)])
        if not np.isnan(error):
            low, high = (y1 - (y1 - y0) * max(v, 0.0) / full for v in (value - error, value + error))
            sheet.line((middle, low, middle, high), INK)
            for y in (low, high):
                sheet.line((middle - 3, y, middle + 3, y), INK)
        if not np.isnan(panel.dots[g, s]):
            y = y1 - (y1 - y0) * min(panel.dots[g, s] / panel.dot_top, 1.0)
            sheet.mark(middle, y, panel.square)


def _legend(sheet: "_Sheet", series: tuple[str, ...], y: float) -> None:
    x = 70.0
    for s, name in enumerate(series):
        sheet.fill((x, y, x + 14, y + 12), COLOURS[s % len(COLOURS)])
        sheet.text(x + 20, y + 6, name, "lm", 12)
        x += 50 + 7 * len(name)


def _step(highest: float) -> float:
    """A round step that gives four to eight marks."""
    power = 10 ** np.floor(np.log10(highest / 5))
    return float(next(power * factor for factor in (1, 2, 5, 10) if highest / (power * factor) <= 7))


class _Sheet:
    """A picture drawn in points of its final size."""

    def __init__(self, width: float, height: float) -> None:
        size = round(width * _SCALE), round(height * _SCALE)
        self.image = Image.new("RGB", size, "white")
        self.pen = ImageDraw.Draw(self.image)

    def line(self, ends: tuple[float, ...], colour: tuple[int, int, int]) -> None:
        self.pen.line([v * _SCALE for v in ends], fill=colour, width=_SCALE)

    def box(self, corners: tuple[float, ...], colour: tuple[int, int, int]) -> None:
        self.pen.rectangle([v * _SCALE for v in corners], outline=colour, width=_SCALE)

    def fill(self, corners: tuple[float, ...], colour: tuple[int, int, int]) -> None:
        self.pen.rectangle([v * _SCALE for v in corners], fill=colour)

    def mark(self, x: float, y: float, square: bool) -> None:
        corners = [(v + d) * _SCALE for d in (-3.2, 3.2) for v in (x, y)]
        paint = self.pen.rectangle if square else self.pen.ellipse
        paint(corners, fill=INK, outline="white")

    def text(self, x: float, y: float, words: str, anchor: str, size: float) -> None:
        font = ImageFont.load_default(size * _SCALE)
        self.pen.text((x * _SCALE, y * _SCALE), words, fill=INK, font=font, anchor=anchor)

    def save(self, file: Path) -> None:
        width, height = self.image.size
        write_png(file, np.array(self.image.resize((width // _SCALE, height // _SCALE), Image.Resampling.LANCZOS)))
