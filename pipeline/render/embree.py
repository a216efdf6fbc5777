"""Which flat surface does a ray meet first? Embree answers in float32; `exact_hit` recomputes the hit in double.

Embree is trusted with the name of the surface only. Where a ray meets it, and whether it truly does, follows from the
corners in float64.
"""

from collections.abc import Sequence

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

_RAYS_PER_CALL = 1 << 18
"""Bounds the float32 copies of a call to about 7 MB."""

_TRIANGLES_OF_QUAD = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)


class PlanarScene:
    """Flat parallelograms (boards), opaque from both sides.

    Any number of threads may ask at once: Embree releases the interpreter lock while it traces.

    Parameters
    ----------
    quads : sequence of (4, 3) float64
        Corners in order around each parallelogram, vision frame [mm].

    Raises
    ------
    ValueError
        If corners do not make a parallelogram of some area.
    """

    def __init__(self, quads: Sequence[np.ndarray]) -> None:
        for index, quad in enumerate(quads):
            _require_parallelogram(index, np.asarray(quad, dtype=np.float64))
        # Robust: rays through the diagonal that two triangles share do not slip between them.
        self._scene = EmbreeScene(robust=True) if len(quads) else None
        if self._scene is None:
            return
        vertices = np.ascontiguousarray(np.concatenate(list(quads)), dtype=np.float32)
        corners = (np.arange(len(quads), dtype=np.int32) * 4)[:, None, None] + _TRIANGLES_OF_QUAD
        TriangleMesh(self._scene, vertices, np.ascontiguousarray(corners.reshape(-1, 3)))
        # The first query builds the tree. Done here, so that no two threads build it at once.
        self.first_hit(np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]))

    def first_hit(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """Index of the nearest parallelogram in front of each ray's start.

        Parameters
        ----------
        origins : (n, 3) float64
            Starts of the rays, vision frame [mm].
        directions : (n, 3) float64
            Of any length.

        Returns
        -------
        (n,) int32
            -1 where the ray meets nothing or holds NaN.

        Notes
        -----
        Within about 1e-4 mm of an edge, at 400 mm, the answer may be that of the neighbouring ray: check with
        `exact_hit`.
        """
        hit = np.full(len(origins), -1, dtype=np.int32)
        if self._scene is None:
            return hit
        for start in range(0, len(origins), _RAYS_PER_CALL):
            rays = slice(start, start + _RAYS_PER_CALL)
            origin32 = np.ascontiguousarray(origins[rays], dtype=np.float32)
            direction32 = np.ascontiguousarray(directions[rays], dtype=np.float32)
            triangle = self._scene.run(origin32, direction32, query="INTERSECT")
            hit[rays] = np.where(triangle >= 0, triangle // 2, -1)
        return hit


def exact_hit(
    quad: np.ndarray, origins: np.ndarray, directions: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where rays meet the plane of a parallelogram, in double.

    Parameters
    ----------
    quad : (4, 3) float64
        Corners in order around the parallelogram, vision frame [mm].
    origins, directions : (n, 3) float64
        Rays, vision frame [mm]; directions of any length.

    Returns
    -------
    u, v : (n,) float64
        Fractions of the edges from corner 0 to corner 1 and from corner 0 to corner 3: the point is
        `quad[0] + u (quad[1] - quad[0]) + v (quad[3] - quad[0])`. Not finite for rays along the plane.
    inside : (n,) bool
        The point lies in front of the ray's start and in the parallelogram, its edges included.
    """
    corner, along_u, along_v = quad[0], quad[1] - quad[0], quad[3] - quad[0]
    normal = np.cross(along_u, along_v)
    area2 = normal @ normal
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = ((corner - origins) @ normal) / (directions @ normal)
        offset = origins + distance[:, None] * directions - corner
        u = offset @ np.cross(along_v, normal) / area2
        v = offset @ np.cross(normal, along_u) / area2
        inside = (distance > 0) & (u >= 0) & (u <= 1) & (v >= 0) & (v <= 1)
    return u, v, inside


def _require_parallelogram(index: int, quad: np.ndarray) -> None:
    if quad.shape != (4, 3) or not np.isfinite(quad).all():
        raise ValueError(f"quad {index} is not four finite corners: {quad.tolist()}")
    size = np.ptp(quad, axis=0).max()
    # 1e-9 of the size or of the distance: what a chain of rigid transforms in double leaves, a thousand times over.
    gap = np.abs(quad[0] - quad[1] + quad[2] - quad[3]).max()
    area = np.linalg.norm(np.cross(quad[1] - quad[0], quad[3] - quad[0]))
    if gap > 1e-9 * np.abs(quad).max() or not area > 1e-9 * size**2:
        raise ValueError(f"quad {index} is not a parallelogram: {quad.tolist()}")
