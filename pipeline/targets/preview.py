"""Preview of a target as coloured faces for viewers: its sheet in true size, cut where the colour changes.

Upright rectangles and checks are exact. Round and slanted shapes are made of small upright rectangles, curved
surfaces of small flat ones with corners on the surface (on straight lines between the heights of a height map).
Nothing is compiled and no library is loaded, because a plan makes previews, too.
"""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pipeline.frames import apply
from pipeline.records.shapes import Float64, Int64
from pipeline.targets.drawing import Checks, Disc, Drawing, Polygon, Shape, Spokes, bounds
from pipeline.targets.surfaces import CYLINDER, PLANE, Patch
from pipeline.targets.target import Target

_DISC_STEPS, _SIDE_STEPS = 16, 10
"""Rectangles across a disc, and along a slanted side of a polygon: enough for looking; no number depends on them."""
_SPOKE_STEPS, _MOST_SPOKE_STEPS = 4, 160
"""Rectangles per spoke across a star, and the most: enough for looking."""
_AROUND, _ACROSS = 64, 24
"""Least number of faces around a cylinder, and along each direction of a bent board."""
_MOST_CELLS, _MOST_SHAPES = 100_000, 20_000
"""Most cells and shapes of a patch; a patch with more is shown as a blank sheet of the mean of its two colours."""
_SAME = 7
"""Digits, relative to the half sheet, to which lines of different shapes are equal: between rounding and any gap."""


@dataclass(frozen=True, slots=True)
class PreviewFaces:
    """Quadrilaterals in the target frame."""

    points_mm: Float64[np.ndarray, "n 3"]
    faces: Int64[np.ndarray, "m 4"]  # corners, anticlockwise as seen from the front
    radiance: Float64[np.ndarray, "m"]  # relative radiance of each face
    # place of each point on the picture of all patches side by side, from (0, 0), lower left, to (1, 1)
    sheet: Float64[np.ndarray, "n 2"]


def preview_faces(target: Target) -> PreviewFaces:
    patches = target.patches()
    pieces = [_faces(patch) for patch in patches]
    first = np.cumsum([0, *(len(piece.points_mm) for piece in pieces)])
    placed = [apply(patch.target_from_patch, piece.points_mm) for patch, piece in zip(patches, pieces, strict=True)]
    sheets = [(piece.sheet + np.array([number, 0])) / (len(pieces), 1) for number, piece in enumerate(pieces)]
    return PreviewFaces(
        points_mm=np.concatenate(placed),
        faces=np.concatenate([piece.faces + start for piece, start in zip(pieces, first, strict=False)]),
        radiance=np.concatenate([piece.radiance for piece in pieces]),
        sheet=np.concatenate(sheets),
    )


_WIDEST_PX = 1 << 14
"""Most pixels along the picture of all patches [px]: viewers show no wider texture, and stairs may have thousands."""


