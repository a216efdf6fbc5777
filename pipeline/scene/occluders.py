"""Readers and checks of occluders, the shapes of a dataset that may hide target points."""

import itertools
from collections.abc import Iterator, Sequence, Set
from functools import partial

import numpy as np
from pxr import Sdf, Usd

from pipeline.frames import apply
from pipeline.optics.prescription import Prescription
from pipeline.scene.dataset import OccluderEntry
from pipeline.scene.targets import is_preview
from pipeline.scene.usd.meshes import alike, drawn, is_animated, is_drawn, of_prim
from pipeline.scene.usd.opening import instance_of
from pipeline.scene.usd.plug_in import scene_reader
from pipeline.scene.usd.poses import (
    camera_from_world,
    camera_name,
    frame_numbers,
    is_in_images,
    is_visible,
    moving_op,
    product,
    stage_mm_per_unit,
    world_from,
)
from pipeline.scene.usd.problems import Problem, not_drawn, of_reader, over_limit, problem
from pipeline.scene.usd.readers import read_once
from pipeline.scene.usd.values import UnreadableValue, read, target, targets
from pipeline.scene.windows import prescription_of
from pipeline.targets.mesh import Occluder


@read_once
def seen_meshes(root: Usd.Prim) -> list[Usd.Prim]:
    """Shapes in images of a dataset besides targets: those that it names, and all shapes of a lit stage."""
    stage = root.GetStage()
    tops = targets(root, "plen:occluders", "Imageable")
    below = (prim for top in tops for prim in Usd.PrimRange(top) if prim == top or is_in_images(prim))
    named = dict.fromkeys(prim for prim in below if is_drawn(prim))
    if not scene_reader().is_lit(stage):
        return list(named)
    meshed = (prim for prim in stage.Traverse() if prim.IsA("PlenMeshTarget"))
    taken = {mesh for prim in meshed for mesh in targets(prim, "plen:mesh", "Mesh")}
    unnamed = [prim for prim in stage.Traverse() if is_drawn(prim) and prim not in named and prim not in taken]
    return list(named) + [prim for prim in unnamed if is_in_images(prim) and not is_preview(prim)]


@read_once
def seen_shapes(root: Usd.Prim) -> list[list[Usd.Prim]]:
    """The same shapes, in groups of equal ones."""
    return alike(seen_meshes(root), lambda prim: of_prim(prim, 0.0 if is_animated(prim) else None))


def read_occluder_entries(prim: Usd.Prim, lit: bool, frames: Sequence[int]) -> list[OccluderEntry]:
    """The entry of a shape, or one for each frame if it is animated; none of a shape without triangles."""
    moments: list[int | None] = list(frames) if is_animated(prim, lit) else [None]
    return [
        OccluderEntry(
            prim_path=str(prim.GetPath()),
            occluder=read_occluder(prim, moment),
            finish=scene_reader().read_finish(prim, moment) if lit else None,
            instance=instance_of(prim),
            frame=moment,
        )
        for moment in moments
        if len(drawn(prim, moment).corners)
    ]


@partial(read_once, named=of_prim)
def read_occluder(prim: Usd.Prim, frame: int | None = None) -> Occluder:
    """The triangles of a shape in its own frame [mm], dark without PlenOccluderAPI."""
    shape, scale_mm = drawn(prim, frame), stage_mm_per_unit(prim)
    return Occluder(
        vertices_mm=shape.points * scale_mm,
        triangles=shape.triangles,
        radiance=read(prim, "plen:radiance") or 0.0,
    )


