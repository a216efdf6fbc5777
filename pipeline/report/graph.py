"""The picture of a graph of tasks: columns by level, an arrow for what is read, as SVG without a browser."""

from collections.abc import Sequence
from html import escape
from typing import Protocol

from pipeline.report.layers import GAP, HEIGHT, WIDTH, Line, Point, layout

_MARGIN = 20.0
"""Blank edge of the drawing [px]."""


class Node(Protocol):
    """A node that is drawn: see `engine.planning.collapsed_graph.Group`."""

    name: str
    reads: list[str]

    @property
    def label(self) -> tuple[str, str]: ...

    @property
    def colour(self) -> str: ...


def svg(groups: Sequence[Node], title: str) -> str:
    """One SVG document of nodes in an order in which sources come first."""
    places = layout({group.name: group.reads for group in groups})
    width, height = 2 * _MARGIN + max(places.width, WIDTH), 3 * _MARGIN + places.height
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:g}" height="{height:g}" font-family="sans-serif">',
        '<defs><marker id="a" markerWidth="8" markerHeight="8" refX="7" refY="4" orient="auto">'
        '<path d="M0,0 L8,4 L0,8 z" fill="#666"/></marker></defs>',
        '<rect width="100%" height="100%" fill="white"/>',
        f'<text x="{_MARGIN:g}" y="{_MARGIN + 4:g}" font-size="13">{escape(title)}</text>',
        f'<g transform="translate({_MARGIN:g},{2 * _MARGIN:g})">',
    ]
    lines += [_path(f"M{_at(start)} L{_at(end)}") for start, end in places.lanes]
    lines += [_path(_curve(line)) for line in places.links]
    lines += [_path(_curve(line), ' marker-end="url(#a)"') for line in places.arrows]
    lines += [_box(group, *places.boxes[group.name]) for group in groups]
    return "\n".join([*lines, "</g>", "</svg>"]) + "\n"


def _curve(line: Line) -> str:
    """Level at both ends, and within the gap between its ends; out and back where both are on one side."""
    (x0, y0), (x1, y1) = line
    bend = 0.6 * GAP
    back = bend if x1 > x0 else -bend
    return f"M{_at((x0, y0))} C{_at((x0 + (bend if x1 >= x0 else -bend), y0))} {_at((x1 - back, y1))} {_at((x1, y1))}"


def _at(point: Point) -> str:
    return f"{point[0]:.1f},{point[1]:.1f}"


def _path(data: str, marker: str = "") -> str:
    return f'<path d="{data}" fill="none" stroke="#666"{marker}/>'


def _box(group: Node, x: float, y: float) -> str:
    name, states = (escape(part) for part in group.label)
    size = f'x="{x:.1f}" y="{y:.1f}" width="{WIDTH:g}" height="{HEIGHT:g}" rx="5"'
    return (
        f'<rect {size} fill="{group.colour}" stroke="#444"/>'
        f'<text x="{x + 8:.1f}" y="{y + 18:.1f}" font-size="12">{name}</text>'
        f'<text x="{x + 8:.1f}" y="{y + 35:.1f}" font-size="11" fill="#555">{states}</text>'
    )
