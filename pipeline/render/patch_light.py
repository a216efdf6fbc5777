"""Light along rays that meet a patch of a target: its artwork at the exact hit."""

import numpy as np

from pipeline.camera.tracing.records import Leaving
from pipeline.frames import apply
from pipeline.records.shapes import Bool, Float64, Int64
from pipeline.render import sheet_image
from pipeline.targets import kernels
from pipeline.targets.patches import CYLINDER, MESH, PLANE, Patch


class PatchLight:
    """A patch made ready for the kernels."""

    def __init__(self, patch: Patch, vision_from_patch: Float64[np.ndarray, "4 4"]) -> None:
        self._patch, self._pose = patch, np.ascontiguousarray(vision_from_patch)
        self._triangles = np.ascontiguousarray(patch.mesh())
        self._artwork = kernels.Artwork(patch.drawing.arrays, np.array(patch.colours), self._pose)

    def mesh_in_vision(self) -> np.ndarray:
        """Triangles, vision frame."""
        return apply(self._pose, self._triangles.reshape(-1, 3)).reshape(-1, 3, 3)

    @property
    def is_flat(self) -> bool:
        """Whether the patch is plane."""
        return self._patch.kind == PLANE

    def add(
        self,
        background: float,
        rays: Leaving,
        pixels: Int64[np.ndarray, "n"],
        wanted: Bool[np.ndarray, "m"],
        image: Float64[np.ndarray, "m"],
    ) -> None:
        """Add the light of a flat patch that nothing hides, and of the background beside it: see `TargetLight.add`."""
        sheet_image.add_light(sheet_image.FlatSheet(self._artwork, background), rays, pixels, wanted, image)

    def shine(
        self,
        triangle: Int64[np.ndarray, "n"],
        origin: Float64[np.ndarray, "n 3"],
        direction: Float64[np.ndarray, "n 3"],
        light: Float64[np.ndarray, "n"],
    ) -> None:
        """Write the light of the rays that meet a triangle of this patch first; -1 marks all other rays."""
        kind = self._patch.kind
        if kind == PLANE:
            kernels.plane_light(self._artwork, triangle >= 0, origin, direction, light)
        elif kind == MESH:
            kernels.mesh_light(self._patch.albedo, self._triangles, self._pose, triangle, origin, direction, light)
        else:
            surface = kernels.Curved(kind == CYLINDER, self._patch.shape, self._triangles)
            kernels.curved_light(self._artwork, surface, triangle, origin, direction, light)
