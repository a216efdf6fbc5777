"""Checks of poses of cameras, targets and occluders: one sample per frame, rigid, targets in front of the camera."""

import math
from collections.abc import Iterator

import numpy as np
from pxr import Gf, Usd, UsdGeom

from pipeline.camera.pupil.from_stop import pupil_fan
from pipeline.frames import apply
from pipeline.optics.prescription import Prescription
from pipeline.scene.occluders import body_of, check_outside_lens, meets_lens, shapes_in_images
from pipeline.scene.targets import read_target
from pipeline.scene.usd.plug_in import scene_reader
from pipeline.scene.usd.poses import (
    ancestry,
    camera_from_world,
    camera_name,
    frame_numbers,
    is_orient,
    moving_op,
    product,
    quaternion,
    stage_mm_per_unit,
    world_from,
    xform_ops,
)
from pipeline.scene.usd.problems import Problem, problem, specs, warning
from pipeline.scene.usd.values import read, targets
from pipeline.scene.windows import WINDOWS, check_standing, prescription_of
from pipeline.spelling import frames_in_words

# Deviation of a quaternion from unit length that is accepted silently: the resolution of its type.
_ROUNDING = {
    UsdGeom.XformOp.PrecisionDouble: 1e-12,
    UsdGeom.XformOp.PrecisionFloat: 1e-6,
    UsdGeom.XformOp.PrecisionHalf: 1e-3,
}
_MENDABLE = 1e-3
"""Deviation of a quaternion from unit length up to which it is normalised with a warning: the resolution of half
precision. A worse one was not meant as a rotation.
"""
_METRES_MM = 5.0
"""Distance of a target from the stop below which metres are suspected [mm]: they would be one to five metres."""
_RIGID = 1e-9
"""Largest deviation of the columns of a rotation from orthonormal ones."""


def check_poses(root: Usd.Prim) -> Iterator[Problem]:
    """Problems of the poses of a dataset whose prims have no errors."""
    frames = tuple(frame_numbers(root))
    cameras = [prim for prim in targets(root, "plen:cameras", "Camera") if prim.HasAPI("PlenCameraAPI")]
    boards = targets(root, "plen:targets", "PlenTarget")
    windows = list(dict.fromkeys(prim for camera in cameras for prim in targets(camera, WINDOWS, "PlenWindow")))
    rigid = [*cameras, *boards, *windows]
    occluders, lamps = shapes_in_images(root), scene_reader().lamp_prims(root.GetStage())
    moved = dict.fromkeys(link for prim in [*rigid, *occluders, *lamps] for link in ancestry(prim))
    exact = {link for prim in rigid for link in ancestry(prim)}
    problems = [bad for link in moved if specs(link) for bad in _check_link(link, frames, is_exact=link in exact)]
    if not any(bad.is_error for bad in problems):
        problems += [bad for prim in rigid for bad in _check_rigid(prim, frames)]
    yield from problems
    if not any(bad.is_error for bad in problems):
        patches = [read_target(board).patches() for board in boards]
        shapes = [
            np.concatenate([apply(patch.target_from_patch, patch.mesh()) for patch in of_board]) for of_board in patches
        ]
        for camera in cameras:
            yield from _check_before_camera(camera, boards, shapes, root, frames)
            yield from check_outside_lens(camera, root, frames)
            yield from check_standing(camera, boards, shapes, frames)


def _check_link(prim: Usd.Prim, frames: tuple[int, ...], *, is_exact: bool) -> Iterator[Problem]:
    """Problems of the operations of one prim; `is_exact`: the pose of a camera, target or window depends on it."""
    for op in xform_ops(prim):
        attribute = op.GetAttr()
        times = set(attribute.GetTimeSamples()) if not attribute.HasSpline() else set(frames)
        present = [number for number in frames if not times or number in times]
        if missing := sorted(set(frames).difference(present)):
            more = f" and {len(missing) - 5} more" if len(missing) > 5 else ""
            listed = ", ".join(map(str, missing[:5])) + more
            message = f'"{attribute.GetName()}" has no sample at time code {listed}'
            # Third-party scenes have key frames: an occluder may be where viewers of USD show it.
            hint = "USD would interpolate silently; write one sample per frame" if is_exact else "USD interpolates"
            severity = "error" if is_exact else "warning"
            yield problem(attribute, "no-pose-sample", message, hint=hint, severity=severity)
            present = present if is_exact else list(frames)
        for number in present if times else present[:1]:
            yield from _check_op(op, number, number if times else None)


