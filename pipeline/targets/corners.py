"""X-corners among the points of a target, where two straight edges cross, and the directions of their edges.

The drawing decides, not the kind of the point: a corner of an AprilGrid is an X-corner, because a tag and a small
square meet there; a corner of a tag on white paper is not.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.records.shapes import Float64
from pipeline.targets.drawing import Drawing
from pipeline.targets.mesh import MeshTarget
from pipeline.targets.patterns.pattern import Pattern
from pipeline.targets.surfaces import Patch
from pipeline.targets.target import AnyTarget

_CIRCLE_MM = 1e-3
"""Radius of the circle on which colours are compared [mm]: far below any feature, far above rounding."""
_DIRECTIONS = 64
"""Directions in which colours are compared, less than 6 degrees apart: a corner of four sectors has four changes."""
_BISECTIONS = 40
"""Halvings of the 6 degrees in which an edge lies: to 1e-13 rad, below the rounding of points on the circle."""
_FIRST = 0.4321
"""First direction, as a part of the angle between two [1]: no pattern has an edge there, seen on one side only."""
_STRAIGHT_RAD = 1e-6
"""Angle by which an edge may bend at its corner [rad]: more than the rounding of such points on sheets of metres."""


@dataclass(frozen=True, slots=True)
class Corners:
    """Surroundings of each point of a target, in the order of their ids."""

    # unit vectors along the surface of the two edges through an X-corner, target frame: white lies between the first
    # and the second, and opposite. NaN at all other points
    edges: Float64[np.ndarray, "n 2 3"]
    mean_over_contrast: Float64[np.ndarray, "n"]  # (white + black) / (white - black) of the pattern


def corners_of(target: AnyTarget) -> Corners:
    """Edges and colours around the points of a target; for a mesh nothing is known about them."""
    if isinstance(target, MeshTarget):
        n = len(target.points_mm)
        return Corners(np.full((n, 2, 3), np.nan), np.full(n, np.nan))
    pieces = [(patch, pattern) for patch, pattern in target.surface.patches(target.pattern) if pattern]
    edges, colours = zip(*(_on(patch, pattern) for patch, pattern in pieces), strict=True)
    return Corners(np.concatenate(edges), np.concatenate(colours))


def _on(patch: Patch, pattern: Pattern) -> tuple[np.ndarray, np.ndarray]:
    xy_mm = pattern.marks().xy_mm
    contrast = pattern.white - pattern.black
    edges = np.full((len(xy_mm), 2, 3), np.nan)
    if contrast:
        direction = corner_edges(pattern.drawing, xy_mm)
        edges = patch.along(direction, patch.place(xy_mm)[1]) @ patch.target_from_patch[:3, :3].T
    ratio = (pattern.white + pattern.black) / contrast if contrast else np.nan
    return edges, np.full(len(xy_mm), ratio)


def corner_edges(drawing: Drawing, xy_mm: Float64[np.ndarray, "n 2"]) -> np.ndarray:
    """Directions of the two edges through points (n, 2) of the chart, (n, 2) [rad]; NaN where there is no X-corner.

    The sector from the first to the second direction, anticlockwise and less than half a turn, is white, and so is
    the opposite one; the other two are black.
    """
    return np.array([_edges(drawing, point) for point in xy_mm]).reshape(-1, 2)


def _edges(drawing: Drawing, point: np.ndarray) -> np.ndarray:
    none = np.full(2, np.nan)
    angle = 2 * np.pi * (np.arange(_DIRECTIONS) + _FIRST) / _DIRECTIONS
    colour = _colour(drawing, point, angle)
    change = np.flatnonzero(colour != np.roll(colour, -1))
    if len(change) != 4 or np.isnan(colour).any():
        return none
    low, high, before = angle[change], angle[change] + 2 * np.pi / _DIRECTIONS, colour[change]
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        same = _colour(drawing, point, middle) == before
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    edge = (low + high) / 2
    if np.abs(edge[2:] - edge[:2] - np.pi).max() > _STRAIGHT_RAD:
        return none
    return edge[:2] if before[0] == 0 else edge[1:3]


def _colour(drawing: Drawing, point: np.ndarray, angle: np.ndarray) -> np.ndarray:
    return drawing.whiteness(point[0] + _CIRCLE_MM * np.cos(angle), point[1] + _CIRCLE_MM * np.sin(angle))
