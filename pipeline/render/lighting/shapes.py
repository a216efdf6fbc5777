"""Shapes of a lit scene: triangles of targets and of other meshes, with normals, texture coordinates and materials."""

import numpy as np

from pipeline.frames import apply
from pipeline.records.shapes import Float64
from pipeline.render.lighting.material_kernels import COEFFICIENTS, CONSTANT, EMISSION, MAP, TEXTURE, Materials
from pipeline.render.lighting.records import Finish
from pipeline.render.lighting.shape_kernels import Glow, Shapes
from pipeline.targets.mesh import Occluder
from pipeline.targets.patches import CYLINDER, HEIGHTS, Patch


def joined(pieces: list[Shapes]) -> Shapes:
    """All pieces, one after the other."""
    nothing = Shapes(np.zeros((0, 3, 3)), np.zeros((0, 3, 3)), np.zeros((0, 3, 2)), np.zeros(0, np.int64))
    return Shapes(*(np.concatenate(arrays) for arrays in zip(nothing, *pieces, strict=True)))


def of_patch(patch: Patch, pose: Float64[np.ndarray, "4 4"], material: int) -> Shapes:
    """A patch of a target; `pose` is vision_from_patch."""
    mesh = patch.mesh()
    corners = apply(pose, mesh.reshape(-1, 3)).reshape(-1, 3, 3)
    normals = _flat(corners)
    if patch.kind == CYLINDER:
        radius = patch.shape[0]
        arc = radius * np.arctan2(mesh[..., 0] / radius, mesh[..., 2] / radius + 1)
        chart = np.stack([arc, mesh[..., 1]], axis=-1)
    elif patch.kind == HEIGHTS:
        chart = mesh[..., :2]
    else:
        return Shapes(corners, normals, np.zeros((len(mesh), 3, 2)), np.full(len(mesh), material))
    _, axes, _ = patch.place(np.ascontiguousarray(chart.reshape(-1, 2)))
    normals = (axes[:, :, 2] @ pose[:3, :3].T).reshape(-1, 3, 3)
    return Shapes(corners, normals, np.zeros((len(mesh), 3, 2)), np.full(len(mesh), material))


def of_mesh(occluder: Occluder, pose: Float64[np.ndarray, "4 4"], finish: Finish, rows: list[int]) -> Shapes:
    """A mesh; `pose` is vision_from_mesh, any affine transform, and `rows` are those of its materials."""
    corners = apply(pose, occluder.corners_mm().reshape(-1, 3)).reshape(-1, 3, 3)
    count = len(corners)
    normals = _flat(corners)
    if finish.normals:
        turned = np.array(finish.normals, float).reshape(-1, 3) @ np.linalg.inv(pose[:3, :3])
        normals = (turned / np.maximum(np.linalg.norm(turned, axis=1, keepdims=True), 1e-300)).reshape(-1, 3, 3)
    st = np.array(finish.st, float).reshape(-1, 3, 2) if finish.st else np.zeros((count, 3, 2))
    chosen = np.array(rows)[np.array(finish.material_of, int)] if finish.material_of else np.full(count, rows[0])
    return Shapes(corners, normals, st, chosen)


def _flat(corners: Float64[np.ndarray, "m 3 3"]) -> np.ndarray:
    """Normals of triangles at each corner, (m, 3, 3); zeros for a triangle without area."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    return np.repeat((normal / np.where(length > 0, length, 1.0))[:, None], 3, axis=1)


def glow_of(shapes: Shapes, materials: Materials) -> tuple[Glow, float]:
    """Triangles that shine by themselves, by area and emission, still without a chance; and the sum of both products
    [mm^2 of radiance].
    """
    edge, next_edge = (shapes.corners[:, k] - shapes.corners[:, 0] for k in (1, 2))
    area = 0.5 * np.linalg.norm(np.cross(edge, next_edge), axis=1)
    power = area * _emission(materials)[shapes.material] if len(area) else area
    shining = np.flatnonzero(power > 0)
    share = power / power.sum() if len(shining) else power
    per_mm2 = np.divide(share, area, out=np.zeros(len(area)), where=area > 0)
    return Glow(0.0, shining, np.cumsum(share[shining]), per_mm2, shapes, materials), float(power.sum())


def _emission(materials: Materials) -> np.ndarray:
    """Radiance of each material, (m,), the mean of its picture if it has one."""
    inputs = materials.inputs[:, EMISSION]
    result = inputs[:, CONSTANT].copy()
    for m in np.flatnonzero(inputs[:, TEXTURE] >= 0):
        first, width, height = materials.pictures[int(inputs[m, TEXTURE])]
        texels = materials.texels[first : first + width * height]
        result[m] += texels.mean(axis=0, dtype=float) @ inputs[m, COEFFICIENTS:MAP]
    return np.maximum(result, 0.0)
