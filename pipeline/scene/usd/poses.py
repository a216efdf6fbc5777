"""Time codes of a dataset, and transforms of prims with the same bits on every machine.

Quaternions are normalised first; USD's own matrices take them as they are. Products are summed in a fixed order instead
of by BLAS, whose sums depend on the processor.
"""

import itertools
import math
from collections.abc import Sequence
from functools import partial

import numpy as np
from pxr import Tf, Usd, UsdGeom

from pipeline.frames import VISION_FROM_CAMERA, mm_per_unit, rigid
from pipeline.scene.usd.readers import note_read, read_once
from pipeline.scene.usd.values import plain, read

Times = Sequence[float | Usd.TimeCode]
"""Time codes; of USD's own kind also those just before a jump."""
LAST_FRAME = 1_000_000_000
"""Largest absolute time code that is accepted as a frame."""
_ANY_TIME = 0.0
"""Time code at which a constant visibility is read."""
_SHOWN = (UsdGeom.Tokens.default_, UsdGeom.Tokens.render)
"""Purposes of prims in images."""


@read_once
def ancestry(prim: Usd.Prim) -> tuple[Usd.Prim, ...]:
    """The prim and its ancestors, up to the last one whose transform counts."""
    if not prim or prim.IsPseudoRoot():
        return ()
    own = (prim,) if prim.IsA(UsdGeom.Xformable) else ()
    return own if own and UsdGeom.Xformable(prim).GetResetXformStack() else own + ancestry(prim.GetParent())


def xform_ops(prim: Usd.Prim) -> list[UsdGeom.XformOp]:
    """Operations of a prim's own transform; the first one listed is applied last."""
    ops = list(UsdGeom.Xformable(prim).GetOrderedXformOps())
    note_read(prim, "xformOpOrder", *(op.GetAttr().GetName() for op in ops))
    return ops


def is_op(prim: Usd.Prim, name: str) -> bool:
    """Whether an entry of an xformOpOrder names an operation of a prim, or resets the transforms above."""
    try:
        return name == "!resetXformStack!" or bool(UsdGeom.XformOp(prim.GetAttribute(name.removeprefix("!invert!"))))
    except Tf.ErrorException:
        return False  # USD raises it for other beginnings and kinds, and for no name


def moving_op(prim: Usd.Prim) -> Usd.Attribute | None:
    """The first animated operation of a prim's own transform."""
    return next((op.GetAttr() for op in xform_ops(prim) if op.MightBeTimeVarying()), None)


def is_visible(prim: Usd.Prim, time: float) -> bool:
    """Whether USD shows a prim in a frame."""
    comes_and_goes(prim)  # notes what it depends on
    return bool(UsdGeom.Imageable(prim).ComputeVisibility(time) != UsdGeom.Tokens.invisible)


@read_once
def comes_and_goes(prim: Usd.Prim) -> bool:
    """Whether a prim may be visible in some frames and invisible in others."""
    if prim.IsPseudoRoot():
        return False
    note_read(prim, "visibility")
    return comes_and_goes(prim.GetParent()) or prim.GetAttribute("visibility").ValueMightBeTimeVarying()


def is_in_images(prim: Usd.Prim) -> bool:
    """Whether a prim has a purpose for images, and is visible at some time."""
    return UsdGeom.Imageable(prim).ComputePurpose() in _SHOWN and (comes_and_goes(prim) or is_visible(prim, _ANY_TIME))


@partial(read_once, named=lambda prim, times, *more: (prim, tuple(times), *more))
def world_from(prim: Usd.Prim, times: Times, mm_per_unit: float, below: Usd.Prim | None = None) -> np.ndarray:
    """Transforms from a prim to the world at times, on column vectors (n, 4, 4) [mm]; rigid only if the stage is.

    `below`: an ancestor that takes the place of the world.
    """
    world_from_prim = np.eye(4)
    for link in itertools.takewhile(lambda link: link != below, ancestry(prim)):
        if (parent_from_link := _parent_from(link, tuple(times), mm_per_unit)) is not None:
            world_from_prim = product(parent_from_link, world_from_prim)
    return np.broadcast_to(world_from_prim, (len(times), 4, 4))


