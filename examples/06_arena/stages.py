"""USD stages of the arena: a stage beside this file, some values, and poses of its boards."""

from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd
from scipy.spatial.transform import Rotation

import pipeline.scene  # noqa: F401  # the schemas are known before any stage is opened

HERE = Path(__file__).resolve().parent
Values = dict[str, dict[str, Any]]
"""Values of attributes, whose types the stage declares, by path below /Arena and name without `plen:`."""


def opened(path: Path) -> Usd.Stage:
    """A copy of a stage in memory."""
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.TransferContent(Sdf.Layer.FindOrOpen(str(path)))
    return Usd.Stage.Open(layer)


def with_values(stage: Usd.Stage, values: Values) -> None:
    """Set values that are not None."""
    for path, attributes in values.items():
        for name, value in attributes.items():
            if value is not None:
                stage.OverridePrim(f"/Arena/{path}").GetAttribute(f"plen:{name}").Set(value)


def pose(stage: Usd.Stage, path: str, shifts_mm: np.ndarray, turns: list[Rotation]) -> None:
    """Place a prim in frames 1, 2, …: in USD's camera frame, x right, y up and z backwards."""
    prim = stage.OverridePrim(path)
    shift = prim.CreateAttribute("xformOp:translate", Sdf.ValueTypeNames.Double3, False)
    orient = prim.CreateAttribute("xformOp:orient", Sdf.ValueTypeNames.Quatd, False)
    for frame, (at, turn) in enumerate(zip(shifts_mm.tolist(), turns, strict=True), 1):
        i, j, k, real = turn.as_quat().tolist()
        shift.Set(Gf.Vec3d(at), frame)
        orient.Set(Gf.Quatd(real, i, j, k), frame)
    order = prim.CreateAttribute("xformOpOrder", Sdf.ValueTypeNames.TokenArray, False, Sdf.VariabilityUniform)
    order.Set(["xformOp:translate", "xformOp:orient"])
    stage.SetEndTimeCode(len(turns))
