"""First hits of rays on targets and occluders: points, normals, and coordinates in the charts of targets.

Embree names the triangle; everything else is computed in double precision, on the true surface of targets. Vision
frame, mm.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pipeline.frames import apply, inverse
from pipeline.motion import Motion, Shutter
from pipeline.plugins.scenes.lighting.lit_scene import LitScene
from pipeline.records.shapes import Float64, Int64
from pipeline.render.pixel_rays import PixelRays
from pipeline.render.surroundings import MeshScene, in_vision
from pipeline.targets.mesh import Occluder
from pipeline.targets.surfaces import CYLINDER, MESH, PLANE, Patch
from pipeline.targets.target import AnyTarget

_STEPS = 5
"""Steps of Newton's method from a mesh to its surface: digits double, and a mesh is 1e-4 mm off as a rule."""


@dataclass(frozen=True, slots=True)
class Later:
    """Poses of targets and occluders in the next frame, in its vision frame, and their motions before a shutter there,
    targets first.
    """

    targets: Sequence[np.ndarray]  # vision_from_target of each target
    occluders: Sequence[tuple[Occluder, np.ndarray] | None]  # each occluder; None: it is not there
    shutter: Shutter | None = None
    motions: Sequence[Motion | None] = ()

    def at(
        self, points_mm: Float64[np.ndarray, "n 3"], thing: Int64[np.ndarray, "n"], time_s: Float64[np.ndarray, "n"]
    ) -> np.ndarray:
        """Points of things at times after the time code of the frame, (n, 3), from those at the time code."""
        poses = [*self.targets, *(occluder and occluder[1] for occluder in self.occluders)]
        result = points_mm.copy()
        for number, (pose, motion) in enumerate(zip(poses, self.motions, strict=True)):
            rows = np.flatnonzero(thing == number)
            if motion is not None and pose is not None and len(rows):
                moved = motion.at(time_s[rows]) @ inverse(pose)
                result[rows] = np.einsum("nij,nj->ni", moved[:, :3, :3], points_mm[rows]) + moved[:, :3, 3]
        return result


class FirstHits(NamedTuple):
    """First hits, of those rays that meet anything."""

    ray: np.ndarray  # (n,), index among all rays
    thing: np.ndarray  # (n,), targets in their order, then occluders
    face: np.ndarray  # (n,), patch, counted over all targets; -1 for an occluder
    point_mm: np.ndarray  # (n, 3)
    normal: np.ndarray  # (n, 3), on the side of the ray's start
    sheet_mm: np.ndarray  # (n, 2), u and v on the face of a target
    later_mm: np.ndarray  # (n, 3), the point in the next frame, in its vision frame; NaN: it is not there


