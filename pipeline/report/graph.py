"""The picture of a graph of tasks as SVG without a browser: a column of boxes, and arcs from each to all that read it.

Boxes are in the order of the work, so that most arcs lead down; the farther an arc leads, the wider it bends.
"""

from collections.abc import Iterator, Sequence

from pipeline.engine.planning.collapsed_graph import Node
from pipeline.files import svg as svg_file

_MARGIN = 20.0
"""Blank edge of the drawing [px]."""
_GREY, _ARROW = "#666666", "arrow"
WIDTH, HEIGHT, GAP = 210.0, 44.0, 18.0
"""Size of a box, and room between boxes [px]."""
_NEAREST, _STEP, _WIDEST = 24.0, 16.0, 320.0
"""Bend of an arc to the next box, what each further box adds, and the widest bend [px]: thousands of tasks fit."""


def svg(groups: Sequence[Node], title: str) -> str:
    """One SVG document of nodes in an order in which sources come first."""
    rows = {group.name: number for number, group in enumerate(groups)}
    arcs = [(rows[source], rows[group.name]) for group in groups for source in group.reads if source in rows]
    tip = svg_file.path([("M", [(0, 0)]), ("L", [(8, 4)]), ("L", [(0, 8)]), ("Z", [])], fill=_GREY)
    size = {"markerWidth": 8, "markerHeight": 8, "refX": 7, "refY": 4}
    drawn = [*(_arc(start, end) for start, end in arcs), *(part for group in groups for part in _box(group, rows))]
    across = WIDTH + 0.75 * max((_bend(*arc) for arc in arcs), default=0.0)  # a cubic arc reaches that share
    return svg_file.document(
        (2 * _MARGIN + across, 3 * _MARGIN + len(groups) * (HEIGHT + GAP) - GAP),
        svg_file.element("defs", svg_file.element("marker", tip, id=_ARROW, orient="auto", **size)),
        svg_file.words(title, (_MARGIN, _MARGIN + 4), font_size=13),
        svg_file.element("g", "", *drawn, "", transform=f"translate({_MARGIN:g},{2 * _MARGIN:g})"),
        font_family="sans-serif",
    )


def _bend(start: int, end: int) -> float:
    return min(_NEAREST + _STEP * (abs(end - start) - 1), _WIDEST)


def _arc(start: int, end: int) -> str:
    """An arrow between the right sides of the boxes in two rows."""
    bend = WIDTH + _bend(start, end)
    here, there = (row * (HEIGHT + GAP) + HEIGHT / 2 for row in (start, end))
    steps = [("M", [(WIDTH, here)]), ("C", [(bend, here), (bend, there), (WIDTH, there)])]
    return svg_file.path(steps, fill="none", stroke=_GREY, marker_end=f"url(#{_ARROW})")


def _box(group: Node, rows: dict[str, int]) -> Iterator[str]:
    name, states = group.label
    y = rows[name] * (HEIGHT + GAP)
    yield svg_file.element("rect", fill=group.colour, stroke="#444444", x=0.0, y=y, width=WIDTH, height=HEIGHT, rx=5)
    yield svg_file.words(name, (8, y + 18), font_size=12)
    yield svg_file.words(states, (8, y + 35), font_size=11, fill="#555555")
