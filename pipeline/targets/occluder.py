"""Occluders: opaque triangles of one radiance that may be in front of a target."""

from dataclasses import dataclass

import numpy as np

from pipeline.targets.mesh import Triple, require_faces


@dataclass(frozen=True, slots=True, kw_only=True)
class Occluder:
    """A mesh that blocks light, opaque from both sides.

    Attributes
    ----------
    vertices_mm : tuple of triples
        Vertices in the frame of the mesh.
    triangles : tuple of triples of int
    radiance : float
        Relative radiance, the same everywhere and on both sides.

    Raises
    ------
    TargetError
        It has no faces, or a face refers to a vertex that does not exist.
    """

    vertices_mm: tuple[Triple, ...]
    triangles: tuple[tuple[int, int, int], ...]
    radiance: float = 0.0

    def __post_init__(self) -> None:
        require_faces(self.triangles, len(self.vertices_mm))

    def corners_mm(self) -> np.ndarray:
        """Corners of the triangles, (m, 3, 3)."""
        return np.array(self.vertices_mm, float)[np.array(self.triangles)]
