"""Things before a camera, and what of them rays meet first: points, normals, and places on the sheets of targets.

Embree names the triangle; everything else is computed in double precision, on the true surface of targets. Vision
frame, mm.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.frames import apply, inverse
from pipeline.records.shapes import Float64, Int64
from pipeline.render.surroundings import MeshScene, in_vision
from pipeline.targets.mesh import Occluder
from pipeline.targets.surfaces import CYLINDER, MESH, PLANE, Patch
from pipeline.targets.target import AnyTarget

_STEPS = 5
"""Steps of Newton's method from a mesh to its surface: digits double, and a mesh is 1e-4 mm off as a rule."""

Placed = Sequence[tuple[AnyTarget, np.ndarray]]
"""Targets with their poses vision_from_target."""
Occluders = Sequence[tuple[Occluder, np.ndarray]]
"""Occluders with their poses vision_from_occluder."""


@dataclass(frozen=True, slots=True)
class Later:
    """Where things are in the next frame, in its vision frame."""

    targets: Sequence[np.ndarray]  # vision_from_target of each target
    occluders: Sequence[tuple[Occluder, np.ndarray] | None]  # each occluder; None: it is not there


@dataclass(frozen=True, slots=True)
class Met:
    """What rays meet first; NaN and -1 where they meet nothing."""

    thing: Int64[np.ndarray, "n"]  # targets in their order, then occluders
    face: Int64[np.ndarray, "n"]  # patch, counted over all targets; -1 for an occluder
    point_mm: Float64[np.ndarray, "n 3"]
    normal: Float64[np.ndarray, "n 3"]
    sheet_mm: Float64[np.ndarray, "n 2"]  # u and v on the face of a target
    later_mm: Float64[np.ndarray, "n 3"]  # the same point in the next frame, in its vision frame


class Things:
    """Targets and occluders of a frame.

    `later`: the next frame, if motion is asked for.
    """

    def __init__(self, targets: Placed, occluders: Occluders, later: Later | None = None) -> None:
        self._patches = [
            (number, patch, pose @ patch.target_from_patch)
            for number, (target, pose) in enumerate(targets)
            for patch in target.patches()
        ]
        meshes = [apply(pose, patch.mesh().reshape(-1, 3)).reshape(-1, 3, 3) for _, patch, pose in self._patches]
        others = [in_vision(occluder, pose) for occluder, pose in occluders]
        self._embree, self._ends = MeshScene([*meshes, *others]), np.cumsum([0, *map(len, [*meshes, *others])])
        self._corners = np.concatenate([np.zeros((0, 3, 3)), *meshes, *others])
        owners = [number for number, _, _ in self._patches]
        self._thing = np.array([*owners, *(len(targets) + number for number in range(len(others)))], int)
        # Number of the target of each patch, and of the patch on it.
        self.faces = [(k, face) for k, (target, _) in enumerate(targets) for face in range(len(target.patches()))]
        self._motion: list[np.ndarray] | None = None
        if later is not None:
            self._motion = [pose @ inverse(now) for pose, (_, now) in zip(later.targets, targets, strict=True)]
            moved = [_followed(mesh, then) for mesh, then in zip(others, later.occluders, strict=True)]
            self._later = np.concatenate([np.full((len(self._corners) - sum(map(len, others)), 3, 3), np.nan), *moved])

    def met(self, origin_mm: Float64[np.ndarray, "n 3"], direction: Float64[np.ndarray, "n 3"]) -> Met:
        """What rays with unit directions meet first."""
        count = len(origin_mm)
        triangle = self._embree.first_hit(origin_mm, direction)
        hit = np.flatnonzero(triangle >= 0)
        piece, thing, face = (np.full(count, -1) for _ in range(3))
        point, normal, later = (np.full((count, 3), np.nan) for _ in range(3))
        sheet = np.full((count, 2), np.nan)
        if len(hit):
            piece[hit] = np.searchsorted(self._ends, triangle[hit], side="right") - 1
            thing[hit] = self._thing[piece[hit]]
            corners = self._corners[triangle[hit]]
            point[hit], normal[hit], shares = _on_planes(corners, origin_mm[hit], direction[hit])
            if self._motion is not None:
                later[hit] = np.einsum("nk,nki->ni", shares, self._later[triangle[hit]])
        for number in np.unique(piece[hit]).tolist():
            if number >= len(self._patches):
                break
            rows = np.flatnonzero(piece == number)
            owner, patch, pose = self._patches[number]
            face[rows] = number
            there = _on_patch(patch, pose, origin_mm[rows], direction[rows], point[rows], normal[rows])
            point[rows], normal[rows], sheet[rows] = there
            if self._motion is not None:
                later[rows] = apply(self._motion[owner], point[rows])
        towards = np.einsum("ni,ni->n", normal, direction) > 0
        normal[towards] *= -1.0
        return Met(thing, face, point, normal, sheet, later)


def _followed(mesh: Float64[np.ndarray, "m 3 3"], then: tuple[Occluder, np.ndarray] | None) -> np.ndarray:
    """Corners of a mesh in the next frame; NaN if it is not there, or has other faces: none of its points is known."""
    corners = None if then is None else in_vision(*then)
    return corners if corners is not None and corners.shape == mesh.shape else np.full_like(mesh, np.nan)


def _on_planes(
    corners: Float64[np.ndarray, "n 3 3"], origin: Float64[np.ndarray, "n 3"], direction: Float64[np.ndarray, "n 3"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where rays meet the planes of triangles: points, unit normals, and shares (n, 3) of the corners."""
    a, first, second = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
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
    patch: Patch, pose: np.ndarray, origin: np.ndarray, direction: np.ndarray, point: np.ndarray, normal: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, normals and places on the sheet where rays meet a patch, from those on its mesh; vision frame."""
    patch_from_vision = inverse(pose)
    there = apply(patch_from_vision, point)
    if patch.kind == MESH:
        return point, normal, there[:, :2]
    if patch.kind == PLANE:
        start, way = apply(patch_from_vision, origin), direction @ pose[:3, :3]
        there = start - (start[:, 2] / way[:, 2])[:, None] * way
        there[:, 2] = 0.0
        return apply(pose, there), np.broadcast_to(pose[:3, 2], point.shape), there[:, :2]
    way = direction @ pose[:3, :3]
    for _ in range(_STEPS):
        on_surface, axes = _below(patch, there)[1:]
        front = axes[:, :, 2]
        short = np.einsum("ni,ni->n", on_surface - there, front) / np.einsum("ni,ni->n", way, front)
        there = there + short[:, None] * way
    chart, _, axes = _below(patch, there)
    return apply(pose, there), axes[:, :, 2] @ pose[:3, :3].T, chart


def _below(patch: Patch, there: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Chart, point of the surface and axes there, below points near a curved patch, patch frame."""
    chart = np.ascontiguousarray(there[:, :2])
    if patch.kind == CYLINDER:
        radius = float(patch.shape[0])
        chart[:, 0] = radius * np.arctan2(there[:, 0] / radius, there[:, 2] / radius + 1)
    on_surface, axes, _ = patch.place(chart)
    return chart, on_surface, axes
