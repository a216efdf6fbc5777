"""Checks of units and up axes of third-party files, which a transform may convert where they are referenced: USD does
not.
"""

import math
from collections.abc import Iterator

import numpy as np
from pxr import Pcp, Sdf, Usd, UsdGeom

from pipeline.scene.usd.plug_in import ThirdPartyLayers
from pipeline.scene.usd.poses import ancestry, xform_ops
from pipeline.scene.usd.problems import Problem, at_opinion, shown_path, specs, warning

_SAME = 1e-6
"""Relative difference of equal units [1]: some programs write them in single precision."""
_CONVERTING = 1 / 3
"""Least ratio of the logarithms of a scale and of the ratio of units for a scale that is meant as a conversion [1]:
things fitted into a scene have another scale than the ratio, and things that are only stretched hardly any.
"""
_RESOLVING = ":unitsResolve"
"""Suffix of the operations by which USD's own tools convert units and axes."""
_UPRIGHT = 0.7
"""Least cosine of an axis and its image under a transform that does not turn it [1]: 45 degrees."""


def check_units(stage: Usd.Stage, third_party: ThirdPartyLayers) -> Iterator[Problem]:
    """A warning for each prim that references a file of other units or another up axis without converting them."""
    for prim in stage.Traverse() if third_party.layers else ():
        if prim.HasAuthoredReferences() or prim.HasAuthoredPayloads():
            for arc in Usd.PrimCompositionQuery(prim).GetCompositionArcs():
                is_used = arc.GetArcType() in (Pcp.ArcTypeReference, Pcp.ArcTypePayload) and not arc.IsAncestral()
                if is_used and arc.GetTargetLayer() in third_party.layers and (fault := _unconverted(prim, arc)):
                    introducing = arc.GetIntroducingLayer().GetPrimAtPath(arc.GetIntroducingPrimPath())
                    yield at_opinion(introducing, fault)
                    break


def _unconverted(prim: Usd.Prim, arc: Usd.CompositionArc) -> Problem | None:
    """A warning if units or up axis of a referenced file differ from those of the stage, and no transform converts."""
    stage_stack, file_stack = arc.GetIntroducingNode().layerStack, arc.GetTargetNode().layerStack
    mine, file = stage_stack.identifier.rootLayer, file_stack.identifier.rootLayer
    (unit, up), (its_unit, its_up) = _units(mine), _units(file)
    if min(unit, its_unit) <= 0 or (unit, up) == (its_unit, its_up):
        return None
    layers = set(stage_stack.layers), set(file_stack.layers)
    here = "here" if mine == prim.GetStage().GetRootLayer() else f"in {shown_path(mine.realPath)}"
    # Is the scale the ratio of units, by the suffix of its operations or by its size?
    ratio = its_unit / unit
    matrix = _matrix(prim, *layers)
    scale, resolved = (float(abs(np.linalg.det(m)) ** (1 / 3)) for m in (matrix, _matrix(prim, *layers, _RESOLVING)))
    is_sized = min(abs(ratio - 1), abs(resolved / ratio - 1)) <= _SAME
    is_sized = is_sized or (scale > 0 and math.log(scale) / math.log(ratio) > _CONVERTING)
    # Is the file's up axis turned away by 45 degrees at least?
    axis = np.eye(3)["XYZ".index(its_up)]
    is_turned = up == its_up or axis @ matrix @ axis < _UPRIGHT * np.linalg.norm(matrix @ axis)
    if is_sized and is_turned:
        return None
    # The operations that would convert.
    faults, ops = [], []
    if not is_turned:
        ops += [(f"double xformOp:rotateX{_RESOLVING}", "-90" if its_up == "Z" else "90")]
        faults += [f"{its_up} is up in {shown_path(file.realPath)}, {up} {here}, and nobody turns it"]
    if not is_sized:
        ops += [(f"double3 xformOp:scale{_RESOLVING}", f"({ratio:.10g}, {ratio:.10g}, {ratio:.10g})")]
        cache = UsdGeom.BBoxCache(Usd.TimeCode.EarliestTime(), [UsdGeom.Tokens.default_, UsdGeom.Tokens.render])
        box = cache.ComputeWorldBound(prim).ComputeAlignedRange()
        metres = max(box.GetSize()) * UsdGeom.GetStageMetersPerUnit(prim.GetStage()) if not box.IsEmpty() else 0.0
        sizes = f"is {_length(metres * ratio / (scale or 1.0))} large by its own units and {_length(metres)} here"
        counted = (
            f'metersPerUnit is {its_unit:g} in {shown_path(file.realPath)} and {unit:g} {here}: "{prim.GetName()}" '
        )
        faults += [counted + (sizes if metres > 0 else "has lengths of another unit")]
    hint = f"write {' and '.join(f'{op} = {value}' for op, value in ops)}, and {_order(prim, *layers, ops)}"
    if not prim.IsA(UsdGeom.Xformable):
        hint = f"put it below an Xform; there {hint}"
    return warning(prim, "asset-units", "; ".join(faults), hint=hint)


def _units(layer: Sdf.Layer) -> tuple[float, str]:
    """Metres per unit and upward axis of the root layer of a layer stack."""
    root = layer.pseudoRoot
    unit = root.GetInfo("metersPerUnit") if root.HasInfo("metersPerUnit") else UsdGeom.LinearUnits.centimeters
    up = str(root.GetInfo("upAxis")) if root.HasInfo("upAxis") else UsdGeom.GetFallbackUpAxis()
    return float(unit), up if up in ("Y", "Z") else "Y"


def _matrix(prim: Usd.Prim, stage_layers: set[Sdf.Layer], file_layers: set[Sdf.Layer], kind: str = "") -> np.ndarray:
    """Linear part of the transforms above a referenced prim, on column vectors (3, 3), without those of its own file.

    `kind`: suffix of the names of the operations that count.
    """
    matrix = np.eye(3)
    for link in ancestry(prim):
        # Whether the prim lies below one that the stage's own layers place.
        is_inside = any(spec.layer in stage_layers for spec in specs(link.GetParent()))
        for op in reversed(xform_ops(link)):
            layer = next((spec.layer for spec in specs(op.GetAttr())), None)
            if op.GetName().endswith(kind) and (layer in stage_layers or (is_inside and layer not in file_layers)):
                matrix = np.array(op.GetOpTransform(Usd.TimeCode.EarliestTime()))[:3, :3].T @ matrix
    return matrix


def _order(
    prim: Usd.Prim, stage_layers: set[Sdf.Layer], file_layers: set[Sdf.Layer], ops: list[tuple[str, str]]
) -> str:
    """The xformOpOrder of the referencing layers, with the conversion in front of the operations of the file."""
    names = list(prim.GetAttribute("xformOpOrder").Get() or ()) if prim.GetAttribute("xformOpOrder") else []
    layer_of = {name: next(iter(specs(at))).layer for name in names if (at := prim.GetAttribute(name))}
    added = [op.split()[1] for op, _ in ops]
    own = [name for name in names if name not in layer_of or layer_of[name] in stage_layers]
    of_file = [name for name in names if layer_of.get(name) in file_layers]
    order = [name for name in own if name not in added] + added + of_file
    return "uniform token[] xformOpOrder = [" + ", ".join(f'"{name}"' for name in order) + "]"


def _length(metres: float) -> str:
    """A length in km, m, mm, µm or nm."""
    for unit, size in (("km", 1e3), ("m", 1.0), ("mm", 1e-3), ("µm", 1e-6)):
        if metres >= size:
            return f"{metres / size:.3g} {unit}"
    return f"{metres / 1e-9:.3g} nm"
