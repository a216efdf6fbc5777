"""Optional columns of a table of correspondences: other image positions of its points, see CONVENTIONS.md.

x_px, y_px are those of J. Detectors of corners and dots look for other positions, and a lens with coma separates them.
A saddle needs an X-corner, where two straight edges cross. The drawing decides whether a point is one, not its kind: a
corner of an AprilGrid is an X-corner, because a tag and a small square meet there; a corner of a tag on white paper is
not.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pipeline.camera.rig import Rig
from pipeline.records.shapes import Float64
from pipeline.targets.drawing import Drawing
from pipeline.targets.mesh import MeshTarget
from pipeline.targets.patterns.pattern import Pattern
from pipeline.targets.surfaces import Patch
from pipeline.targets.target import AnyTarget
from pipeline.truth.direct.candidates import chief_points
from pipeline.truth.planes import Planes
from pipeline.truth.positions.bundle_map import NONE, Position
from pipeline.truth.positions.centroid import centroid
from pipeline.truth.positions.saddle import corner_plane, saddle
from pipeline.truth.rows import Solutions

_CIRCLE_MM = 1e-3
"""Radius of the circle on which colours are compared [mm]: far below any feature, far above rounding."""
_DIRECTIONS = 64
"""Directions in which colours are compared, less than 6 degrees apart: a corner of four sectors has four changes."""
_BISECTIONS = 40
"""Bisections of the 6 degrees that contain an edge: to 1e-13 rad, below the rounding of points on the circle."""
_FIRST = 0.4321
"""First direction, as a fraction of the angle between two [1]: no pattern has an edge there."""
_SETTLED_PX, _ITERATIONS = 1e-7, 8
"""Error of a moving point's position at which the iteration for its time has converged [px], a ten-thousandth of the
default claim, and the most iterations: each about doubles the digits."""
_STRAIGHT_RAD = 1e-6
"""Largest bend of an edge at its corner [rad]: more than the rounding of such points on sheets of metres."""


@dataclass(frozen=True, slots=True)
class Corners:
    """Surroundings of each point of a target, in the order of their ids."""

    # unit vectors along the surface of the two edges through an X-corner, target frame: white lies between the first
    # and the second, and opposite. NaN at all other points
    edges: Float64[np.ndarray, "n 2 3"]
    mean_over_contrast: Float64[np.ndarray, "n"]  # (white + black) / (white - black) of the pattern


def corners_of(target: AnyTarget) -> Corners:
    """Edges and colours around the points of a target; NaN for a mesh."""
    if isinstance(target, MeshTarget):
        n = len(target.points_mm)
        return Corners(np.full((n, 2, 3), np.nan), np.full(n, np.nan))
    pieces = [(patch, pattern) for patch, pattern in target.surface.patches(target.pattern) if pattern]
    edges, ratios = zip(*(_corners_of_patch(patch, pattern) for patch, pattern in pieces), strict=True)
    return Corners(np.concatenate(edges), np.concatenate(ratios))


def _corners_of_patch(patch: Patch, pattern: Pattern) -> tuple[np.ndarray, np.ndarray]:
    """Edges (n, 2, 3) and ratios (n,) of `Corners` for the points of one patch of a target."""
    xy_mm = pattern.marks().xy_mm
    contrast = pattern.white - pattern.black
    edges = np.full((len(xy_mm), 2, 3), np.nan)
    if contrast:
        direction = corner_edges(pattern.drawing, xy_mm)
        edges = patch.along(direction, patch.surface_at(xy_mm)[1]) @ patch.target_from_patch[:3, :3].T
    ratio = (pattern.white + pattern.black) / contrast if contrast else np.nan
    return edges, np.full(len(xy_mm), ratio)


def corner_edges(drawing: Drawing, xy_mm: Float64[np.ndarray, "n 2"]) -> np.ndarray:
    """Directions of the two edges through points (n, 2) of the chart, (n, 2) [rad]; NaN where there is no X-corner.

    The sector from the first to the second direction, anticlockwise and less than half a turn, is white, and so is
    the opposite one; the other two are black.
    """
    return np.array([_edges(drawing, point) for point in xy_mm]).reshape(-1, 2)


def _edges(drawing: Drawing, point: np.ndarray) -> np.ndarray:
    """The two directions of `corner_edges` for one point (2,), from the colours on a small circle around it."""
    no_corner = np.full(2, np.nan)
    # Bracket the changes of colour along the circle: an X-corner has four.
    angle = 2 * np.pi * (np.arange(_DIRECTIONS) + _FIRST) / _DIRECTIONS
    colour = _colour(drawing, point, angle)
    change = np.flatnonzero(colour != np.roll(colour, -1))
    if len(change) != 4 or np.isnan(colour).any():
        return no_corner
    # Bisect each bracket for the direction of its edge.
    before = colour[change]
    low = angle[change]
    high = low + 2 * np.pi / _DIRECTIONS
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        same = _colour(drawing, point, middle) == before
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    edge = (low + high) / 2
    # The third and the fourth edge must continue the first and the second.
    if np.abs(edge[2:] - edge[:2] - np.pi).max() > _STRAIGHT_RAD:
        return no_corner
    return edge[:2] if before[0] == 0 else edge[1:3]


def _colour(drawing: Drawing, point: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Whiteness of a drawing in directions from a point, on the small circle."""
    return drawing.whiteness(point[0] + _CIRCLE_MM * np.cos(angle), point[1] + _CIRCLE_MM * np.sin(angle))


