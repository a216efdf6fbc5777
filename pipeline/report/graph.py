"""The picture of a graph of tasks: columns by level, an arrow for what is read, as SVG without a browser."""

from html import escape
from typing import Protocol

_WIDTH, _HEIGHT, _GAP_X, _GAP_Y, _MARGIN = 210, 44, 60, 18, 20  # px


class Node(Protocol):
    """What is drawn: see `engine.overview.Group`."""

    name: str
    reads: list[str]
    level: int

    @property
    def label(self) -> tuple[str, str]: ...

    @property
    def colour(self) -> str: ...


def svg(groups: "list[Node] | list", title: str) -> str:
    """One SVG document."""
    places: dict[str, tuple[float, float]] = {}
    rows: dict[int, int] = {}
    for group in groups:
        row = rows[group.level] = rows.get(group.level, -1) + 1
        places[group.name] = (_MARGIN + group.level * (_WIDTH + _GAP_X), 2 * _MARGIN + row * (_HEIGHT + _GAP_Y))
    width = 2 * _MARGIN + (max(rows, default=0) + 1) * (_WIDTH + _GAP_X) - _GAP_X
    height = 3 * _MARGIN + (max(rows.values(), default=0) + 1) * (_HEIGHT + _GAP_Y)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" font-family="sans-serif">',
        '<defs><marker id="a" markerWidth="8" markerHeight="8" refX="7" refY="4" orient="auto">'
        '<path d="M0,0 L8,4 L0,8 z" fill="#666"/></marker></defs>',
        '<rect width="100%" height="100%" fill="white"/>',
        f'<text x="{_MARGIN}" y="{_MARGIN + 4}" font-size="13">{escape(title)}</text>',
    ]
    for group in groups:
        x, y = places[group.name]
        lines += [_arrow(places[read], (x, y)) for read in group.reads]
    for group in groups:
        lines.append(_box(group, *places[group.name]))
    return "\n".join([*lines, "</svg>"]) + "\n"


def _arrow(source: tuple[float, float], target: tuple[float, float]) -> str:
    x0, y0, x1, y1 = source[0] + _WIDTH, source[1] + _HEIGHT / 2, target[0], target[1] + _HEIGHT / 2
    bend = _GAP_X * 0.6
    path = f"M{x0},{y0} C{x0 + bend},{y0} {x1 - bend},{y1} {x1},{y1}"
    return f'<path d="{path}" fill="none" stroke="#666" marker-end="url(#a)"/>'


def _box(group: Node, x: float, y: float) -> str:
    name, states = (escape(part) for part in group.label)
    size = f'x="{x}" y="{y}" width="{_WIDTH}" height="{_HEIGHT}" rx="5"'
    return (
        f'<rect {size} fill="{group.colour}" stroke="#444"/>'
        f'<text x="{x + 8}" y="{y + 18}" font-size="12">{name}</text>'
        f'<text x="{x + 8}" y="{y + 35}" font-size="11" fill="#555">{states}</text>'
    )
