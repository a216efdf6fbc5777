"""First triangle that a ray meets, found by Embree in float32.

Only the index of the triangle is used. Whether and where a ray meets the true surface is computed by the kernels of
`targets` in float64.
"""

from collections.abc import Sequence

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from pipeline.records.shapes import Float64


class MeshScene:
    """Triangle meshes, opaque from both sides.

    Any number of threads may ask at once: Embree releases the interpreter lock while it traces.

    `meshes`, sequence of (m, 3, 3) float64: corners of the triangles of each mesh, vision frame [mm].
    `first`, (k + 1,) int64: number of the first triangle of each mesh, and of all of them.
    Raises ValueError: a corner is not finite.
    """

    def __init__(self, meshes: Sequence[np.ndarray]) -> None:
        for number, mesh in enumerate(meshes):
            if mesh.shape[1:] != (3, 3) or not np.isfinite(mesh).all():
                raise ValueError(f"mesh {number} does not consist of triangles with finite corners")
        self.first = np.cumsum([0, *(len(mesh) for mesh in meshes)])
        # Robust: rays through a common edge of two triangles do not slip between them.
        self._scene = EmbreeScene(robust=True) if self.first[-1] else None
        if self._scene is None:
            return
        corners = np.concatenate(list(meshes)).reshape(-1, 3)
        index = np.arange(len(corners), dtype=np.int32).reshape(-1, 3)
        TriangleMesh(self._scene, np.ascontiguousarray(corners, dtype=np.float32), index)
        # The first query builds the tree. It is done here, so that no two threads build it at once.
        self.first_hit(np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]))

    def first_hit(self, origins: Float64[np.ndarray, "n 3"], directions: Float64[np.ndarray, "n 3"]) -> np.ndarray:
        """Number of the nearest triangle in front of each ray's start, counted over all meshes.

        `directions`: of any length.
        Returns (n,) int32: -1 where the ray meets nothing or holds NaN.

        Within about 1e-4 mm of an edge, at 400 mm, the answer may be that of the neighbouring ray.
        """
        if self._scene is None or not len(origins):
            return np.full(len(origins), -1, dtype=np.int32)
        rays = (np.ascontiguousarray(triples, dtype=np.float32) for triples in (origins, directions))
        return np.asarray(self._scene.run(*rays, query="INTERSECT"), dtype=np.int32)
