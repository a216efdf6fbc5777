"""The picture of a graph of tasks: columns by level, an arrow for what is read, as SVG without a browser."""

from collections.abc import Sequence
from typing import Protocol

from pipeline.files import svg as svg_file
from pipeline.report.layers import GAP, HEIGHT, WIDTH, Line, Point, layout

_MARGIN = 20.0
"""Blank edge of the drawing [px]."""
_GREY, _ARROW = "#666666", "arrow"


class Node(Protocol):
    """A node that is drawn: see `engine.planning.collapsed_graph.Node`."""

    name: str
    reads: list[str]

    @property
    def label(self) -> tuple[str, str]: ...

    @property
    def colour(self) -> str: ...


def svg(groups: Sequence[Node], title: str) -> str:
    """One SVG document of nodes in an order in which sources come first."""
    places = layout({group.name: group.reads for group in groups})
    tip = svg_file.path([("M", [(0, 0)]), ("L", [(8, 4)]), ("L", [(0, 8)]), ("Z", [])], fill=_GREY)
    size = {"markerWidth": 8, "markerHeight": 8, "refX": 7, "refY": 4}
    arrow = svg_file.element("marker", tip, id=_ARROW, orient="auto", **size)
    drawn = [
        *(_link([("M", [start]), ("L", [end])]) for start, end in places.lanes),
        *(_link(_curve(line)) for line in places.links),
        *(_link(_curve(line), marker_end=f"url(#{_ARROW})") for line in places.arrows),
        *(item for group in groups for item in _box(group, *places.boxes[group.name])),
    ]
    return svg_file.document(
        (2 * _MARGIN + max(places.width, WIDTH), 3 * _MARGIN + places.height),
        svg_file.element("defs", arrow),
        svg_file.words(title, (_MARGIN, _MARGIN + 4), font_size=13),
        svg_file.element("g", "", *drawn, "", transform=f"translate({_MARGIN:g},{2 * _MARGIN:g})"),
        font_family="sans-serif",
    )


def _curve(line: Line) -> list[tuple[str, list[Point]]]:
    """Level at both ends, and within the gap between its ends; out and back where both are on one side."""
    (x0, y0), (x1, y1) = line
    bend = 0.6 * GAP
    back = bend if x1 > x0 else -bend
    return [("M", [(x0, y0)]), ("C", [(x0 + (bend if x1 >= x0 else -bend), y0), (x1 - back, y1), (x1, y1)])]


def _link(steps: list[tuple[str, list[Point]]], **style: str) -> str:
    return svg_file.path(steps, fill="none", stroke=_GREY, **style)


def _box(group: Node, x: float, y: float) -> list[str]:
    name, states = group.label
    size = {"x": x, "y": y, "width": WIDTH, "height": HEIGHT, "rx": 5}
    return [
        svg_file.element("rect", fill=group.colour, stroke="#444444", **size),
        svg_file.words(name, (x + 8, y + 18), font_size=12),
        svg_file.words(states, (x + 8, y + 35), font_size=11, fill="#555555"),
    ]