class LabelledScene:
    """Targets and occluders, each with its pose vision_from_target or vision_from_occluder, and the next frame.

    `lit`: the same as a lit scene, if light passes any of it.
    """

    def __init__(
        self,
        targets: Sequence[tuple[AnyTarget, np.ndarray]],
        occluders: Sequence[tuple[Occluder, np.ndarray]],
        later: Later | None = None,
        lit: LitScene | None = None,
    ) -> None:
        later = later or Later([np.full((4, 4), np.nan)] * len(targets), [None] * len(occluders))
        self.later = later
        # Triangles of the patches of targets, then those of occluders.
        pieces = [(k, face, patch) for k, (t, _) in enumerate(targets) for face, patch in enumerate(t.patches())]
        self.faces = [(k, face) for k, face, _ in pieces]  # number of the target of each patch, and of the patch on it
        self._patches = [(k, patch, targets[k][1] @ patch.target_from_patch) for k, _, patch in pieces]
        meshes = [apply(pose, patch.mesh().reshape(-1, 3)).reshape(-1, 3, 3) for _, patch, pose in self._patches]
        solids = [in_vision(occluder, pose) for occluder, pose in occluders]
        everything = [*meshes, *solids]
        self._lit = lit
        self._embree = MeshScene(everything)
        self._corners = np.concatenate([np.zeros((0, 3, 3)), *everything])
        self._thing = np.array([*(k for k, _ in self.faces), *range(len(targets), len(targets) + len(solids))], int)
        # The same triangles in the next frame; targets move by their poses.
        self._motion = [pose @ inverse(now) for pose, (_, now) in zip(later.targets, targets, strict=True)]
        # Of a mesh with other faces nobody knows which point is which.
        moved = [
            in_vision(*after) if after and len(after[0].triangles) == len(mesh) else np.full_like(mesh, np.nan)
            for mesh, after in zip(solids, later.occluders, strict=True)
        ]
        # Those of targets only fill the rows: `first_hits` moves hits on them by the motion.
        self._later = np.concatenate([np.zeros((0, 3, 3)), *meshes, *moved])

    def first_hits(self, of_pixels: PixelRays) -> FirstHits:
        """First hits of the rays that leave a camera, vision frame [mm]; rays that meet nothing are left out."""
        # Find the first triangle on each ray, or the first that does not let it pass. Both count triangles alike: those
        # of all patches, then those of occluders.
        rays = of_pixels.leaving
        triangle = self._lit.first_seen(of_pixels) if self._lit else self._embree.first_hit(rays.origin, rays.direction)
        ray = np.flatnonzero(triangle >= 0)
        triangle, origin, direction = triangle[ray], rays.origin[ray], rays.direction[ray]
        # Number the pieces that these triangles belong to: patches, then occluders.
        piece = np.searchsorted(self._embree.first_triangle, triangle, side="right") - 1
        # Intersect rays with the planes of triangles. For occluders this is exact, and a hit has the same barycentric
        # coordinates in the next frame.
        point, normal, barycentric = _on_planes(self._corners[triangle], origin, direction)
        later = np.einsum("nk,nki->ni", barycentric, self._later[triangle])
        # Refine hits on targets from the mesh to the true surface, which moves with its target.
        sheet = np.full((len(ray), 2), np.nan)
        for number, (target, patch, pose) in enumerate(self._patches):
            rows = np.flatnonzero(piece == number)
            on_surface = _on_patch(patch, pose, direction[rows], point[rows], normal[rows])
            point[rows], normal[rows], sheet[rows] = on_surface
            later[rows] = apply(self._motion[target], point[rows])
        # Turn normals against the rays.
        normal *= -np.sign(np.einsum("ni,ni->n", normal, direction))[:, None]
        face = np.where(piece < len(self._patches), piece, -1)
        return FirstHits(ray, self._thing[piece], face, point, normal, sheet, later)


def _on_planes(
    corners: Float64[np.ndarray, "n 3 3"], origin: Float64[np.ndarray, "n 3"], direction: Float64[np.ndarray, "n 3"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Hits of rays on the planes of triangles: points, unit normals, and shares (n, 3) of the corners."""
    a = corners[:, 0]
    first = corners[:, 1] - a
    second = corners[:, 2] - a
    normal = np.cross(first, second)
    area = np.einsum("ni,ni->n", normal, normal)
    with np.errstate(divide="ignore", invalid="ignore"):
        path = np.einsum("ni,ni->n", a - origin, normal) / np.einsum("ni,ni->n", direction, normal)
        point = origin + path[:, None] * direction
        of_second = np.einsum("ni,ni->n", np.cross(point - a, second), normal) / area
        of_third = np.einsum("ni,ni->n", np.cross(first, point - a), normal) / area
        shares = np.stack([1.0 - of_second - of_third, of_second, of_third], axis=1)
        return point, normal / np.sqrt(area)[:, None], shares


def _on_patch(
    patch: Patch, pose: np.ndarray, direction: np.ndarray, point: np.ndarray, normal: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, normals and chart coordinates where rays meet a patch, from the hits on its mesh; vision frame."""
    local = apply(inverse(pose), point)
    if patch.kind == MESH:
        return point, normal, local[:, :2]
    local_direction = direction @ pose[:3, :3]
    for _ in range(1 if patch.kind == PLANE else _STEPS):
        chart = np.ascontiguousarray(local[:, :2])
        if patch.kind == CYLINDER:
            radius = float(patch.shape[0])
            chart[:, 0] = radius * np.arctan2(local[:, 0] / radius, local[:, 2] / radius + 1)
        surface, axes, _ = patch.surface_at(chart)
        rise, slope = (np.einsum("ni,ni->n", vector, axes[:, :, 2]) for vector in (surface - local, local_direction))
        local = local + (rise / slope)[:, None] * local_direction
    return apply(pose, local), axes[:, :, 2] @ pose[:3, :3].T, chart