@read_once
def _parent_from(link: Usd.Prim, times: tuple[float, ...], mm_per_unit: float) -> np.ndarray | None:
    """A prim's own transform at times, (n, 4, 4), or (4, 4) if it does not move; None if it has none."""
    if not (ops := xform_ops(link)):
        return None
    parent_from_link = np.eye(4)
    for op in ops:
        op_times = times if op.MightBeTimeVarying() else times[:1]
        op_matrices = np.array([_op_matrix(op, Usd.TimeCode(time), mm_per_unit) for time in op_times])
        parent_from_link = product(parent_from_link, op_matrices)
    return parent_from_link


def product(a_from_b: np.ndarray, b_from_c: np.ndarray) -> np.ndarray:
    """a_from_b @ b_from_c, summed in a fixed order; (..., 4, 4) both."""
    products: np.ndarray = (a_from_b[..., :, :, None] * b_from_c[..., None, :, :]).sum(axis=-2)
    return products


def inverse(a_from_b: np.ndarray) -> np.ndarray:
    """b_from_a of rigid transforms, summed in a fixed order; (..., 4, 4)."""
    rotation = np.swapaxes(a_from_b[..., :3, :3], -1, -2)
    b_from_a = np.zeros_like(a_from_b)
    b_from_a[..., :3, :3] = rotation
    b_from_a[..., :3, 3] = -(rotation * a_from_b[..., None, :3, 3]).sum(axis=-1)
    b_from_a[..., 3, 3] = 1.0
    return b_from_a


def quaternion(op: UsdGeom.XformOp, time: float | Usd.TimeCode) -> tuple[float, float, float, float] | None:
    """Real part and imaginary parts of an orient operation; None if it has no value."""
    # Read from the attribute: the operation would return the inverse for an inverted one.
    value = op.GetAttr().Get(time)
    return None if value is None else plain(value)


def is_orient(op: UsdGeom.XformOp) -> bool:
    """Whether an operation is a rotation by a quaternion."""
    return op.GetOpType() == UsdGeom.XformOp.TypeOrient


def _op_matrix(op: UsdGeom.XformOp, time: Usd.TimeCode, mm_per_unit: float) -> np.ndarray:
    """Matrix of an operation on column vectors, (4, 4) [mm]."""
    if not is_orient(op):
        # USD's matrices act on row vectors. Only their translation has a unit.
        matrix = np.array(op.GetOpTransform(time), dtype=np.float64).T
        matrix[:3, 3] *= mm_per_unit
        matrix[3] = 0.0, 0.0, 0.0, 1.0  # a projective part would mix with the transforms above
        return matrix
    real, *imaginary = quaternion(op, time) or (1.0, 0.0, 0.0, 0.0)
    sign = -1.0 if op.IsInverseOp() else 1.0
    return rigid(_rotation(real, *(sign * part for part in imaginary)), np.zeros(3))


def _rotation(w: float, x: float, y: float, z: float) -> np.ndarray:
    """Rotation matrix of a quaternion, normalised, (3, 3)."""
    length = math.sqrt(w * w + x * x + y * y + z * z)
    w, x, y, z = w / length, x / length, y / length, z / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def frame_numbers(root: Usd.Prim) -> Sequence[int]:
    """Time codes of a dataset, in the order in which they are built; empty if the stage names none."""
    frames = read(root, "plen:frames")
    if frames:
        return tuple(sorted(set(frames)))
    stage = root.GetStage()
    note_read(stage.GetPseudoRoot())  # metadata of the layer
    if not (stage.HasAuthoredMetadata("startTimeCode") and stage.HasAuthoredMetadata("endTimeCode")):
        return ()
    start, end = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    if not (start.is_integer() and end.is_integer() and max(abs(start), abs(end)) <= LAST_FRAME):
        return ()
    return range(int(start), int(end) + 1)  # a list would be made before its length can be checked


def camera_name(prim: Usd.Prim, root: Usd.Prim) -> str:
    """Path of a camera below the dataset, with dots instead of slashes."""
    return str(prim.GetPath().MakeRelativePath(root.GetPath())).replace("/", ".")


def camera_from_world(prim: Usd.Prim, times: Times, scale_mm: float) -> np.ndarray:
    """Vision frame of a camera from the world at times, (n, 4, 4) [mm]."""
    return product(VISION_FROM_CAMERA, inverse(world_from(prim, times, scale_mm)))


def stage_mm_per_unit(prim: Usd.Prim) -> float:
    """Millimetres in one unit of the stage of a prim."""
    return mm_per_unit(UsdGeom.GetStageMetersPerUnit(prim.GetStage()))