def check_occluders(root: Usd.Prim, wrong: Set[Sdf.Path]) -> Iterator[Problem]:
    """Problems of the occluders of a dataset except poses; `wrong` holds the prims with wrong values."""
    meshes = {target(prim, "plen:mesh", "Mesh"): prim for prim in targets(root, "plen:targets", "PlenMeshTarget")}
    right = [[prim for prim in same if prim.GetPath() not in wrong] for same in seen_shapes(root)]
    frames, count = frame_numbers(root), 0
    for prim in [prim for same in right for prim in same if prim in meshes]:
        message = f"<{prim.GetPath()}> is the mesh of the target <{meshes[prim].GetPath()}>"
        hint = "targets hide each other and themselves without being named"
        yield problem(root.GetRelationship("plen:occluders"), "occluder-is-target", message, hint=hint)
    for same in filter(None, right):
        try:
            shapes = [drawn(same[0], moment) for moment in (frames if is_animated(same[0]) else [None])]
        except UnreadableValue as error:
            yield of_reader(same[0], error)
            continue
        count += len(same) * sum(len(shape.corners) for shape in shapes)
        for flaw in dict.fromkeys(flaw for shape in shapes for flaw in shape.flaws):
            yield from (not_drawn(prim, f"<{prim.GetPath()}>: {flaw}") for prim in same if prim not in meshes)
    yield from over_limit(root, "shapes", count, f"{count:,} triangles of all occluders, in all frames,")


def check_outside_lens(camera: Usd.Prim, root: Usd.Prim, frames: tuple[int, ...]) -> Iterator[Problem]:
    """Problems of occluders that enter the lens of a camera; beside and behind it they are allowed."""
    if not (shapes := seen_shapes(root)):
        return
    ends_mm, radius_mm = body_of(prescription_of(camera))
    lens_mm, scale_mm = np.array([[0.0, 0.0, end] for end in ends_mm]), stage_mm_per_unit(root)
    vision_from_world = camera_from_world(camera, frames, scale_mm)
    for same, (index, number) in itertools.product(shapes, enumerate(frames)):
        at = number if is_animated(same[0]) else None
        if not len(drawn(same[0], at).corners):
            continue
        world, shape = [world_from(each, frames, scale_mm)[index] for each in same], read_occluder(same[0], at)
        poses = product(vision_from_world[index], np.array(world))
        for which in np.flatnonzero(shape.may_reach(poses, lens_mm, radius_mm)):
            occluder, corners_mm = same[which], apply(poses[which], shape.vertices_mm)[shape.triangles]
            if is_visible(occluder, float(number)) and meets_lens(corners_mm, ends_mm, radius_mm):
                message = (
                    f'"{occluder.GetName()}" reaches into the lens of "{camera_name(camera, root)}" at time code'
                    f" {number}, z = {ends_mm[0]:.6g} to {ends_mm[1]:.6g} mm and {radius_mm:.6g} mm about the axis"
                )
                moving, hint = moving_op(occluder), "the camera looks along its -Z; its origin is the aperture stop"
                time = float(number) if moving else None
                yield problem(moving or occluder, "inside-lens", message, hint=hint, time=time)


def body_of(lens: Prescription) -> tuple[tuple[float, float], float]:
    """Both ends of a lens on the axis, as vision z, and its radius [mm]."""
    ends_mm = -lens.vertices_from_stop_mm[-1], -lens.vertices_from_stop_mm[0]
    return ends_mm, max(surface.semi_diameter_mm for surface in lens.surfaces)


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
    edge = np.roll(part, -1, axis=0) - part
    length = np.maximum(np.sum(edge**2, axis=1), 1e-300)
    share = np.clip(-np.sum(part * edge, axis=1) / length, 0.0, 1.0)
    side = part[:, 0] * edge[:, 1] - part[:, 1] * edge[:, 0]
    if (side > 0).all() or (side < 0).all():
        return 0.0
    return float(np.hypot(*(part + share[:, None] * edge).T).min())


def _cut(polygon: np.ndarray, height_mm: float, sign: float) -> np.ndarray:
    """Part of a convex polygon (n, 3) above a height, or with sign -1 below it (Sutherland and Hodgman)."""
    kept: list[np.ndarray] = []
    above = sign * (polygon[:, 2] - height_mm)
    for i in range(len(polygon)):
        j = (i + 1) % len(polygon)
        if above[i] >= 0:
            kept.append(polygon[i])
        if (above[i] < 0) != (above[j] < 0):
            kept.append(polygon[i] + above[i] / (above[i] - above[j]) * (polygon[j] - polygon[i]))
    return np.array(kept).reshape(-1, 3)