SETS = {
    "chief": "chief: where the ray through the centre of the stop sees the point; behind a microlens, that through its"
    " vertex",
    "saddle": "saddle: where the noise-free image of an infinite corner, with the point's edges in its tangent plane,"
    " integrated over a pixel, is stationary",
    "centroid": "centroid: of the noise-free image of the disc about the point in its tangent plane",
}
"""The sets in the order of their columns, with a description of each."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SetNote:
    """Numbers of rows of a set with a position and, by reason, without; largest estimated error, None if unknown."""

    name: str
    rows: int
    empty: dict[str, int]
    error_px: float | None

    @property
    def text(self) -> str:
        """Text for the header of a table."""
        empty = [f"{reason} {count}" for reason, count in self.empty.items() if count]
        note = f"{self.name} {self.rows}" + (f" (empty: {', '.join(empty)})" if empty else "")
        return note if self.error_px is None else f"{note}, its largest error {self.error_px:.1g} px"

    def joined(self, other: "SetNote") -> "SetNote":
        """The note of the rows of both."""
        errors = [note.error_px for note in (self, other) if note.error_px is not None]
        return SetNote(
            name=self.name,
            rows=self.rows + other.rows,
            empty={reason: count + other.empty[reason] for reason, count in self.empty.items()},
            error_px=max(errors, default=None),
        )


@dataclass(frozen=True, slots=True)
class ColumnSet:
    """One position per row of a target; NaN for none."""

    x_px: Float64[np.ndarray, "n 2"]
    note: SetNote


def column_names(name: str) -> tuple[str, str]:
    """Names of the two columns of a set in the table."""
    return f"{name}_x_px", f"{name}_y_px"


def column_set(
    name: str, rig: Rig, target: AnyTarget, pose: Float64[np.ndarray, "4 4"], planes: Planes, rows: Solutions
) -> ColumnSet:
    """The positions of one set for the rows of a target at `pose` vision_from_target, with `planes` at its points.

    For a moving target each position is that of the still target in the middle of the exposure at this position.
    """
    axis = planes.shutter.axis
    make = _MAKERS[name]
    x = rows.xy_px.copy()
    x_before = rows.xy_px
    residual_before = np.zeros(len(rows.point))
    for _ in range(_ITERATIONS):
        # Make the set of the still target at the time of x, and compare its coordinate along the scan with that of x.
        poses = pose if planes.motion is None else planes.motion.at(planes.middle_s(x))
        result = make(rig, target, poses, planes.middle(rows.point, x), rows)
        residual = result.x_px[:, axis] - x[:, axis]
        if not (planes.moves and planes.shutter.line_by_px_s and (np.abs(residual) > _SETTLED_PX).any()):
            break
        # The time depends on the coordinate along the scan only: a secant step, and first a fixed-point step.
        with np.errstate(invalid="ignore", divide="ignore"):
            slope = (residual - residual_before) / (x - x_before)[:, axis]
            step = np.where(np.isfinite(slope), -residual / slope, np.nan_to_num(residual))
        x_before = x
        residual_before = residual
        x = x + step[:, None] * np.eye(2)[axis]
    return result


def _chief(rig: Rig, target: AnyTarget, pose: np.ndarray, planes: np.ndarray, rows: Solutions) -> ColumnSet:
    """The set of chief rays; arguments as in `column_set`, with the tangent planes of the rows' points (n, 4, 3)."""
    x = chief_points(rig.tracer, rig.microlens(rows.cell), rows.xy_px, planes)
    return _noted("chief", x, {"no such ray": np.isnan(x[:, 0])}, None)


