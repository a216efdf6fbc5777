"""Targets for a printer: their drawings in true size as SVG or PDF, with a bar to check the size by.

A page holds one chart with its white margin, and below it a bar of 100 mm and a caption. Bent surfaces print flat: a
cylinder is the sheet to be rolled. Cubes and stairs have a page per face. Curves are cubic Bezier arcs of at most 22.5
degrees, which leave the circle by less than 1e-7 of its radius.
"""

import math
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass

from pipeline.files import svg as svg_file
from pipeline.files.svg import FINE, Point, number
from pipeline.targets.drawing import Checks, Disc, Drawing, Polygon, Shape, Spokes
from pipeline.targets.target import Target

BAR_MM = 100.0
"""Length of the bar that shows the scale of a print [mm]: on a ruler, half a millimetre of it is half a per cent."""
_MARGIN_MM = 10.0
"""Blank edge of a page [mm]: most printers leave some 5 mm blank themselves."""
_BAR_SPACE_MM = 9.0
"""Height of the bar with its caption [mm]: ticks of 4, a gap of 1 below, and room above."""
_TEXT_MM, _LINE_MM = 3.0, 4.2
"""Letter height and line spacing [mm]: 8.5 points, readable at arm's length, and 1.4 times that."""

_PAPERS_MM = {"A4": (210, 297), "A3": (297, 420), "A2": (420, 594), "A1": (594, 841), "A0": (841, 1189)}
"""Sheets of ISO 216, short side first [mm]."""

Curve = tuple[Point, ...]
"""One point: a line to it; three: a Bezier curve by two control points."""


@dataclass(frozen=True, slots=True)
class PrintPath:
    """Closed outlines, filled by the even-odd rule: start and curves of each, page frame, y up [mm]."""

    is_black: bool
    outlines: list[tuple[Point, list[Curve]]]


@dataclass(frozen=True, slots=True)
class PrintPage:
    """A page; origin at its lower left corner, y up [mm]."""

    width_mm: float
    height_mm: float
    paths: list[PrintPath]
    lines: list[tuple[str, Point]]


def pages_of(target: Target, name: str) -> list[PrintPage]:
    """A page for every chart of a target that carries a pattern."""
    pieces = [(patch, pattern) for patch, pattern in target.surface.patches(target.pattern) if pattern]
    extra = "" if target.surface.KIND == "flat" else f", {target.surface.KIND}"
    return [
        _page(
            patch.drawing,
            f"{name}{f' {number + 1}/{len(pieces)}' if len(pieces) > 1 else ''}: {pattern.title()}{extra}"
            f" (sheet {2 * patch.drawing.half_x_mm:g} x {2 * patch.drawing.half_y_mm:g} mm)",
        )
        for number, (patch, pattern) in enumerate(pieces)
    ]


def paper_of(pages: list[PrintPage]) -> str:
    """Number and size of the pages, and the smallest paper that holds the largest of them."""
    short = max(min(page.width_mm, page.height_mm) for page in pages)
    long = max(max(page.width_mm, page.height_mm) for page in pages)
    fits = (name for name, (width, height) in _PAPERS_MM.items() if short <= width and long <= height)
    paper = next(fits, None)
    verdict = f"fits {paper}" if paper else "is larger than A0: a print shop has rolls"
    count = f"{len(pages)} page{'s' * (len(pages) != 1)}"
    return f"{count} of up to {long:.0f} x {short:.0f} mm, which {verdict}; print at 100 %"


def _page(drawing: Drawing, caption: str) -> PrintPage:
    """The page of a chart: from the bottom up the caption, the bar with its length, and the drawing, centred."""
    width = max(2 * drawing.half_x_mm, BAR_MM)
    lines = textwrap.wrap(caption, int(width / (0.55 * _TEXT_MM)))  # a letter is 0.55 of its height wide, in the mean
    foot = len(lines) * _LINE_MM + _BAR_SPACE_MM
    height = 2 * drawing.half_y_mm + 2 * _MARGIN_MM + foot
    centre = width / 2 + _MARGIN_MM, _MARGIN_MM + foot + drawing.half_y_mm
    paths = [
        PrintPath(getattr(shape, "is_black", True), [_moved(outline, centre) for outline in _outlines(shape)])
        for shape in drawing.shapes
    ]
    starts = [(_MARGIN_MM, _MARGIN_MM + (len(lines) - 1 - i) * _LINE_MM) for i in range(len(lines))]
    bottom = _MARGIN_MM + len(lines) * _LINE_MM + 1.0
    length = f"{BAR_MM:g} mm", (_MARGIN_MM + 2.0, bottom + 3.0)
    return PrintPage(width + 2 * _MARGIN_MM, height, [*paths, _bar(bottom)], [*zip(lines, starts, strict=True), length])


