"""A layered layout of a graph: boxes in columns, lines that pass between boxes and never behind one.

After Sugiyama, Tagawa and Toda, "Methods for visual understanding of hierarchical system structures" (1981): a line
that passes a column has a lane there, which takes room as a box does, and boxes and lanes of a column are ordered by
the means of their neighbours. All lines from one box share their lanes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

Point = tuple[float, float]
Line = tuple[Point, Point]

WIDTH, HEIGHT, GAP = 210.0, 44.0, 60.0
"""Size of a box, and room between columns [px]."""
_BOX_GAP, _LANE_GAP, _SWEEPS = 18.0, 10.0, 8
"""Room between boxes and between lines of a column [px], and how often columns are sorted by their neighbours, to the
right and back: each sweep mends what the one before has moved, and the last ones move little."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Places of things, in pixels from the left upper corner.

    `boxes`: name -> left upper corner.
    `lanes`: level, across a column.
    `links`, `arrows`: lines from one column to the next, in the gap between them; an arrow ends at a box.
    `width`, `height`: size of the whole drawing.
    """

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
    left_ones: list["_Place"] = field(default_factory=list)
    right_ones: list["_Place"] = field(default_factory=list)
    y: float = 0.0
    """Place of its middle."""

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
    """All places, and which are joined."""

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
            if right not in left.right_ones:
                left.right_ones.append(right)
                right.left_ones.append(left)

    def _lane(self, source: str, step: int, column: int) -> _Place:
        key = source, step > 0, column
        if key not in self._lanes:
            self._lanes[key] = self._new(column, is_box=False)
        return self._lanes[key]


def layout(reads: Mapping[str, Sequence[str]]) -> Layout:
    """Place boxes, sources to the left.

    `reads` has the names that each reads, in an order in which sources come first; a line from a later name goes back.
    """
    graph = _Columns(reads)
    for column in graph.columns:
        _stack(column)
    for _ in range(_SWEEPS):
        for column in graph.columns[1:]:
            _sort(column, "left_ones")
        for column in graph.columns[-2::-1]:
            _sort(column, "right_ones")
    top = min((place.y - HEIGHT / 2 for column in graph.columns for place in column), default=0.0)
    for column in graph.columns:
        for place in column:
            place.y -= top
    places = [place for column in graph.columns for place in column]
    arrows = {_line(*pair) for pair in graph.arrows}
    joined = {(one.right, other.left) for one in places for other in one.right_ones}
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
    """One below the other."""
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