def preview_picture(target: Target, size_px: int) -> np.ndarray:
    """Relative radiance of all patches side by side, (size_px, size_px * patches), or smaller for many; the first row
    is the top.
    """
    pictures, patches = [], target.patches()
    size_px = max(1, min(size_px, _WIDEST_PX // len(patches)))
    for patch in patches:
        black, white = patch.colours
        share = (np.arange(size_px) + 0.5) / size_px
        x, y = ((2 * share - 1) * half for half in (patch.drawing.half_x_mm, patch.drawing.half_y_mm))
        pictures.append(np.where(_is_black(patch.drawing, x, y), black, white)[::-1])
    return np.hstack(pictures)


def _faces(patch: Patch) -> PreviewFaces:
    """Faces of one patch, in its own frame."""
    black, white = patch.colours
    half = np.array([patch.drawing.half_x_mm, patch.drawing.half_y_mm])
    x, y = half[:, None] * [-1.0, 1.0]
    light = np.full((1, 1), (black + white) / 2)
    checks = sum((shape.columns + 1) * (shape.rows + 1) for shape in patch.drawing.shapes if isinstance(shape, Checks))
    if checks <= _MOST_CELLS and len(patch.drawing.shapes) <= _MOST_SHAPES:
        columns, rows = _lines(patch.drawing, 0), _lines(patch.drawing, 1)
        if len(columns) * len(rows) <= _MOST_CELLS:
            x, y = columns, rows
            light = np.where(_is_black(patch.drawing, _middles(x), _middles(y)), black, white)
    if patch.kind == PLANE:
        rectangles, colours = _merged(light)
    else:
        is_cylinder = patch.kind == CYLINDER
        x, columns = _finer(x, _AROUND if is_cylinder else _ACROSS)
        y, rows = _finer(y, 1 if is_cylinder else _ACROSS)
        light = light[np.ix_(rows, columns)]
        row, column = np.indices(light.shape).reshape(2, -1)
        rectangles, colours = np.stack([column, row, column + 1, row + 1], axis=1), light.ravel()
    left, bottom, right, top = rectangles.T
    corners = np.stack([bottom, bottom, top, top], axis=1) * len(x) + np.stack([left, right, right, left], axis=1)
    used, faces = np.unique(corners, return_inverse=True)
    xy = np.stack([x[used % len(x)], y[used // len(x)]], axis=1)
    return PreviewFaces(_placed(patch, xy), faces.reshape(-1, 4), colours, xy / half / 2 + 0.5)


def _lines(drawing: Drawing, axis: int) -> np.ndarray:
    """Borders of cells along x (0) or y (1), including both edges of the sheet, (n,)."""
    half = (drawing.half_x_mm, drawing.half_y_mm)[axis]
    borders = [np.array([-half, half]), *(_lines_of(shape, axis) for shape in drawing.shapes)]
    lines = np.clip(np.concatenate(borders), -half, half)
    _, first = np.unique((lines / half).round(_SAME), return_index=True)
    return np.asarray(lines[first])


def _lines_of(shape: Shape, axis: int) -> np.ndarray:
    if isinstance(shape, Checks):
        count = (shape.columns, shape.rows)[axis] + 2
        return (np.arange(count) - (count - 1) / 2) * shape.square
    if isinstance(shape, Polygon):
        corners = np.array(shape.corners)
        ends = np.roll(corners, 1, axis=0)
        sides = np.abs(corners - ends)
        is_slanted = sides.min(axis=1) > 1e-9 * sides.max()
        between = np.linspace(corners[is_slanted, axis], ends[is_slanted, axis], _SIDE_STEPS + 1)
        return np.concatenate([corners[:, axis], between.ravel()])
    centre = (shape.x, shape.y)[axis]
    if isinstance(shape, Disc):
        return centre + shape.radius * np.linspace(-1, 1, _DISC_STEPS + 1)
    steps = min(max(2 * _DISC_STEPS, _SPOKE_STEPS * shape.count), _MOST_SPOKE_STEPS)
    return centre + shape.outer * np.linspace(-1, 1, steps + 1)


def _middles(lines: np.ndarray) -> np.ndarray:
    return (lines[1:] + lines[:-1]) / 2


def _is_black(drawing: Drawing, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Whether the drawing is black at the points of a grid, (len(y), len(x)), by painting its shapes one by one."""
    black = np.zeros((len(y), len(x)), bool)
    for shape in drawing.shapes:
        left, right, bottom, top = bounds(shape)
        columns = slice(*np.searchsorted(x, (left, right)))
        rows = slice(*np.searchsorted(y, (bottom, top)))
        u, v = np.meshgrid(x[columns], y[rows])
        if isinstance(shape, Checks):
            number = np.floor((u - left) / shape.square) + np.floor((top - v) / shape.square)
            black[rows, columns] = number % 2 == 0
        elif u.size:
            inside = _is_inside(shape, u, v)
            black[rows, columns][inside] = isinstance(shape, Spokes) or shape.is_black
    return black


def _is_inside(shape: Polygon | Disc | Spokes, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    if isinstance(shape, Polygon):
        inside = np.zeros(u.shape, bool)
        corners = np.array(shape.corners)
        for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            if y0 != y1:  # the even-odd rule, along a ray to the left
                inside ^= ((y0 > v) != (y1 > v)) & (u > x0 + (v - y0) * (x1 - x0) / (y1 - y0))
        return inside
    radius = np.hypot(u - shape.x, v - shape.y)
    if isinstance(shape, Disc):
        return radius < shape.radius
    sector = np.floor((np.arctan2(v - shape.y, u - shape.x) - shape.phase) * shape.count / math.pi)
    return (radius >= shape.inner) & (radius < shape.outer) & (sector % 2 == 0)


def _merged(light: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cells of one colour merged into few rectangles of lines, left, bottom, right, top (m, 4), and their colours."""
    open_, rectangles = dict[tuple[int, int, float], int](), list[tuple[int, int, int, int, float]]()
    for row in range(len(light) + 1):
        runs = _runs(light[row]) if row < len(light) else set()
        for run in [run for run in open_ if run not in runs]:
            left, right, colour = run
            rectangles.append((left, open_.pop(run), right, row, colour))
        for run in sorted(runs):
            open_.setdefault(run, row)
    table = np.array(sorted(rectangles))
    return table[:, :4].astype(int), table[:, 4]


def _runs(row: np.ndarray) -> set[tuple[int, int, float]]:
    """First cell, end and colour of each stretch of one colour."""
    ends = [0, *(np.flatnonzero(np.diff(row)) + 1).tolist(), len(row)]
    return {(a, b, float(row[a])) for a, b in pairwise(ends)}


def _finer(lines: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Lines with further ones between them, for a curved surface, and the old cell of each new one."""
    parts = np.maximum(1, np.ceil(steps * np.diff(lines) / (lines[-1] - lines[0]))).astype(int)
    fine = [np.linspace(a, b, n, endpoint=False) for (a, b), n in zip(pairwise(lines), parts, strict=True)]
    return np.append(np.concatenate(fine), lines[-1]), np.repeat(np.arange(len(parts)), parts)


def _placed(patch: Patch, xy: np.ndarray) -> np.ndarray:
    """Points of the chart on the surface, patch frame (n, 3)."""
    if patch.kind in (PLANE, CYLINDER):
        return patch.place(xy)[0]
    # `place` would compile a kernel for height maps.
    across, down, half_x, half_y, *rest = patch.shape.tolist()
    x, y = xy.T
    if across == 0:
        z = rest[0] * (1 - (x / half_x) ** 2) + rest[1] * (1 - (y / half_y) ** 2)
    else:
        z = _between(np.array(rest).reshape(int(down), int(across)), 0.5 + 0.5 * x / half_x, 0.5 - 0.5 * y / half_y)
    return np.column_stack([xy, z])


def _between(heights: np.ndarray, along: np.ndarray, below: np.ndarray) -> np.ndarray:
    """Heights (rows from the top) at fractions of width and height, interpolated linearly between neighbours."""
    rows, columns = heights.shape
    i = np.clip(np.floor(along * (columns - 1)), 0, columns - 2).astype(int)
    j = np.clip(np.floor(below * (rows - 1)), 0, rows - 2).astype(int)
    s, t = along * (columns - 1) - i, below * (rows - 1) - j
    upper = (1 - s) * heights[j, i] + s * heights[j, i + 1]
    lower = (1 - s) * heights[j + 1, i] + s * heights[j + 1, i + 1]
    return np.asarray((1 - t) * upper + t * lower)