def _bar(bottom: float) -> PrintPath:
    """A line of 100 mm between two ticks: its ends are the outer edges of the ticks."""
    left = _MARGIN_MM
    tick = 4.0
    thick = 0.3
    boxes = (
        (left, bottom, left + thick, bottom + tick),
        (left + BAR_MM - thick, bottom, left + BAR_MM, bottom + tick),
        (left + thick, bottom + tick / 2, left + BAR_MM - thick, bottom + tick / 2 + thick),
    )
    return PrintPath(True, [_polygon(((a, b), (c, b), (c, d), (a, d))) for a, b, c, d in boxes])


def _outlines(shape: Shape) -> Iterator[tuple[Point, list[Curve]]]:
    """Closed outlines of a shape: start and curves of each."""
    if isinstance(shape, Polygon):
        yield _polygon(shape.corners)
    elif isinstance(shape, Checks):
        yield from map(_polygon, shape.squares)
    elif isinstance(shape, Disc):
        yield (shape.x + shape.radius, shape.y), _arc((shape.x, shape.y), shape.radius, 0.0, 2 * math.pi)
    else:
        yield from _sectors(shape)


def _polygon(corners: tuple[Point, ...]) -> tuple[Point, list[Curve]]:
    return corners[0], [(corner,) for corner in corners[1:]]


def _sectors(star: Spokes) -> Iterator[tuple[Point, list[Curve]]]:
    """Outlines of the black sectors of a star, which end at an inner circle or in the centre."""
    centre = star.x, star.y
    for first, last in star.sectors:
        start = _on_circle(centre, star.inner, first)
        curves: list[Curve] = [(_on_circle(centre, star.outer, first),), *_arc(centre, star.outer, first, last)]
        if star.inner:
            curves += [(_on_circle(centre, star.inner, last),), *_arc(centre, star.inner, last, first)]
        yield start, curves


def _on_circle(centre: Point, radius: float, angle: float) -> Point:
    return centre[0] + radius * math.cos(angle), centre[1] + radius * math.sin(angle)


def _arc(centre: Point, radius: float, first: float, last: float) -> list[Curve]:
    """Bezier curves along a circle; control points lie 4/3 tan(angle / 4) radii along the tangents."""
    count = max(1, math.ceil(abs(last - first) / (math.pi / 8)))
    step = (last - first) / count
    reach = 4 / 3 * math.tan(step / 4) * radius
    curves: list[Curve] = []
    for i in range(count):
        a = first + i * step
        b = first + (i + 1) * step
        ax, ay = _on_circle(centre, radius, a)
        bx, by = _on_circle(centre, radius, b)
        leaving = ax - reach * math.sin(a), ay + reach * math.cos(a)
        arriving = bx + reach * math.sin(b), by - reach * math.cos(b)
        curves.append((leaving, arriving, (bx, by)))
    return curves


def _moved(outline: tuple[Point, list[Curve]], shift_mm: Point) -> tuple[Point, list[Curve]]:
    start, curves = outline
    shifted = [tuple((x + shift_mm[0], y + shift_mm[1]) for x, y in curve) for curve in curves]
    return (start[0] + shift_mm[0], start[1] + shift_mm[1]), shifted


def svg(pages: list[PrintPage]) -> str:
    """The pages below one another as the text of an SVG file, one user unit per millimetre."""
    width = max(page.width_mm for page in pages)
    height = sum(page.height_mm for page in pages)
    items = []
    top = 0.0
    for page in pages:
        top += page.height_mm
        items += [_svg_path(path, top) for path in page.paths]
        items += [
            svg_file.words(words, (x, top - y), font_family="Helvetica, Arial, sans-serif", font_size=_TEXT_MM)
            for words, (x, y) in page.lines
        ]
    return svg_file.document((width, height), *items, unit="mm")


def _svg_path(path: PrintPath, top: float) -> str:
    steps: list[tuple[str, Curve]] = []
    for start, curves in path.outlines:
        steps += [("M", (start,)), *(("L" if len(curve) == 1 else "C", curve) for curve in curves), ("Z", ())]
    placed = [(letter, [(x, top - y) for x, y in points]) for letter, points in steps]
    colour = "#000000" if path.is_black else "#ffffff"
    return svg_file.path(placed, FINE, fill=colour, fill_rule="evenodd")


def pdf_content(page: PrintPage) -> str:
    """Drawing operators of a PDF page whose unit is the millimetre."""
    parts = []
    for path in page.paths:
        parts.append("0 g" if path.is_black else "1 g")
        for start, curves in path.outlines:
            parts.append(f"{number(start[0])} {number(start[1])} m")
            for curve in curves:
                letter = "l" if len(curve) == 1 else "c"
                parts.append(" ".join(f"{number(x)} {number(y)}" for x, y in curve) + f" {letter}")
            parts.append("h")
        parts.append("f*")
    for words, (x, y) in page.lines:
        escaped = words.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")
        parts.append(f"0 g BT /F1 {_TEXT_MM:g} Tf {number(x)} {number(y)} Td ({escaped}) Tj ET")
    return "\n".join(parts)
