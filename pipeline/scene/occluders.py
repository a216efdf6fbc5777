"""Occluders: valid meshes that keep their shape and stay outside the lens."""

from collections.abc import Iterator, Set

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from pipeline.frames import apply
from pipeline.scene.dataset import OccluderEntry
from pipeline.scene.lens import prescription_of
from pipeline.scene.materials import read_finish, seen_meshes
from pipeline.scene.usd.meshes import SHAPE, check_skin, fans
from pipeline.scene.usd.opening import instance_of
from pipeline.scene.usd.poses import (
    camera_from_world,
    camera_name,
    is_visible,
    moving_op,
    product,
    stage_mm_per_unit,
    world_from,
)
from pipeline.scene.usd.problems import Problem, problem
from pipeline.scene.usd.values import read, read_once, target, targets
from pipeline.targets.mesh import Occluder
from pipeline.targets.patterns.pattern import TargetError


def read_occluder_entry(prim: Usd.Prim, lit: bool) -> OccluderEntry:
    """A mesh that a dataset names as an occluder, or any mesh if lamps light it."""
    finish = read_finish(prim) if lit else None
    path, instance = str(prim.GetPath()), instance_of(prim)
    return OccluderEntry(prim_path=path, occluder=read_occluder(prim), finish=finish, instance=instance)


@read_once
def read_occluder(prim: Usd.Prim) -> Occluder:
    """A Mesh in its own frame [mm], dark without PlenOccluderAPI; TargetError or ValueError for contradictory faces."""
    mesh, scale_mm = fans(UsdGeom.Mesh(prim)), stage_mm_per_unit(prim)
    return Occluder(
        vertices_mm=tuple((x * scale_mm, y * scale_mm, z * scale_mm) for x, y, z in mesh.points),
        triangles=mesh.triangles,
        radiance=read(prim, "plen:radiance") or 0.0,
    )


def check_occluders(root: Usd.Prim, wrong: Set[Sdf.Path]) -> Iterator[Problem]:
    """Problems of the occluders of a dataset except poses; `wrong` holds the prims with wrong values."""
    meshes = {target(prim, "plen:mesh", "Mesh"): prim for prim in targets(root, "plen:targets", "PlenMeshTarget")}
    for prim in seen_meshes(root):
        if prim in meshes:
            message = f"<{prim.GetPath()}> is the mesh of the target <{meshes[prim].GetPath()}>"
            hint = "targets hide each other and themselves without being named"
            yield problem(root.GetRelationship("plen:occluders"), "occluder-is-target", message, hint=hint)
        elif prim.GetPath() not in wrong:
            yield from _check_mesh(prim)


def _check_mesh(prim: Usd.Prim) -> Iterator[Problem]:
    yield from check_skin(prim)
    if moving := [name for name in SHAPE if prim.GetAttribute(name).ValueMightBeTimeVarying()]:
        message = f'"{moving[0]}" of an occluder is animated, and occluders keep their shape'
        hint = "animate its xformOps, or use one mesh per shape and make it invisible in other frames"
        yield problem(prim.GetAttribute(moving[0]), "not-yet-supported", message, hint=hint)
        return
    try:
        read_occluder(prim)
    except TargetError as error:
        yield problem(prim, error.code, error.what, hint=error.hint)
    except ValueError:
        message = "the faces of the mesh contradict each other"
        yield problem(prim, "bad-mesh", message, hint="check faceVertexCounts and faceVertexIndices")


def check_outside_lens(
    camera: Usd.Prim, occluders: list[Usd.Prim], root: Usd.Prim, frames: tuple[int, ...]
) -> Iterator[Problem]:
    """Problems of occluders that enter the lens of a camera; beside and behind it they are allowed."""
    if not occluders:
        return
    prescription = prescription_of(camera)
    ends = -prescription.vertices_from_stop_mm[-1], -prescription.vertices_from_stop_mm[0]
    radius_mm = max(surface.semi_diameter_mm for surface in prescription.surfaces)
    scale_mm = stage_mm_per_unit(root)
    vision_from_world = camera_from_world(camera, frames, scale_mm)
    for occluder in occluders:
        corners = read_occluder(occluder).corners_mm().reshape(-1, 3)
        poses = product(vision_from_world, world_from(occluder, frames, scale_mm))
        for number, pose in zip(frames, poses, strict=True):
            triangles = apply(pose, corners).reshape(-1, 3, 3)
            if is_visible(occluder, float(number)) and meets_lens(triangles, ends, radius_mm):
                message = (
                    f'"{occluder.GetName()}" reaches into the lens of "{camera_name(camera, root)}" at time code'
                    f" {number}, z = {ends[0]:.6g} to {ends[1]:.6g} mm and {radius_mm:.6g} mm about the axis"
                )
                moving, hint = moving_op(occluder), "the camera looks along its -Z; its origin is the aperture stop"
                time = float(number) if moving else None
                yield problem(moving or occluder, "inside-lens", message, hint=hint, time=time)


def meets_lens(triangles_mm: np.ndarray, ends_mm: tuple[float, float], radius_mm: float) -> bool:
    """Whether a triangle (m, 3, 3) meets the cylinder about the z axis between two ends."""
    low, high = triangles_mm.min(axis=1), triangles_mm.max(axis=1)
    near = (low[:, 2] <= ends_mm[1]) & (high[:, 2] >= ends_mm[0])
    near &= (low[:, :2] <= radius_mm).all(axis=1) & (high[:, :2] >= -radius_mm).all(axis=1)
    return any(_distance_of_axis(triangle, ends_mm) <= radius_mm for triangle in triangles_mm[near])


def _distance_of_axis(triangle: np.ndarray, ends_mm: tuple[float, float]) -> float:
    """Distance of the z axis from the part of a triangle between two heights; infinite if there is none."""
    part = _cut(_cut(triangle, ends_mm[0], 1.0), ends_mm[1], -1.0)[:, :2]
    if not len(part):
        return np.inf
    way = np.roll(part, -1, axis=0) - part
    length = np.maximum(np.sum(way**2, axis=1), 1e-300)
    share = np.clip(-np.sum(part * way, axis=1) / length, 0.0, 1.0)
    side = part[:, 0] * way[:, 1] - part[:, 1] * way[:, 0]
    if (side > 0).all() or (side < 0).all():
        return 0.0
    return float(np.hypot(*(part + share[:, None] * way).T).min())


def _cut(polygon: np.ndarray, height_mm: float, sign: float) -> np.ndarray:
    """Part of a convex polygon (n, 3) above a height, or with sign -1 below it."""
    kept: list[np.ndarray] = []
    above = sign * (polygon[:, 2] - height_mm)
    for i in range(len(polygon)):
        j = (i + 1) % len(polygon)
        if above[i] >= 0:
            kept.append(polygon[i])
        if (above[i] < 0) != (above[j] < 0):
            kept.append(polygon[i] + above[i] / (above[i] - above[j]) * (polygon[j] - polygon[i]))
    return np.array(kept).reshape(-1, 3)
