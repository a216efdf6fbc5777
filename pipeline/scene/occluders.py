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
from pipeline.scene.usd.meshes import alike, drawn, is_animated, is_drawn, shape_key
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
def shapes_in_images(root: Usd.Prim) -> list[Usd.Prim]:
    """Shapes in images of a dataset besides targets: those that it names, and all shapes of a lit stage."""
    stage = root.GetStage()
    tops = targets(root, "plen:occluders", "Imageable")
    below = (prim for top in tops for prim in Usd.PrimRange(top) if prim == top or is_in_images(prim))
    named = dict.fromkeys(prim for prim in below if is_drawn(prim))
    if not scene_reader().is_lit(stage):
        return list(named)
    mesh_targets = (prim for prim in stage.Traverse() if prim.IsA("PlenMeshTarget"))
    of_targets = {mesh for prim in mesh_targets for mesh in targets(prim, "plen:mesh", "Mesh")}
    unnamed = [prim for prim in stage.Traverse() if is_drawn(prim) and prim not in named and prim not in of_targets]
    return list(named) + [prim for prim in unnamed if is_in_images(prim) and not is_preview(prim)]


@read_once
def equal_shapes_in_images(root: Usd.Prim) -> list[list[Usd.Prim]]:
    """The shapes of `shapes_in_images`, in groups of equal ones."""
    return alike(shapes_in_images(root), lambda prim: shape_key(prim, 0.0 if is_animated(prim) else None))


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


@partial(read_once, named=shape_key)
def read_occluder(prim: Usd.Prim, frame: int | None = None) -> Occluder:
    """The triangles of a shape in its own frame [mm], dark without PlenOccluderAPI."""
    shape = drawn(prim, frame)
    return Occluder(
        vertices_mm=shape.points * stage_mm_per_unit(prim),
        triangles=shape.triangles,
        radiance=read(prim, "plen:radiance") or 0.0,
    )


def check_occluders(root: Usd.Prim, wrong: Set[Sdf.Path]) -> Iterator[Problem]:
    """Problems of the occluders of a dataset except poses; `wrong` holds the prims with wrong values."""
    meshes = {target(prim, "plen:mesh", "Mesh"): prim for prim in targets(root, "plen:targets", "PlenMeshTarget")}
    groups = [[prim for prim in equal if prim.GetPath() not in wrong] for equal in equal_shapes_in_images(root)]
    frames = frame_numbers(root)
    triangles = 0
    for prim in [prim for equal in groups for prim in equal if prim in meshes]:
        message = f"<{prim.GetPath()}> is the mesh of the target <{meshes[prim].GetPath()}>"
        hint = "targets hide each other and themselves without being named"
        yield problem(root.GetRelationship("plen:occluders"), "occluder-is-target", message, hint=hint)
    for equal in filter(None, groups):
        try:
            shapes = [drawn(equal[0], moment) for moment in (frames if is_animated(equal[0]) else [None])]
        except UnreadableValue as error:
            yield of_reader(equal[0], error)
            continue
        triangles += len(equal) * sum(len(shape.corners) for shape in shapes)
        for flaw in dict.fromkeys(flaw for shape in shapes for flaw in shape.flaws):
            yield from (not_drawn(prim, f"<{prim.GetPath()}>: {flaw}") for prim in equal if prim not in meshes)
    yield from over_limit(root, "shapes", triangles, f"{triangles:,} triangles of all occluders, in all frames,")


def check_outside_lens(camera: Usd.Prim, root: Usd.Prim, frames: tuple[int, ...]) -> Iterator[Problem]:
    """Problems of occluders that enter the lens of a camera; beside and behind it they are allowed."""
    if not (groups := equal_shapes_in_images(root)):
        return
    ends_mm, radius_mm = body_of(prescription_of(camera))
    lens_mm = np.array([[0.0, 0.0, end] for end in ends_mm])
    scale_mm = stage_mm_per_unit(root)
    vision_from_world = camera_from_world(camera, frames, scale_mm)
    for equal, (index, number) in itertools.product(groups, enumerate(frames)):
        time = number if is_animated(equal[0]) else None
        if not len(drawn(equal[0], time).corners):
            continue
        # Test the poses of all equal shapes by their spheres first, then triangle by triangle.
        shape = read_occluder(equal[0], time)
        world_from_shape = np.array([world_from(prim, frames, scale_mm)[index] for prim in equal])
        poses = product(vision_from_world[index], world_from_shape)
        for i in np.flatnonzero(shape.may_reach(poses, lens_mm, radius_mm)):
            occluder = equal[i]
            corners_mm = apply(poses[i], shape.vertices_mm)[shape.triangles]
            if is_visible(occluder, float(number)) and meets_lens(corners_mm, ends_mm, radius_mm):
                message = (
                    f'"{occluder.GetName()}" reaches into the lens of "{camera_name(camera, root)}" at time code'
                    f" {number}, z = {ends_mm[0]:.6g} to {ends_mm[1]:.6g} mm and {radius_mm:.6g} mm about the axis"
                )
                hint = "the camera looks along its -Z; its origin is the aperture stop"
                moving = moving_op(occluder)
                sample = float(number) if moving else None
                yield problem(moving or occluder, "inside-lens", message, hint=hint, time=sample)


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
    # The axis goes through the part if it lies on one side of all edges; else take the nearest point of any edge.
    edge = np.roll(part, -1, axis=0) - part
    side = part[:, 0] * edge[:, 1] - part[:, 1] * edge[:, 0]
    if (side > 0).all() or (side < 0).all():
        return 0.0
    squared = np.maximum(np.sum(edge**2, axis=1), 1e-300)
    share = np.clip(-np.sum(part * edge, axis=1) / squared, 0.0, 1.0)
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
