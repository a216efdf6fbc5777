"""SVG text: elements with their attributes, and the document around them.

Coordinates are in user units, y downwards: pixels of a drawing, millimetres of a print.
"""

from collections.abc import Iterable
from html import escape

Point = tuple[float, float]

FINE = 6
"""Decimals of numbers whose unit is the millimetre, and of attributes: a nanometre."""
COARSE = 2
"""Decimals of coordinates whose unit is the pixel: finer than the eye, and half as many bytes."""


def number(value: float, decimals: int = FINE) -> str:
    """A number without trailing zeros, and 0 without a sign."""
    text = f"{value:.{decimals}f}"
    text = text.rstrip("0").rstrip(".") if decimals else text
    return "0" if text == "-0" else text


def element(name: str, *inside: str, **attributes: str | float) -> str:
    """An element with its children; attribute names have - for _, text is escaped, numbers have `FINE` decimals."""
    written = (value if isinstance(value, str) else number(value) for value in attributes.values())
    pairs = zip(attributes, written, strict=True)
    attribute_text = "".join(f' {key.replace("_", "-")}="{escape(text)}"' for key, text in pairs)
    content = "\n".join(inside)
    return f"<{name}{attribute_text}>{content}</{name}>" if inside else f"<{name}{attribute_text}/>"


def words(text: str, at: Point, **style: str | float) -> str:
    """Text that begins at a point (`text_anchor` says otherwise), with special characters escaped."""
    return element("text", escape(text), x=round(at[0], COARSE), y=round(at[1], COARSE), **style)


def line(points: Iterable[Point], **style: str | float) -> str:
    """An open line through points."""
    return element("polyline", points=_listed(points, COARSE), fill="none", **style)


def area(points: Iterable[Point], **style: str | float) -> str:
    """A polygon."""
    return element("polygon", points=_listed(points, COARSE), **style)


def path(steps: Iterable[tuple[str, Iterable[Point]]], decimals: int = COARSE, /, **style: str | float) -> str:
    """A path of steps: the letter of each (M, L, C, Z) and its points."""
    return element("path", d="".join(letter + _listed(points, decimals) for letter, points in steps), **style)


def document(size: Point, *items: str, unit: str = "", **attributes: str | float) -> str:
    """The text of an SVG file of this width and height, on white; `unit` is that of paper, none the pixel."""
    width, height = map(number, size)
    extent = {"width": width + unit, "height": height + unit, "viewBox": f"0 0 {width} {height}"}
    paper = element("rect", width="100%", height="100%", fill="#ffffff")
    return element("svg", "", paper, *items, "", xmlns="http://www.w3.org/2000/svg", **extent, **attributes) + "\n"


def _listed(points: Iterable[Point], decimals: int) -> str:
    return " ".join(f"{number(x, decimals)},{number(y, decimals)}" for x, y in points)