def _saddles(rig: Rig, target: AnyTarget, pose: np.ndarray, planes: np.ndarray, rows: Solutions) -> ColumnSet:
    """The set of saddles; arguments as in `_chief`."""
    corners = corners_of(target)
    microlens = rig.microlens(rows.cell)
    start = rows.xy_px
    edges = corners.edges[rows.point] @ np.swapaxes(pose[..., :3, :3], -1, -2)
    is_corner = np.isfinite(edges).all(axis=(1, 2))

    def saddle_of(i: int) -> Position:
        """The saddle of row i."""
        ratio = float(corners.mean_over_contrast[rows.point[i]])
        return saddle(rig.tracer, int(microlens[i]), start[i], corner_plane(planes[i], edges[i]), ratio)

    x, error = _one_by_one(is_corner, saddle_of)
    lost = is_corner & np.isnan(x[:, 0])
    return _noted("saddle", x, {"not a corner of four sectors": ~is_corner, "none in the own micro-image": lost}, error)


def _centroids(rig: Rig, target: AnyTarget, pose: np.ndarray, planes: np.ndarray, rows: Solutions) -> ColumnSet:
    """The set of centroids; arguments as in `_chief`."""
    radius = target.points().radius_mm[rows.point]
    start = rows.xy_px
    is_disc = ~np.isnan(radius)
    x, error = _one_by_one(is_disc, lambda i: centroid(rig, int(rows.cell[i]), start[i], planes[i], float(radius[i])))
    lost = is_disc & np.isnan(x[:, 0])
    return _noted("centroid", x, {"not a disc": ~is_disc, "disc not whole in image or cell": lost}, error)


def _one_by_one(wanted: np.ndarray, solve: Callable[[int], Position]) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n, 2) and errors (n,) of the wanted rows; NaN for the rest."""
    positions = [solve(i) if is_wanted else NONE for i, is_wanted in enumerate(wanted.tolist())]
    x_px = np.array([position.x_px for position in positions]).reshape(-1, 2)
    return x_px, np.array([position.error_px for position in positions])


_MAKERS = {"chief": _chief, "saddle": _saddles, "centroid": _centroids}


def _noted(name: str, x_px: np.ndarray, reasons: dict[str, np.ndarray], error_px: np.ndarray | None) -> ColumnSet:
    """Positions (n, 2) with their note; `reasons` says for each reason which rows it leaves empty, (n,) bool."""
    has_position = ~np.isnan(x_px[:, 0])
    largest = float(error_px[has_position].max()) if error_px is not None and has_position.any() else None
    empty = {reason: int(is_empty.sum()) for reason, is_empty in reasons.items()}
    return ColumnSet(x_px, SetNote(name=name, rows=int(has_position.sum()), empty=empty, error_px=largest))
