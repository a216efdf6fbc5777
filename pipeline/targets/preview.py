"""Preview of a target for viewers: its surface as flat faces in true size, and a picture of its pattern.

Curved surfaces have small faces with corners on the surface (on straight lines between the heights of a height map).
Nothing is compiled and no library is loaded, because a plan makes previews, too.
"""

import math
from dataclasses import dataclass

import numpy as np

from pipeline.frames import apply
from pipeline.records.shapes import Float64, Int64
from pipeline.targets.drawing import Checks, Disc, Drawing, Polygon, Spokes, bounds
from pipeline.targets.surfaces import CYLINDER, PLANE, Patch
from pipeline.targets.target import Target

_AROUND, _ACROSS = 64, 24
"""Faces around a cylinder, and along each direction of a bent board: enough for a picture; no number depends on
them."""


@dataclass(frozen=True, slots=True)
class PreviewFaces:
    """Quadrilaterals in the target frame."""

    points_mm: Float64[np.ndarray, "n 3"]
    faces: Int64[np.ndarray, "m 4"]  # corners, anticlockwise as seen from the front
    # texture coordinates of each point on the picture of all patches side by side, (0, 0) lower left to (1, 1)
    sheet: Float64[np.ndarray, "n 2"]


def preview_faces(target: Target) -> PreviewFaces:
    """Faces of all patches of a target, whose pictures lie side by side."""
    patches = target.patches()
    pieces = [_faces(patch) for patch in patches]
    first = np.cumsum([0, *(len(piece.points_mm) for piece in pieces)])  # point of each piece, in all of them
    placed = [apply(patch.target_from_patch, piece.points_mm) for patch, piece in zip(patches, pieces, strict=True)]
    sheets = [(piece.sheet + np.array([number, 0])) / (len(pieces), 1) for number, piece in enumerate(pieces)]
    return PreviewFaces(
        points_mm=np.concatenate(placed),
        faces=np.concatenate([piece.faces + start for piece, start in zip(pieces, first, strict=False)]),
        sheet=np.concatenate(sheets),
    )


_WIDEST_PX = 1 << 14
"""Most pixels along the picture of all patches [px]: viewers show no wider texture, and stairs may have thousands."""


def preview_picture(target: Target, size_px: int) -> np.ndarray:
    """Relative radiance of all patches side by side, (size_px, size_px * patches), or smaller for many.

    The first row is the top.
    """
    pictures = []
    patches = target.patches()
    size_px = max(1, min(size_px, _WIDEST_PX // len(patches)))
    for patch in patches:
        black, white = patch.colours
        share = (np.arange(size_px) + 0.5) / size_px
        x, y = ((2 * share - 1) * half for half in (patch.drawing.half_x_mm, patch.drawing.half_y_mm))
        pictures.append(np.where(_is_black(patch.drawing, x, y), black, white)[::-1])
    return np.hstack(pictures)


def _faces(patch: Patch) -> PreviewFaces:
    """Faces of one patch, in its own frame."""
    columns, rows = {PLANE: (1, 1), CYLINDER: (_AROUND, 1)}.get(patch.kind, (_ACROSS, _ACROSS))
    u, v = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1))
    sheet = np.stack([u.ravel(), v.ravel()], axis=1)
    lower_left = np.arange(u.size).reshape(u.shape)[:-1, :-1]
    faces = lower_left.reshape(-1, 1) + np.array([0, 1, columns + 2, columns + 1])
    xy = (2 * sheet - 1) * [patch.drawing.half_x_mm, patch.drawing.half_y_mm]
    return PreviewFaces(_placed(patch, xy), faces, sheet)


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
    """Whether points of the chart lie inside of a shape; of spokes inside of a sector."""
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


def _placed(patch: Patch, xy: np.ndarray) -> np.ndarray:
    """Points of the chart on the surface, patch frame (n, 3)."""
    if patch.kind in (PLANE, CYLINDER):
        return patch.surface_at(xy)[0]
    # `surface_at` would compile a kernel for height maps.
    across, down, half_x, half_y, *rest = patch.shape.tolist()
    x, y = xy.T
    if across == 0:
        z = rest[0] * (1 - (x / half_x) ** 2) + rest[1] * (1 - (y / half_y) ** 2)
    else:
        z = _interpolated(
            np.array(rest).reshape(int(down), int(across)), 0.5 + 0.5 * x / half_x, 0.5 - 0.5 * y / half_y
        )
    return np.column_stack([xy, z])


def _interpolated(heights: np.ndarray, along: np.ndarray, below: np.ndarray) -> np.ndarray:
    """Heights (rows from the top) at fractions of width and height, interpolated linearly between neighbours."""
    rows, columns = heights.shape
    i = np.clip(np.floor(along * (columns - 1)), 0, columns - 2).astype(int)
    j = np.clip(np.floor(below * (rows - 1)), 0, rows - 2).astype(int)
    right_share = along * (columns - 1) - i
    lower_share = below * (rows - 1) - j
    upper = (1 - right_share) * heights[j, i] + right_share * heights[j, i + 1]
    lower = (1 - right_share) * heights[j + 1, i] + right_share * heights[j + 1, i + 1]
    return np.asarray((1 - lower_share) * upper + lower_share * lower)
