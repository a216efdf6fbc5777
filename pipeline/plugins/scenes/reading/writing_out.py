"""Point instancers written out as prims, and skinned meshes baked at each frame, in the session layer of a stage: no
file changes.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Any

from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdShade, UsdSkel, Vt

from pipeline.limits import limits
from pipeline.scene.usd.problems import Problem, not_drawn, over_limit
from pipeline.scene.usd.values import plain

_INSTANCE = "Instance_"
"""Beginning of the names of prims that stand for an instance, below its point instancer."""
_SAME = 1e-9
"""Difference of elements of equal transforms [unit of the stage]: both are doubles, written out in full."""
_BAKED = ("points", "xformOp:transform")
_WEIGHTS = ("translations", "rotations", "scales", "blendShapeWeights")


def write_out(stage: Usd.Stage, frames: Sequence[int]) -> list[Problem]:
    """Write out all point instancers, and all skeletons at the frames; problems of what cannot be. Native instances
    must have been written out before.
    """
    if len(frames) > limits().frames:
        return []  # reported by the checks
    done = set[Sdf.Path]()
    count = 0
    problems = list[Problem]()
    while waiting := [prim for prim in _instancers(stage) if prim.GetPath() not in done]:
        prim = waiting[0]
        done.add(prim.GetPath())
        try:
            instances = _instances(UsdGeom.PointInstancer(prim), frames)
        except (Tf.ErrorException, TypeError, ValueError, IndexError):
            fault = "its prototypes, protoIndices and arrays of values do not fit, or are not finite"
            message = f"<{prim.GetPath()}> is not drawn: {fault}"
            problems.append(not_drawn(prim, message))
            _write_instances(prim, [])  # hides the prototypes
            continue
        if _is_written_out(prim):  # the dataset.usda of a build has the instances already
            problems += _check_written(prim, instances)
            continue
        count += len(instances)
        if over := over_limit(prim, "instances", count, f"{count:,} instances of point instancers"):
            return [*problems, *over]
        problems += _write_instances(prim, instances)
    problems += _bake(stage, frames)
    return problems


def _instancers(stage: Usd.Stage) -> Iterator[Usd.Prim]:
    """Point instancers that are drawn: none for viewers alone, as the microlenses in the dataset.usda of a build are.

    Below one that is not written out yet lie its prototypes alone, which its instances repeat. Once it is, instancers
    below it count, too, and the prims that stand for its instances may hold further ones: `write_out` asks anew.
    """
    prims = iter(Usd.PrimRange(stage.GetPseudoRoot()))
    for prim in prims:
        if not prim.IsA(UsdGeom.PointInstancer):
            continue
        if UsdGeom.Imageable(prim).ComputePurpose() in (UsdGeom.Tokens.guide, UsdGeom.Tokens.proxy):
            prims.PruneChildren()
            continue
        yield prim
        if not _is_written_out(prim):
            prims.PruneChildren()


def _is_written_out(prim: Usd.Prim) -> bool:
    return any(child.GetName().startswith(_INSTANCE) for child in prim.GetChildren())


def _check_written(prim: Usd.Prim, instances: "list[_Instance]") -> Iterator[Problem]:
    """A warning if the instances below a point instancer are not those that it places: one of both was edited."""
    written = {child.GetName(): child for child in prim.GetChildren() if child.GetName().startswith(_INSTANCE)}
    placed = {f"{_INSTANCE}{number}": instance.poses for number, instance in enumerate(instances)}
    if written.keys() != placed.keys() or any(
        not Gf.IsClose(UsdGeom.Xformable(written[name]).GetLocalTransformation(frame), pose, _SAME)
        for name, poses in placed.items()
        for frame, pose in poses.items()
    ):
        message = f"<{prim.GetPath()}> places other instances than are written out below it, and these alone count"
        hint = f"edit the prims {_INSTANCE}0 and so on, or remove them all, and it is written out anew"
        yield not_drawn(prim, message, hint=hint)


@dataclass
class _Instance:
    """An instance: its prototype, and by frame its transform and its index in the arrays of the instancer."""

    prototype: Sdf.Path
    poses: dict[float, Gf.Matrix4d] = field(default_factory=dict)
    indices: dict[float, int] = field(default_factory=dict)


def _instances(instancer: UsdGeom.PointInstancer, frames: Sequence[int]) -> list[_Instance]:
    """The instances of all frames. One that keeps its id and prototype is the same instance in all of them."""
    prototypes = instancer.GetPrototypesRel().GetForwardedTargets()
    prim = instancer.GetPrim()
    moves = any(
        a.ValueMightBeTimeVarying() for a in prim.GetAuthoredAttributes() if not a.GetName().startswith("xform")
    )
    instances = dict[tuple[int, int], _Instance]()
    for frame in frames if moves else frames[:1]:
        time = Usd.TimeCode(frame)
        numbers = plain(instancer.GetProtoIndicesAttr().Get(time) or ())
        if min(numbers, default=0) < 0 or max(numbers, default=-1) >= len(prototypes):
            raise IndexError
        ids = plain(instancer.GetIdsAttr().Get(time) or range(len(numbers)))
        mask = list(instancer.ComputeMaskAtTime(time)) or [True] * len(numbers)
        poses = instancer.ComputeInstanceTransformsAtTime(time, time, instancer.ExcludeProtoXform, instancer.IgnoreMask)
        rows = zip(ids, numbers, mask, poses, strict=True)
        for index, (identity, number, is_drawn, pose) in enumerate(rows):
            if is_drawn:
                if not all(map(math.isfinite, chain(*pose))):
                    raise ValueError
                instance = instances.setdefault((identity, number), _Instance(prototypes[number]))
                instance.poses[float(frame)], instance.indices[float(frame)] = pose, index
    return list(instances.values())


def _write_instances(prim: Usd.Prim, instances: list[_Instance]) -> list[Problem]:
    """Write instances below a point instancer, each a transform above a reference to its prototype; warnings of
    primvars with too few values.
    """
    stage, path = prim.GetStage(), prim.GetPath()
    layer = stage.GetSessionLayer()
    frames = sorted({frame for instance in instances for frame in instance.poses})
    prototypes = {instance.prototype for instance in instances}
    bound = {prototype: _bound_above(stage.GetPrimAtPath(prototype), prim) for prototype in prototypes}
    hidden = {
        child.GetPath(): UsdGeom.Imageable(child).GetVisibilityAttr().Get() if child.GetTypeName() else "inherited"
        for child in prim.GetChildren()
        if child.IsA(UsdGeom.Imageable) or not child.GetTypeName()
    }
    primvars, problems = _primvars_by_frame(prim, instances, frames)
    with Sdf.ChangeBlock():
        for child_path in hidden:
            spec = Sdf.CreatePrimInLayer(layer, child_path)
            if not stage.GetPrimAtPath(child_path).GetTypeName():  # a prim without a type hides nothing
                spec.typeName = "Scope"
            _token(spec, "visibility").default = UsdGeom.Tokens.invisible
        for number, instance in enumerate(instances):
            placed = Sdf.CreatePrimInLayer(layer, path.AppendChild(f"{_INSTANCE}{number}"))
            placed.specifier = Sdf.SpecifierDef
            placed.typeName = "Xform"
            placed.instanceable = False
            _write_poses(placed, instance, frames)
            _write_primvars(placed, instance, primvars)
            for name, material in bound[instance.prototype].items():
                placed.SetInfo("apiSchemas", Sdf.TokenListOp.Create(prependedItems=["MaterialBindingAPI"]))
                Sdf.RelationshipSpec(placed, name, custom=False).targetPathList.explicitItems = [material]
            shape = Sdf.PrimSpec(placed, "Shape", Sdf.SpecifierDef)
            shape.referenceList.Prepend(Sdf.Reference("", instance.prototype))
            if instance.prototype in hidden:
                _token(shape, "visibility").default = hidden[instance.prototype]
    with Usd.EditContext(stage, layer):
        for number, instance in enumerate(instances):
            placed_prim = stage.GetPrimAtPath(path.AppendChild(f"{_INSTANCE}{number}"))
            for attribute in _carried_above(stage.GetPrimAtPath(instance.prototype), prim):
                if not placed_prim.HasProperty(attribute.GetName()):
                    attribute.FlattenTo(placed_prim)
    return problems


_Primvars = list[tuple[str, Sdf.ValueTypeName, dict[float, Any]]]
"""Names and types of primvars with a value for each instance, and the arrays of these by frame."""


def _primvars_by_frame(
    prim: Usd.Prim, instances: list[_Instance], frames: list[float]
) -> tuple[_Primvars, list[Problem]]:
    """Primvars of an instancer with a value for each instance, and warnings of those with too few values."""
    count = {frame: max(each.indices.get(frame, -1) for each in instances) + 1 for frame in frames}
    primvars, problems = _Primvars(), list[Problem]()
    for primvar in UsdGeom.PrimvarsAPI(prim).GetAuthoredPrimvars():
        if primvar.GetInterpolation() == UsdGeom.Tokens.constant or not primvar.GetTypeName().isArray:
            continue
        name = primvar.GetAttr().GetName()
        values = {frame: primvar.ComputeFlattened(frame) or () for frame in frames}
        if all(len(values[frame]) >= count[frame] for frame in frames):
            primvars.append((name, primvar.GetTypeName(), values))
        else:
            message = f'"{name}" has too few values for {max(count.values()):,} instances: none counts'
            problems.append(not_drawn(primvar.GetAttr(), message))
    return primvars, problems


def _write_primvars(placed: Sdf.PrimSpec, instance: _Instance, primvars: _Primvars) -> None:
    """Write the values of one instance, constant on its shape; samples where they change."""
    for name, kind, arrays in primvars:
        attribute = Sdf.AttributeSpec(placed, name, kind)
        attribute.SetInfo("interpolation", UsdGeom.Tokens.constant)
        values = {frame: type(arrays[frame])([arrays[frame][index]]) for frame, index in instance.indices.items()}
        attribute.default = first = next(iter(values.values()))
        for frame, value in values.items() if any(each != first for each in values.values()) else ():
            placed.layer.SetTimeSample(attribute.path, frame, value)


def _carried_above(prototype: Usd.Prim, instancer: Usd.Prim) -> list[Usd.Attribute]:
    """Primvars, and their indices, that a prototype inherits from prims above it, and its instances do not."""
    primvars = UsdGeom.PrimvarsAPI(prototype.GetParent()).FindPrimvarsWithInheritance()
    attributes = [attribute for each in primvars for attribute in (each.GetAttr(), each.GetIndicesAttr()) if attribute]
    return [each for each in attributes if not instancer.GetPath().HasPrefix(each.GetPrimPath())]


def _bound_above(prototype: Usd.Prim, instancer: Usd.Prim) -> dict[str, Sdf.Path]:
    """Materials by the names of their bindings, which prims above a prototype or collections bind to it, and which its
    instances do not inherit.
    """
    api, bindings = UsdShade.MaterialBindingAPI(prototype), dict[str, Sdf.Path]()
    for purpose in (UsdShade.Tokens.full, UsdShade.Tokens.preview):
        material, binding = api.ComputeBoundMaterial(purpose)
        above = binding.GetPrim().GetPath() if material else prototype.GetPath()
        words = binding.GetName().split(":")[2:] if material else []
        if above != prototype.GetPath() and ("collection" in words or not instancer.GetPath().HasPrefix(above)):
            bindings[f"material:binding:{purpose}" if purpose in words else "material:binding"] = material.GetPath()
    return bindings


def _write_poses(placed: Sdf.PrimSpec, instance: _Instance, frames: list[float]) -> None:
    """Write the transforms of an instance, and its visibility if it is not there in all frames."""
    order = Sdf.AttributeSpec(placed, "xformOpOrder", Sdf.ValueTypeNames.TokenArray, Sdf.VariabilityUniform)
    order.default = ["xformOp:transform"]
    transform = Sdf.AttributeSpec(placed, "xformOp:transform", Sdf.ValueTypeNames.Matrix4d)
    first = next(iter(instance.poses.values()))
    if len(frames) < 2:
        transform.default = first
        return
    visibility = _token(placed, "visibility") if len(instance.poses) < len(frames) else None
    for frame in frames:
        is_drawn = frame in instance.poses
        placed.layer.SetTimeSample(transform.path, frame, instance.poses.get(frame, first))
        if visibility:
            token = UsdGeom.Tokens.inherited if is_drawn else UsdGeom.Tokens.invisible
            placed.layer.SetTimeSample(visibility.path, frame, token)


def _token(prim: Sdf.PrimSpec, name: str) -> Sdf.AttributeSpec:
    return Sdf.AttributeSpec(prim, name, Sdf.ValueTypeNames.Token)


def _bake(stage: Usd.Stage, frames: Sequence[int]) -> list[Problem]:
    """Write the points of all skinned meshes at the frames, and only there: between them joints do not move evenly."""
    skinned = [prim for prim in stage.Traverse() if prim.HasAPI(UsdSkel.BindingAPI)]
    bound = [prim for prim in skinned if UsdSkel.Root.Find(prim)]
    roots = list(dict.fromkeys(UsdSkel.Root.Find(prim).GetPrim() for prim in bound))
    loose = list(map(_without_root, (prim for prim in skinned if _is_skinned(prim) and not UsdSkel.Root.Find(prim))))
    if not bound or not frames:
        return loose
    points = (UsdGeom.PointBased(prim).GetPointsAttr().Get() for prim in bound)
    count = sum(len(each) for each in points if isinstance(each, Vt.Vec3fArray)) * len(frames)
    if over := over_limit(bound[0], "shapes", count, f"{count:,} points of skinned meshes"):
        return over
    session = stage.GetSessionLayer()
    sampled = list[Sdf.Path]()
    with Usd.EditContext(stage, session):
        for animation in [prim for prim in stage.Traverse() if prim.IsA(UsdSkel.Animation)]:
            for attribute in filter(None, map(animation.GetAttribute, _WEIGHTS)):
                values = {frame: attribute.Get(frame) for frame in frames}
                fitting = type(attribute.GetTypeName().defaultValue)  # USD takes no other type
                if attribute.ValueMightBeTimeVarying() and all(isinstance(each, fitting) for each in values.values()):
                    for frame, value in values.items():
                        attribute.Set(value, frame)
                    sampled.append(attribute.GetPath())
        for prim in bound:
            _offer_normals(prim)
        for root in roots:
            UsdSkel.BakeSkinning(UsdSkel.Root(root), Gf.Interval(min(frames), max(frames)))
        for mesh in filter(None, map(UsdGeom.PointBased, bound)):
            if mesh.GetPointsAttr().GetNumTimeSamples() > mesh.GetNormalsAttr().GetNumTimeSamples():
                mesh.GetNormalsAttr().Block()  # of faces, which it does not turn
    with Sdf.ChangeBlock():
        for path in sampled:
            spec = session.GetAttributeAtPath(path)
            spec.owner.RemoveProperty(spec)
    _keep_frames(session, frames)
    unbaked = (prim for prim in bound if not _is_baked(session, prim.GetPath()))
    return loose + [_unbaked(prim) for prim in unbaked if prim.IsA(UsdGeom.Boundable) and _is_skinned(prim)]


def _keep_frames(layer: Sdf.Layer, frames: Sequence[int]) -> None:
    """Erase samples between the frames: UsdSkel bakes one at each integer."""
    paths = list[Sdf.Path]()
    layer.Traverse(Sdf.Path.absoluteRootPath, paths.append)
    with Sdf.ChangeBlock():
        for path in paths:
            for time in layer.ListTimeSamplesForPath(path) if path.IsPropertyPath() else ():
                if time not in frames:
                    layer.EraseTimeSample(path, time)


def _offer_normals(prim: Usd.Prim) -> None:
    """Move normals from a primvar to the attribute of the mesh: UsdSkel turns only these."""
    primvar, mesh = UsdGeom.PrimvarsAPI(prim).GetPrimvar("normals"), UsdGeom.PointBased(prim)
    if mesh and primvar and primvar.HasAuthoredValue():
        mesh.GetNormalsAttr().Set(primvar.ComputeFlattened(Usd.TimeCode.EarliestTime()))
        mesh.SetNormalsInterpolation(primvar.GetInterpolation())
        primvar.GetAttr().Block()


def _is_baked(session: Sdf.Layer, path: Sdf.Path) -> bool:
    """Whether UsdSkel has written points or a transform of a prim; if it cannot, it may leave them without a value."""
    written = filter(None, (session.GetAttributeAtPath(path.AppendProperty(name)) for name in _BAKED))
    return any(spec.HasInfo("timeSamples") or spec.HasInfo("default") for spec in written)


def _is_skinned(prim: Usd.Prim) -> bool:
    joints = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance("skel:jointIndices")
    blends = UsdSkel.BindingAPI(prim).GetBlendShapeTargetsRel()
    return bool(joints.HasValue() or (blends and blends.GetTargets()))


def _without_root(prim: Usd.Prim) -> Problem:
    """A warning of a shape with a skeleton and no SkelRoot above it, at what covers one if something does."""
    above = map(prim.GetStage().GetPrimAtPath, prim.GetPath().GetPrefixes())
    covered = [each for each in above if any(spec.typeName == "SkelRoot" for spec in each.GetPrimStack())]
    if not covered:
        message = f"<{prim.GetPath()}> has a skeleton, and no SkelRoot is above it: it is drawn as it was modelled"
        return not_drawn(prim, message, "make a prim above both a SkelRoot")
    kind, path = covered[-1].GetTypeName(), covered[-1].GetPath()
    message = f"<{path}> is a {kind} here and a SkelRoot in a weaker file: what is below it is drawn as it was modelled"
    return not_drawn(covered[-1], message, f'write def "{path.name}" without a type: that of the file then counts')


def _unbaked(prim: Usd.Prim) -> Problem:
    hint = "see that its skeleton, joints and weights fit each other"
    return not_drawn(prim, f"UsdSkel cannot move <{prim.GetPath()}>: it is drawn as it was modelled", hint=hint)
