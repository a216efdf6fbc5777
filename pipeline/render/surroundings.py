"""Obstacles to light: the surfaces of all targets and occluders of a frame, opaque from both sides.

Embree finds in float32 the first triangle that a ray meets, and only its index is used: its distance is recomputed here
in double precision, and elsewhere the kernels of `targets` intersect the true surface in float64.
"""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from pipeline.frames import apply
from pipeline.records.shapes import Float64
from pipeline.targets.mesh import MeshTarget, Occluder
from pipeline.targets.surfaces import PLANE
from pipeline.targets.target import AnyTarget


class MeshScene:
    """Triangle meshes, opaque from both sides.

    Any number of threads may ask at once: Embree releases the interpreter lock while it traces.

    `meshes`, sequence of (m, 3, 3) float64: corners of the triangles of each mesh, vision frame [mm].
    `first_triangle`, (k + 1,) int64: number of the first triangle of each mesh; last entry: the count of all.
    Raises ValueError: a corner is not finite.
    """

    def __init__(self, meshes: Sequence[np.ndarray]) -> None:
        for number, mesh in enumerate(meshes):
            if mesh.shape[1:] != (3, 3) or not np.isfinite(mesh).all():
                raise ValueError(f"mesh {number} does not consist of triangles with finite corners")
        self.first_triangle = np.cumsum([0, *(len(mesh) for mesh in meshes)])
        self._scene: EmbreeScene | None = None
        # No triangles: no scene, and nothing is ever hit.
        if not self.first_triangle[-1]:
            return
        # Robust: rays through a common edge of two triangles do not slip between them.
        self._scene = EmbreeScene(robust=True)
        corners = np.concatenate(list(meshes)).reshape(-1, 3)
        index = np.arange(len(corners), dtype=np.int32).reshape(-1, 3)
        TriangleMesh(self._scene, np.ascontiguousarray(corners, dtype=np.float32), index)
        # The first query builds the tree. It is done here, so that no two threads build it at once.
        self.first_hit(np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]))

    def first_hit(self, origins: Float64[np.ndarray, "n 3"], directions: Float64[np.ndarray, "n 3"]) -> np.ndarray:
        """Index of the nearest triangle in front of each ray's start, counted over all meshes.

        `directions`: of any length.
        Returns (n,) int32: -1 where the ray meets nothing or holds NaN.

        Within about 1e-4 mm of an edge, at 400 mm, the answer may be that of the neighbouring ray.
        """
        if self._scene is None or not len(origins):
            return np.full(len(origins), -1, dtype=np.int32)
        rays = (np.ascontiguousarray(triples, dtype=np.float32) for triples in (origins, directions))
        return np.asarray(self._scene.run(*rays, query="INTERSECT"), dtype=np.int32)


_TOUCHING_MM = 1e-6
"""Distance from a plane within which an object counts as lying on it [mm]: rounding at 1 m, and touching surfaces."""
_MESH_MM, _GRAZING = 0.01, 10.0
"""Margin around a bent mesh near its own points [mm]; factor [1] for its sag and for the distance of marked points from
it, along grazing rays.
"""
_STRIDE = 97
"""Stride of the points that are examined first: a prime, so that it does not coincide with the rows of a mesh."""
_PRODUCTS_AT_ONCE = 1 << 23
"""Products of planes and points computed at once: 64 MiB; results do not depend on it."""


