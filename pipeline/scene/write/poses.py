"""Overrides of the poses of targets by poses from outside of a stage."""

from collections.abc import Mapping

import numpy as np
from pxr import Gf, Usd, UsdGeom, Vt

from pipeline.scene.usd.overrides import Overrides
from pipeline.scene.usd.poses import stage_mm_per_unit

_OP = "xformOp:transform:asFitted"
"""Operation that replaces a prim's own, and all above it."""


def posed(stage: Usd.Stage, prim_path: str, poses: Mapping[int, np.ndarray]) -> Overrides:
    """Overrides by which a prim has poses (4, 4) world_from_prim [mm] at time codes."""
    prim, samples = stage.GetPrimAtPath(prim_path), {}
    for time, pose in poses.items():
        in_units = pose.copy()
        in_units[:3, 3] /= stage_mm_per_unit(prim)
        samples[Usd.TimeCode(time)] = Gf.Matrix4d(*in_units.T.ravel().tolist())
    order = UsdGeom.Xformable(prim).GetXformOpOrderAttr().GetPath()
    alone = Vt.TokenArray([UsdGeom.XformOpTypes.resetXformStack, _OP])
    return {prim.GetPath().AppendProperty(_OP): samples, order: {Usd.TimeCode.Default(): alone}}