def _check_op(op: UsdGeom.XformOp, number: int, sample: float | None) -> Iterator[Problem]:
    """Problems of the value of an operation in a frame; `sample`: the time of its sample, None for a default value."""
    attribute = op.GetAttr()
    value = attribute.Get(float(number))
    if value is None and op.GetOpType() != UsdGeom.XformOp.TypeInvalid:
        yield problem(attribute, "no-pose-sample", f'"{attribute.GetName()}" has no value at time code {number}')
    elif op.GetOpType() == UsdGeom.XformOp.TypeTransform and not Gf.IsClose(
        Gf.Matrix4d(value).GetColumn(3), Gf.Vec4d(0, 0, 0, 1), _ROUNDING.get(op.GetPrecision(), 1e-12)
    ):
        message = f'"{attribute.GetName()}" is no affine matrix: its last column is {value.GetColumn(3)}'
        yield warning(attribute, "not-affine", message, hint="it counts as (0, 0, 0, 1)", time=sample)
    elif is_orient(op):
        components = quaternion(op, float(number)) or (math.nan,)
        deviation = abs(math.sqrt(sum(component * component for component in components)) - 1.0)
        if math.isnan(deviation) or deviation <= _ROUNDING.get(op.GetPrecision(), 1e-12):
            return  # NaN is reported elsewhere as not finite
        if deviation >= _MENDABLE:
            message = f"the quaternion is {deviation:.3g} off unit length, so it is no rotation"
            yield problem(attribute, "non-rigid", message, hint="write a unit quaternion (w, x, y, z)", time=sample)
        else:
            message = f"the quaternion is {deviation:.3g} off unit length; it is normalised"
            yield warning(attribute, "normalised", message, time=sample)


def _check_rigid(prim: Usd.Prim, frames: tuple[int, ...]) -> Iterator[Problem]:
    """A problem of a transform to the world that is no rotation, at the first frame."""
    # The columns of a rotation R are orthonormal, R^T R = 1, and its determinant is 1.
    rotation = world_from(prim, frames, 1.0)[:, :3, :3]
    deviation = np.abs((rotation[:, :, :, None] * rotation[:, :, None, :]).sum(axis=1) - np.eye(3)).max(axis=(1, 2))
    mirrored = np.linalg.det(rotation) < 0
    bad = np.flatnonzero((deviation > _RIGID) | mirrored)  # NaN is reported elsewhere as not finite
    if len(bad):
        first = bad[0]
        fault = "mirrors" if mirrored[first] and deviation[first] <= _RIGID else "scales or shears"
        message = f"the transform from <{prim.GetPath()}> to the world {fault} at time code {frames[first]}"
        yield problem(_scaling_link(prim), "non-rigid", message, hint="use only translations and rotations")


def _scaling_link(prim: Usd.Prim) -> Usd.Prim | Usd.Property:
    """The transform operation most likely to blame."""
    for link in ancestry(prim):
        for op in xform_ops(link):
            if op.GetOpType() in (UsdGeom.XformOp.TypeScale, UsdGeom.XformOp.TypeTransform):
                return op.GetAttr()
    return prim


def _is_beside(prescription: Prescription, triangles_mm: np.ndarray) -> bool:
    """Whether a shape, (m, 3, 3) vision frame, stands beside a lens that may see points beside it."""
    return pupil_fan(prescription).is_wide and not meets_lens(triangles_mm, *body_of(prescription))


def _check_before_camera(
    camera: Usd.Prim, boards: list[Usd.Prim], shapes: list[np.ndarray], root: Usd.Prim, frames: tuple[int, ...]
) -> Iterator[Problem]:
    """Problems of targets that are not entirely, margins included, in front of the first vertex of the lens.

    Before a lens that sees farther round they may also stand beside it.
    """
    prescription = prescription_of(camera)
    first_mm = -prescription.vertices_from_stop_mm[0]
    is_direct = read(camera, "plen:truth:method") == "direct"
    scale_mm = stage_mm_per_unit(root)
    vision_from_world = camera_from_world(camera, frames, scale_mm)
    for board, triangles in zip(boards, shapes, strict=True):
        vision_from_board = product(vision_from_world, world_from(board, frames, scale_mm))
        corners = triangles.reshape(-1, 3)
        nearest_mm = (corners @ vision_from_board[:, 2, :3].T + vision_from_board[:, 2, 3]).min(axis=0)
        too_near = [
            number
            for number in np.flatnonzero(nearest_mm <= first_mm)
            if not (is_direct and _is_beside(prescription, apply(vision_from_board[number], triangles)))
        ]
        if not len(too_near):
            continue
        first = too_near[0]  # one problem for all frames, told by the first
        number = frames[first]
        z_mm = nearest_mm[first]
        origin_mm = np.linalg.norm(vision_from_board[first, :3, 3])
        where, side = ("behind", "behind") if z_mm <= 0 else ("into the lens of", "before")
        listed = frames_in_words(frames[i] for i in too_near) + (f"; in frame {number}" if len(too_near) > 1 else ":")
        message = (
            f'"{board.GetName()}" reaches {where} "{camera_name(camera, root)}" in {listed} its nearest corner lies'
            f" {abs(z_mm):.6g} mm {side} the stop, and the first vertex {first_mm:.6g} mm before it"
        )
        hint = "the camera looks along its -Z: what it sees has a negative z"
        if pupil_fan(prescription).is_wide and not is_direct:
            hint = 'planes across the axis do not reach beside a lens: plen:truth:method = "direct" finds what it sees'
        if origin_mm < _METRES_MM:
            hint = f"its origin is only {origin_mm:.3g} mm from the stop: were metres meant? The stage is in mm"
        moving = moving_op(board)
        code = "behind-camera" if z_mm <= 0 else "inside-lens"
        yield problem(moving or board, code, message, hint=hint, time=float(number) if moving else None)