class Surroundings:
    """Targets and occluders, each with its pose vision_from_target or vision_from_occluder, any affine transform."""

    def __init__(
        self, targets: Sequence[tuple[AnyTarget, np.ndarray]], occluders: Sequence[tuple[Occluder, np.ndarray]] = ()
    ) -> None:
        patches = [target.patches() for target, _ in targets]
        surfaces = [
            np.concatenate([apply(pose @ patch.target_from_patch, patch.mesh().reshape(-1, 3)) for patch in pieces])
            for pieces, (_, pose) in zip(patches, targets, strict=True)
        ]
        surfaces += [in_vision(occluder, pose).reshape(-1, 3) for occluder, pose in occluders]
        # Bent targets, which consist of one patch.
        self._bent = {
            number: (target, pieces[0])
            for number, (pieces, (target, _)) in enumerate(zip(patches, targets, strict=True))
            if len(pieces) == 1 and pieces[0].kind != PLANE
        }
        self._reach_mm: dict[int, float] = {}
        self._triangles = np.cumsum([0, *(len(surface) // 3 for surface in surfaces)])
        self._points = np.concatenate([np.zeros((0, 3)), *surfaces])

    @cached_property
    def _scene(self) -> MeshScene:
        return MeshScene([self._points.reshape(-1, 3, 3)])

    @cached_property
    def _normals(self) -> np.ndarray:
        a, b, c = self._points.reshape(-1, 3, 3).transpose(1, 0, 2)
        return np.cross(b - a, c - a)

    def may_hide(self, point_mm: Float64[np.ndarray, "n 3"], front: Float64[np.ndarray, "n 3"]) -> np.ndarray:
        """Whether anything is in front of planes at points with unit normals; if not, a point is surely visible."""
        is_hidden = np.zeros(len(point_mm), bool)
        height = np.sum(point_mm * front, axis=1) + _TOUCHING_MM
        # A part of the points decides for most planes, all of them for the rest.
        for points in (self._points[::_STRIDE], self._points):
            undecided = np.flatnonzero(~is_hidden)
            at_once = max(1, _PRODUCTS_AT_ONCE // max(1, len(points)))
            for chunk in (undecided[start : start + at_once] for start in range(0, len(undecided), at_once)):
                is_hidden[chunk] = (front[chunk] @ points.T).max(axis=1, initial=-np.inf) > height[chunk]
        return is_hidden

    def hides(
        self,
        target: int,
        point_mm: Float64[np.ndarray, "n 3"],
        front: Float64[np.ndarray, "n 3"],
        origin_mm: Float64[np.ndarray, "n 3"],
        direction: Float64[np.ndarray, "n 3"],
    ) -> np.ndarray:
        """Whether an object lies between the camera and the surface at target points, for one ray of each.

        A ray that meets anything before the tangent plane is stopped, unless it meets the surface of the point itself:
        a bent surface may be in front of its own tangent plane. The hit counts as this surface if it is no farther from
        the point than twice the distance of the ray's intersection with the plane.

        `target`, `point_mm`, `front`: index of a target, points of it, and the normals of their tangent planes.
        `origin_mm`, `direction`: rays from the lens into the scene, unit directions.
        """
        triangle, path = self._first(origin_mm, direction)
        with np.errstate(divide="ignore", invalid="ignore"):  # rays parallel to a plane are stopped by nothing
            to_plane = _dot(point_mm - origin_mm, front) / _dot(direction, front)
            hidden = (triangle >= 0) & (path < to_plane - _TOUCHING_MM)
        if target in self._bent:
            by_itself = hidden & (triangle >= self._triangles[target]) & (triangle < self._triangles[target + 1])
            if by_itself.any():
                start = origin_mm[by_itself]
                towards = direction[by_itself]
                point = point_mm[by_itself]
                # Distances from the point at which the ray meets the mesh, and the tangent plane
                to_hit, to_meeting = (
                    np.linalg.norm(start + along[by_itself, None] * towards - point, axis=1)
                    for along in (path, to_plane)
                )
                hidden[by_itself] = to_hit > 2 * to_meeting + self._reach(target)
        return hidden

    def distance_mm(self, origin_mm: Float64[np.ndarray, "n 3"], direction: Float64[np.ndarray, "n 3"]) -> np.ndarray:
        """Distance along rays with unit directions to the first surface, (n,) [mm]; NaN where there is none, or no ray.

        Bent targets count as their meshes.
        """
        distance = np.full(len(origin_mm), np.nan)
        rows = np.flatnonzero(np.isfinite(direction).all(axis=1))
        triangle, path = self._first(origin_mm[rows], direction[rows])
        distance[rows] = np.where(triangle >= 0, path, np.nan)
        return distance

    def _first(self, origin_mm: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The first triangle of each ray, -1 for none, and the distance to its plane."""
        triangle = self._scene.first_hit(origin_mm, direction)
        if not len(self._points):
            return triangle, np.full(len(origin_mm), np.nan)
        with np.errstate(divide="ignore", invalid="ignore"):
            normal = self._normals[triangle]
            path = _dot(self._points[3 * triangle] - origin_mm, normal) / _dot(direction, normal)
        return triangle, path

    def _reach(self, number: int) -> float:
        """Distance from a point of a bent target within which a ray towards it may meet the target's own mesh [mm]."""
        if number not in self._reach_mm:
            target, patch = self._bent[number]
            beside = target.distances_mm().max() if isinstance(target, MeshTarget) else 0.0
            self._reach_mm[number] = float(_MESH_MM + _GRAZING * (patch.mesh_sag_mm() + beside))
        return self._reach_mm[number]


def in_vision(occluder: Occluder, vision_from_occluder: Float64[np.ndarray, "4 4"]) -> np.ndarray:
    """Triangles of an occluder, vision frame (m, 3, 3) [mm]."""
    return apply(vision_from_occluder, occluder.corners_mm().reshape(-1, 3)).reshape(-1, 3, 3)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("ni,ni->n", a, b)
