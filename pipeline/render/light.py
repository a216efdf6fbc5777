"""Radiance of the scene along rays: targets and occluders before a uniform background.

Embree says which triangle a ray meets first; the hit is recomputed in double on the true surface behind it, and the
pattern is evaluated there by its formula. No texture, no filter.
"""

from collections.abc import Sequence

import numpy as np

from pipeline.frames import apply
from pipeline.render.embree import MeshScene
from pipeline.render.surroundings import in_vision
from pipeline.target import kernels
from pipeline.target.occluder import Occluder
from pipeline.target.patches import CYLINDER, MESH, PLANE, Patch
from pipeline.target.target import AnyTarget


class TargetLight:
    """Targets that radiate like their artwork, equally into all directions, from their front; their back is black.

    Parameters
    ----------
    targets : sequence of (Target or MeshTarget, (4, 4) float64)
        Each with its pose vision_from_target.
    background : float
        Radiance where nothing is.
    occluders : sequence of (Occluder, (4, 4) float64)
        Each with its pose vision_from_occluder; they radiate equally from both sides.
    """

    def __init__(
        self,
        targets: Sequence[tuple[AnyTarget, np.ndarray]],
        background: float,
        occluders: Sequence[tuple[Occluder, np.ndarray]] = (),
    ) -> None:
        self._background = background
        patches = [(patch, pose @ patch.target_from_patch) for target, pose in targets for patch in target.patches()]
        self._lights = [_PatchLight(patch, pose) for patch, pose in patches]
        others = [in_vision(occluder, pose) for occluder, pose in occluders]
        self._scene = MeshScene([*(light.mesh_in_vision() for light in self._lights), *others])
        self._others = [occluder.radiance for occluder, _ in occluders]

    def radiance(self, origin_mm: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Radiance that arrives along each ray, (n,); origins and directions (n, 3), vision frame."""
        hit = self._scene.first_hit(origin_mm, direction)
        light = np.full(len(hit), self._background)
        for patch, first, end in zip(self._lights, self._scene.first, self._scene.first[1:], strict=False):
            patch.shine(np.where((hit >= first) & (hit < end), hit - first, -1), origin_mm, direction, light)
        ends = self._scene.first[len(self._lights) :]
        for radiance, first, end in zip(self._others, ends, ends[1:], strict=False):
            light[(hit >= first) & (hit < end)] = radiance
        return light


class _PatchLight:
    """A patch made ready for the kernels."""

    def __init__(self, patch: Patch, vision_from_patch: np.ndarray) -> None:
        self._patch, self._pose = patch, np.ascontiguousarray(vision_from_patch)
        self._triangles = np.ascontiguousarray(patch.mesh())
        self._art = (*patch.drawing.arrays, np.array(patch.colours))

    def mesh_in_vision(self) -> np.ndarray:
        """Triangles, vision frame."""
        return apply(self._pose, self._triangles.reshape(-1, 3)).reshape(-1, 3, 3)

    def shine(self, triangle: np.ndarray, origin: np.ndarray, direction: np.ndarray, light: np.ndarray) -> None:
        """Write the light of the rays that meet a triangle of this patch first; -1 stands for the others."""
        kind = self._patch.kind
        if kind == PLANE:
            kernels.plane_light(*self._art, self._pose, triangle >= 0, origin, direction, light)
        elif kind == MESH:
            kernels.mesh_light(self._patch.albedo, self._triangles, self._pose, triangle, origin, direction, light)
        else:
            own = self._pose, triangle, self._triangles, kind == CYLINDER, self._patch.shape
            kernels.curved_light(*self._art, *own, origin, direction, light)
