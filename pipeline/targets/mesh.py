"""Meshes: targets of any known shape with marked points, and occluders that may hide a target."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from pipeline.records.plain import ByContent
from pipeline.records.shapes import Bool, Float64, Int64
from pipeline.targets.drawing import Drawing
from pipeline.targets.patterns.pattern import TargetError
from pipeline.targets.points import TargetPoints, frames_at
from pipeline.targets.surfaces import MESH, Patch

Triple = tuple[float, float, float]
_SAME = 1e-7
"""Distance within which two vertices coincide, relative to the mesh [1]: files hold single precision."""


def require_faces(triangles: Int64[np.ndarray, "m 3"], vertices: int) -> None:
    """Raise a TargetError for a mesh without faces, or with a face that names a missing vertex."""
    if not len(triangles):
        raise TargetError("the mesh has no faces", code="bad-mesh")
    if not 0 <= triangles.min() <= triangles.max() < vertices:
        raise TargetError(f"a face names a vertex beyond the {vertices} of the mesh", code="bad-mesh")


def is_closed(points: Float64[np.ndarray, "n 3"], triangles: Int64[np.ndarray, "m 3"]) -> bool:
    """Whether triangles bound a volume: along each edge, equally many run in either direction.

    Coincident vertices, as at the seams of textures, count as one.
    """
    # Number the vertices, coincident ones alike.
    from_middle = points - points.mean(axis=0)
    grain = max(_SAME * float(np.abs(from_middle).max()), np.finfo(float).tiny)
    _, vertex = np.unique(np.round(from_middle / grain), axis=0, return_inverse=True)
    corners = vertex.reshape(-1)[triangles]
    # Number the edges without regard to direction, and add up the directions of the triangles along each.
    start, end = corners.ravel(), corners[:, [1, 2, 0]].ravel()
    _, edge = np.unique(np.minimum(start, end) * len(points) + np.maximum(start, end), return_inverse=True)
    return not np.bincount(edge.reshape(-1), weights=np.sign(end - start)).any()


@dataclass(frozen=True, kw_only=True, eq=False)
class Occluder(ByContent):
    """A mesh that blocks light, opaque from both sides, with one relative radiance on both; vertices in its own frame.

    Raises TargetError: it has no faces, or a face refers to a vertex that does not exist.
    """

    vertices_mm: Any  # (n, 3) float64, or anything that converts to it
    triangles: Any  # (m, 3) int64
    radiance: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertices_mm", np.asarray(self.vertices_mm, float))
        object.__setattr__(self, "triangles", np.asarray(self.triangles, np.int64))
        require_faces(self.triangles, len(self.vertices_mm))

    def corners_mm(self) -> np.ndarray:
        """Corners of the triangles, (m, 3, 3)."""
        corners: np.ndarray = self.vertices_mm[self.triangles]
        return corners

    @cached_property
    def _ball_mm(self) -> tuple[np.ndarray, float]:
        """Centre and radius of an enclosing sphere."""
        centre = (self.vertices_mm.min(axis=0) + self.vertices_mm.max(axis=0)) / 2
        return centre, float(np.linalg.norm(self.vertices_mm - centre, axis=1).max())

    def may_reach(
        self, poses: Float64[np.ndarray, "n 4 4"], ends_mm: Float64[np.ndarray, "2 3"], distance_mm: float
    ) -> Bool[np.ndarray, "n"]:
        """Whether the mesh, in affine poses, may come within a distance of the segment between two points, (2, 3)."""
        # Distance of the centre of the enclosing sphere from the nearest point of the segment.
        centre, radius = self._ball_mm
        start, end = ends_mm
        from_start = poses[:, :3, :3] @ centre + poses[:, :3, 3] - start
        segment = end - start
        share = np.clip(from_start @ segment / max(segment @ segment, np.finfo(float).tiny), 0.0, 1.0)
        distance = np.linalg.norm(from_start - share[:, None] * segment, axis=1)
        # The norm of an affine pose is at least its largest stretch of any length.
        within: np.ndarray = distance <= distance_mm + radius * np.linalg.norm(poses[:, :3, :3], axis=(1, 2))
        return within

    def is_closed(self) -> bool:
        """Whether its triangles bound a volume."""
        return is_closed(self.vertices_mm, self.triangles)


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshTarget:
    """A target of flat triangles with marked points, for objects of known shape. Everything is in the target frame."""

    KIND: ClassVar[str] = "mesh"
    ORDER: ClassVar[str] = "id: place in the list of marked points of the stage"

    vertices_mm: tuple[Triple, ...]
    triangles: tuple[tuple[int, int, int], ...]  # corners anticlockwise as seen from the front
    albedo: tuple[Triple, ...]  # radiance at the corners of each triangle, relative; between them it is interpolated
    # the marked points in the order of their ids, and the normals of their tangent planes, of any length
    points_mm: tuple[Triple, ...]
    normals: tuple[Triple, ...]

    def __post_init__(self) -> None:
        require_faces(np.array(self.triangles), len(self.vertices_mm))
        if len(self.points_mm) != len(self.normals):
            raise TargetError(
                f"{len(self.points_mm)} marked points and {len(self.normals)} normals", hint="one normal per point"
            )
        if not self.points_mm or not np.linalg.norm(np.array(self.normals), axis=1).all():
            raise TargetError(
                "there are no marked points, or one has a normal of length 0",
                hint="each point needs the normal of the surface there",
            )

    @property
    def kind(self) -> str:
        return self.KIND

    def corners_mm(self) -> np.ndarray:
        """Corners of the triangles, (m, 3, 3)."""
        return np.array(self.vertices_mm, float)[np.array(self.triangles)]

    def patches(self) -> list[Patch]:
        blank = Drawing(0.0, 0.0)
        albedo = np.array(self.albedo, float)
        return [Patch(MESH, np.eye(4), blank, (0.0, 1.0), triangles=self.corners_mm(), albedo=albedo)]

    def points(self) -> TargetPoints:
        """The marked points, each with a plane of its own."""
        position, normal = np.array(self.points_mm, float), np.array(self.normals, float)
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        # x is horizontal if possible: y of the target crossed with the normal.
        horizontal = np.cross([0.0, 1.0, 0.0], normal)
        is_upright = np.linalg.norm(horizontal, axis=1) < 1e-6  # a normal along y has no horizontal x of its own
        horizontal[is_upright] = np.cross(normal[is_upright], [0.0, 0.0, 1.0])
        x = horizontal / np.linalg.norm(horizontal, axis=1)[:, None]
        axes = np.stack([x, np.cross(normal, x), normal], axis=2)
        n = len(position)
        return TargetPoints(
            position_mm=position,
            nominal_mm=position,
            axes=axes,
            curvature_per_mm=np.zeros(n),
            kinds=["marked"] * n,
            radius_mm=np.full(n, np.nan),
            plane=np.arange(n),
            frames=frames_at(position, axes),
        )

    def distances_mm(self) -> np.ndarray:
        """Distance of each marked point from the mesh, (n,)."""
        corners = self.corners_mm()
        return np.array([_distances(np.array(point), corners).min() for point in self.points_mm])

    def title(self) -> str:
        """One line for messages."""
        return f"mesh of {len(self.triangles)} triangles with {len(self.points_mm)} marked points"


def _distances(point: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Distances from a point to triangles, (m,): to the plane if the foot lies inside, else to the nearest edge."""
    # Barycentric coordinates of the foot of the point on each plane say whether it lies inside of the triangle.
    first = corners[:, 0]
    to_second, to_third = corners[:, 1] - first, corners[:, 2] - first
    normal = np.cross(to_second, to_third)
    squared = np.maximum(np.sum(normal**2, axis=1), 1e-300)
    from_first = point - first
    second = np.sum(np.cross(from_first, to_third) * normal, axis=1) / squared
    third = np.sum(np.cross(to_second, from_first) * normal, axis=1) / squared
    is_inside = (second >= 0) & (third >= 0) & (second + third <= 1)
    to_plane = np.abs(np.sum(from_first * normal, axis=1)) / np.sqrt(squared)
    # The nearest point of an edge is the foot on its line, or an end.
    to_edge = np.full(len(first), np.inf)
    for i in range(3):
        start = corners[:, i]
        edge = corners[:, (i + 1) % 3] - start
        length_squared = np.maximum(np.sum(edge**2, axis=1), 1e-300)
        share = np.clip(np.sum((point - start) * edge, axis=1) / length_squared, 0, 1)
        to_edge = np.minimum(to_edge, np.linalg.norm(point - start - share[:, None] * edge, axis=1))
    return np.where(is_inside, to_plane, to_edge)
