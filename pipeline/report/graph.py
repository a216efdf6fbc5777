"""The picture of a graph of tasks as SVG without a browser: boxes in columns by level, an arrow for what is read.

Lines pass between boxes and never behind one. After Sugiyama, Tagawa and Toda, "Methods for visual understanding of
hierarchical system structures" (1981): a line that passes a column has a lane there, which takes room as a box does,
and boxes and lanes of a column are ordered by the means of their neighbours. All lines from one box share their lanes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Protocol

from pipeline.files import svg as svg_file
from pipeline.files.svg import Point

_MARGIN = 20.0
"""Blank edge of the drawing [px]."""
_GREY, _ARROW = "#666666", "arrow"
Line = tuple[Point, Point]

WIDTH, HEIGHT, GAP = 210.0, 44.0, 60.0
"""Size of a box, and room between columns [px]."""
_BOX_GAP, _LANE_GAP, _SWEEPS = 18.0, 10.0, 8
"""Room between boxes and between lines of a column [px], and how often columns are sorted by their neighbours, to the
right and back: each sweep mends what the one before has moved, and the last ones move little."""


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


@dataclass(frozen=True, slots=True)
class Layout:
    """Left upper corners of boxes; lanes across columns; lines from one column to the next, an arrow to a box [px]."""

    boxes: dict[str, Point]
    lanes: list[Line]
    links: list[Line]
    arrows: list[Line]
    width: float
    height: float


@dataclass(slots=True, eq=False)
class _Place:
    """A box, or the lane of one in a column."""

    column: int
    is_box: bool
    left_neighbours: list["_Place"] = field(default_factory=list)
    right_neighbours: list["_Place"] = field(default_factory=list)
    y: float = 0.0  # of its middle

    @property
    def left(self) -> Point:
        return self.column * (WIDTH + GAP), self.y

    @property
    def right(self) -> Point:
        return self.left[0] + WIDTH, self.y

    @property
    def half(self) -> float:
        """Half its height, and half the gap to the next."""
        return (HEIGHT + _BOX_GAP) / 2 if self.is_box else _LANE_GAP / 2


class _Columns:
    def __init__(self, reads: Mapping[str, Sequence[str]]) -> None:
        self.columns: list[list[_Place]] = []
        self.boxes: dict[str, _Place] = {}
        self._lanes: dict[tuple[str, bool, int], _Place] = {}
        self.arrows: list[tuple[_Place, _Place]] = []
        levels = dict[str, int]()
        for name, sources in reads.items():
            levels[name] = max((levels[source] + 1 for source in sources if source in levels), default=0)
            self.boxes[name] = self._new(levels[name], is_box=True)
        for name, sources in reads.items():
            for source in sources:
                self._join(source, name)

    def _new(self, column: int, *, is_box: bool) -> _Place:
        while len(self.columns) <= column:
            self.columns.append([])
        self.columns[column].append(_Place(column, is_box))
        return self.columns[column][-1]

    def _join(self, source: str, name: str) -> None:
        """The way of a line from box to box, over lanes in the columns between them; it may go back."""
        start, end = self.boxes[source], self.boxes[name]
        step = 1 if start.column < end.column else -1
        way = [start, *(self._lane(source, step, c) for c in range(start.column + step, end.column, step)), end]
        self.arrows.append((way[-2], way[-1]))
        for here, other in pairwise(way):
            if here.column == other.column:
                continue
            left, right = (here, other) if step > 0 else (other, here)
            if right not in left.right_neighbours:
                left.right_neighbours.append(right)
                right.left_neighbours.append(left)

    def _lane(self, source: str, step: int, column: int) -> _Place:
        key = source, step > 0, column
        if key not in self._lanes:
            self._lanes[key] = self._new(column, is_box=False)
        return self._lanes[key]


def layout(reads: Mapping[str, Sequence[str]]) -> Layout:
    """Place boxes, sources to the left; `reads` has sources first, and a line from a later name goes back."""
    graph = _Columns(reads)
    for column in graph.columns:
        _stack(column)
    for _ in range(_SWEEPS):
        for column in graph.columns[1:]:
            _sort(column, "left_neighbours")
        for column in graph.columns[-2::-1]:
            _sort(column, "right_neighbours")
    top = min((place.y - HEIGHT / 2 for column in graph.columns for place in column), default=0.0)
    for column in graph.columns:
        for place in column:
            place.y -= top
    places = [place for column in graph.columns for place in column]
    arrows = {_line(*pair) for pair in graph.arrows}
    joined = {(place.right, other.left) for place in places for other in place.right_neighbours}
    return Layout(
        boxes={name: (place.left[0], place.y - HEIGHT / 2) for name, place in graph.boxes.items()},
        lanes=[(place.left, place.right) for place in places if not place.is_box],
        links=sorted(joined - arrows - {(end, start) for start, end in arrows}),
        arrows=sorted(arrows),
        width=max(len(graph.columns) * (WIDTH + GAP) - GAP, 0.0),
        height=max((place.y + HEIGHT / 2 for place in places), default=0.0),
    )


def _line(start: _Place, end: _Place) -> Line:
    """Ends of an arrow, each at the near side of its box."""
    if start.column < end.column:
        return start.right, end.left
    return (start.left if start.column > end.column else start.right), end.right


def _stack(column: list[_Place]) -> None:
    y = 0.0
    for place in column:
        place.y = y + place.half
        y += 2 * place.half


def _sort(column: list[_Place], side: str) -> None:
    """Order a column by the middles of its neighbours on one side, then bring each as near to them as there is room."""
    from scipy.optimize import isotonic_regression  # only what draws a graph waits for it

    wanted = {}
    for place in column:
        neighbours = getattr(place, side)
        wanted[place] = sum(other.y for other in neighbours) / len(neighbours) if neighbours else place.y
    column.sort(key=lambda place: wanted[place])
    _stack(column)
    # Moves from the stack, each at least that of the place above it: no two overlap.
    moves = isotonic_regression([wanted[place] - place.y for place in column]).x
    for place, move in zip(column, moves.tolist(), strict=True):
        place.y += move
