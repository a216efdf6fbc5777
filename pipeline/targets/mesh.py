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
    off = points - points.mean(axis=0)
    grain = max(_SAME * float(np.abs(off).max()), np.finfo(float).tiny)
    _, same = np.unique(np.round(off / grain), axis=0, return_inverse=True)
    corners = same.reshape(-1)[triangles]
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
        centre, radius = self._ball_mm
        start, end = ends_mm
        off = poses[:, :3, :3] @ centre + poses[:, :3, 3] - start
        segment = end - start
        share = np.clip(off @ segment / max(segment @ segment, np.finfo(float).tiny), 0.0, 1.0)
        apart = np.linalg.norm(off - share[:, None] * segment, axis=1)
        reach: np.ndarray = apart <= distance_mm + radius * np.linalg.norm(poses[:, :3, :3], axis=(1, 2))
        return reach

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
        corners, albedo = self.corners_mm(), np.array(self.albedo, float)
        return [Patch(MESH, np.eye(4), blank, (0.0, 1.0), triangles=corners, albedo=albedo)]

    def points(self) -> TargetPoints:
        """The marked points, each with a plane of its own."""
        position, normal = np.array(self.points_mm, float), np.array(self.normals, float)
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        # x is horizontal if possible: y of the target crossed with the normal.
        level = np.cross([0.0, 1.0, 0.0], normal)
        steep = np.linalg.norm(level, axis=1) < 1e-6
        level[steep] = np.cross(normal[steep], [0.0, 0.0, 1.0])
        x = level / np.linalg.norm(level, axis=1)[:, None]
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
    a = corners[:, 0]
    e1, e2 = corners[:, 1] - a, corners[:, 2] - a
    normal = np.cross(e1, e2)
    area = np.maximum(np.sum(normal**2, axis=1), 1e-300)
    q = point - a
    b1 = np.sum(np.cross(q, e2) * normal, axis=1) / area
    b2 = np.sum(np.cross(e1, q) * normal, axis=1) / area
    flat = np.abs(np.sum(q * normal, axis=1)) / np.sqrt(area)
    inside = (b1 >= 0) & (b2 >= 0) & (b1 + b2 <= 1)
    edges = np.full(len(a), np.inf)
    for i in range(3):
        start, edge = corners[:, i], corners[:, (i + 1) % 3] - corners[:, i]
        length = np.maximum(np.sum(edge**2, axis=1), 1e-300)
        t = np.clip(np.sum((point - start) * edge, axis=1) / length, 0, 1)
        edges = np.minimum(edges, np.linalg.norm(point - start - t[:, None] * edge, axis=1))
    return np.where(inside, flat, edges)
