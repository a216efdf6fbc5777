"""Point instancers written out as prims, in the session layer of a stage: no file changes."""

import math
import re
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field
from itertools import chain
from typing import Any

from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdShade

from pipeline.limits import limits
from pipeline.scene.usd.problems import Problem, not_drawn, over_limit
from pipeline.scene.usd.values import plain

_INSTANCE = re.compile(r"Instance_(\d+)")
"""Names of prims that stand for an instance, below its point instancer."""
_COUNTED = 10
"""Multiple of the limit up to which instances are counted [1]: to read a million of them takes seconds."""
_RESET = "!resetXformStack!"
"""Entry of an xformOpOrder by which the transforms of prims above do not count."""
_ARRAYS = ("positions", "orientations", "orientationsf", "scales", "velocities", "accelerations", "angularVelocities")
"""Attributes of a point instancer with a value for each instance; all but positions may have none."""
_HIDDEN = {0.0: UsdGeom.Tokens.invisible}
"""Visibility of what is hidden, the same in all frames."""
_SAME = 1e-9
"""Difference of elements of equal transforms [unit of the stage]: both are doubles, written out in full."""


def write_instancers(stage: Usd.Stage, frames: Sequence[int]) -> list[Problem]:
    """Write out all point instancers, outer ones first: those in a prototype then are in each instance of it. Too many
    instances are an error, and are not written.
    """
    problems = list[Problem]()
    done = set[Sdf.Path]()
    count = 0
    while waiting := list(_instancers(stage, done)):
        # Read the instances of all that wait, or as many as are far too many, before any are written.
        instances_of = dict[Sdf.Path, list[_Instance]]()
        total = count
        for path in waiting:
            try:
                instances_of[path] = _instances(UsdGeom.PointInstancer(stage.GetPrimAtPath(path)), frames)
            except (Tf.ErrorException, TypeError, _Unfit) as error:
                fault = str(error) if isinstance(error, _Unfit) else "one of its values has another type"
                problems += _left_out(stage.GetPrimAtPath(path), fault, frames)
                done.add(path)
                continue
            total += len(instances_of[path])
            if total > _COUNTED * limits().instances:
                break
        most = max(instances_of, key=lambda path: len(instances_of[path]), default=waiting[0])
        counted = f"{total:,} instances of point instancers"
        if over := over_limit(stage.GetPrimAtPath(most), "instances", total, counted):
            with Sdf.ChangeBlock():  # or further checks would see their prototypes
                for path in waiting:
                    _write_visibility(Sdf.CreatePrimInLayer(stage.GetSessionLayer(), path), _HIDDEN)
            return [*problems, *over]
        # Write those that can be written before all others; where there are none, they hold each other.
        ready = _ready(stage, instances_of)
        for path in ready or instances_of:
            done.add(path)
            if ready:
                count += len(instances_of[path])
                problems += _write_instances(stage.GetPrimAtPath(path), instances_of[path], frames)
            else:
                fault = "a prototype holds the instancer itself, or one that holds it: instances would have no end"
                problems += _left_out(stage.GetPrimAtPath(path), fault, frames)
    return problems


def _instancers(stage: Usd.Stage, done: Set[Sdf.Path]) -> Iterator[Sdf.Path]:
    """Point instancers that are drawn and not done: none for viewers alone, as the microlenses in the dataset.usda of a
    build are, and none in a prototype, which is drawn as instances alone.
    """
    instances = set[Sdf.Path]()
    prims = iter(Usd.PrimRange(stage.GetPseudoRoot()))
    for prim in prims:
        path = prim.GetPath()
        if path.GetParentPath() in done and path not in instances:
            prims.PruneChildren()
        elif not prim.IsA(UsdGeom.PointInstancer):
            continue
        elif UsdGeom.Imageable(prim).ComputePurpose() in (UsdGeom.Tokens.guide, UsdGeom.Tokens.proxy):
            prims.PruneChildren()
        elif path in done:
            instances |= {each.GetPath() for each in _written(prim).values()}
        else:
            yield path
            prims.PruneChildren()


def _ready(stage: Usd.Stage, instances_of: Mapping[Sdf.Path, "list[_Instance]"]) -> list[Sdf.Path]:
    """Point instancers that lie in no prototype of one of these, and refer to none of them."""
    held = {each.prototype for instances in instances_of.values() for each in instances}
    layers = set(stage.GetLayerStack())
    ready = list[Sdf.Path]()
    for path in instances_of:
        _, *weaker = stage.GetPrimAtPath(path).GetPrimStack()
        refers = any(spec.path in instances_of and spec.layer in layers for spec in weaker)
        if not refers and not any(prefix in held for prefix in path.GetPrefixes()):
            ready.append(path)
    return ready


def _written(instancer: Usd.Prim) -> dict[int, Usd.Prim]:
    """Prims that stand for the instances of a point instancer, by ascending number: of its file, as the dataset.usda of
    a build has them, of another instancer to which it refers, or its own.
    """
    prototypes = UsdGeom.PointInstancer(instancer).GetPrototypesRel().GetForwardedTargets()
    named = {child: _INSTANCE.fullmatch(child.GetName()) for child in instancer.GetChildren()}
    numbered = {
        int(name[1]): child
        for child, name in named.items()
        if name and not any(prototype.HasPrefix(child.GetPath()) for prototype in prototypes)
    }
    return dict(sorted(numbered.items()))


def _left_out(prim: Usd.Prim, fault: str, frames: Sequence[int]) -> list[Problem]:
    """A warning of a point instancer that is not drawn, and whose prototypes are hidden."""
    _write_instances(prim, [], frames)
    return [not_drawn(prim, f"<{prim.GetPath()}> is not drawn: {fault}")]


def _check_written(prim: Usd.Prim, written: Sequence[Usd.Prim], instances: "list[_Instance]") -> list[Problem]:
    """A warning if the instances in the file of a point instancer are not those that it places: one of both was
    edited.
    """
    if len(written) == len(instances) and all(
        Gf.IsClose(UsdGeom.Xformable(each).GetLocalTransformation(frame), pose, _SAME)
        for each, instance in zip(written, instances, strict=True)
        for frame, pose in instance.poses.items()
    ):
        return []
    message = f"<{prim.GetPath()}> places other instances than are written out below it, and these alone count"
    hint = f"edit the prims {written[0].GetName()} and so on, or remove them all, and it is written out anew"
    return [not_drawn(prim, message, hint=hint)]


@dataclass
class _Instance:
    """An instance: its prototype, and by frame its transform and its index in the arrays of the instancer."""

    prototype: Sdf.Path
    poses: dict[float, Gf.Matrix4d] = field(default_factory=dict)
    indices: dict[float, int] = field(default_factory=dict)


class _Unfit(Exception):
    """Arrays of a point instancer do not fit each other."""


def _instances(instancer: UsdGeom.PointInstancer, frames: Sequence[int]) -> list[_Instance]:
    """The instances of all frames, but for those of prototypes that are not there. One that keeps its id and prototype
    is the same instance in all frames. Raises _Unfit.
    """
    prototypes = instancer.GetPrototypesRel().GetForwardedTargets()
    prim = instancer.GetPrim()
    exist = [bool(prim.GetStage().GetPrimAtPath(prototype)) for prototype in prototypes]
    moves = any(
        a.ValueMightBeTimeVarying() for a in prim.GetAuthoredAttributes() if not a.GetName().startswith("xform")
    )
    instances = dict[tuple[int, int], _Instance]()
    for frame in frames if moves else frames[:1]:
        time = Usd.TimeCode(frame)
        numbers = plain(instancer.GetProtoIndicesAttr().Get(time) or ())
        _check_arrays(prim, numbers, len(prototypes), time)
        ids = plain(instancer.GetIdsAttr().Get(time) or range(len(numbers)))
        ids = ids if len(set(ids)) == len(numbers) else range(len(numbers))
        mask = list(instancer.ComputeMaskAtTime(time)) or [True] * len(numbers)
        poses = instancer.ComputeInstanceTransformsAtTime(time, time, instancer.ExcludeProtoXform, instancer.IgnoreMask)
        rows = zip(ids, numbers, mask, poses, strict=True)
        for index, (identity, number, is_drawn, pose) in enumerate(rows):
            if is_drawn and exist[number]:
                if not all(map(math.isfinite, chain(*pose))):
                    raise _Unfit(f"the transform of its instance {index} is not finite")
                instance = instances.setdefault((identity, number), _Instance(prototypes[number]))
                instance.poses[float(frame)], instance.indices[float(frame)] = pose, index
    return list(instances.values())


def _check_arrays(prim: Usd.Prim, numbers: Sequence[int], prototypes: int, time: Usd.TimeCode) -> None:
    """Raise _Unfit if indices are not those of prototypes, or an array has not one value for each instance: USD reads
    beyond the end of one that is too short.
    """
    for number in numbers:
        if not 0 <= number < prototypes:
            raise _Unfit(f"protoIndices names prototype {number}, of {prototypes}")
    for name in _ARRAYS:
        count = len(prim.GetAttribute(name).Get(time) or ())
        if count != len(numbers) and (count or name == "positions"):
            raise _Unfit(f'"{name}" has {count:,} values for {len(numbers):,} instances')


def _write_instances(prim: Usd.Prim, instances: list[_Instance], frames: Sequence[int]) -> list[Problem]:
    """Write instances below a point instancer, each a transform above a reference to its prototype; warnings of
    primvars with too few values, and of instances in its file that are others.
    """
    stage, path, written = prim.GetStage(), prim.GetPath(), _written(prim)
    layer = stage.GetSessionLayer()
    if any(spec.layer != layer for each in written.values() for spec in each.GetPrimStack()):
        return _check_written(prim, list(written.values()), instances)
    times = sorted({frame for instance in instances for frame in instance.poses})
    prototypes = {instance.prototype: stage.GetPrimAtPath(instance.prototype) for instance in instances}
    bound = {at: _bound_above(prototype, prim) for at, prototype in prototypes.items()}
    carried = {at: _carried_above(prototype, prim) for at, prototype in prototypes.items()}
    visibility = {at: _own_visibility(prototype, frames) for at, prototype in prototypes.items()}
    primvars, problems = _primvars_by_frame(prim, instances, times)
    children = [child for child in prim.GetChildren() if child not in written.values()]
    first = max(written, default=-1) + 1
    with Sdf.ChangeBlock():
        for child in children:
            _hide(child)
        for each in written.values():  # of another point instancer, to which this one refers and is not equal
            Sdf.CreatePrimInLayer(layer, each.GetPath()).active = False
        for number, instance in enumerate(instances, first):
            placed = Sdf.CreatePrimInLayer(layer, path.AppendChild(f"Instance_{number}"))
            placed.specifier = Sdf.SpecifierDef
            placed.typeName = "Xform"
            placed.instanceable = False
            _write_poses(placed, instance, times)
            _write_primvars(placed, instance, primvars)
            for name, material in bound[instance.prototype].items():
                placed.SetInfo("apiSchemas", Sdf.TokenListOp.Create(prependedItems=["MaterialBindingAPI"]))
                Sdf.RelationshipSpec(placed, name, custom=False).targetPathList.explicitItems = [material]
            shape = Sdf.PrimSpec(placed, "Shape", Sdf.SpecifierDef)
            shape.referenceList.Prepend(Sdf.Reference("", instance.prototype))
            _write_visibility(shape, visibility[instance.prototype])
            if _RESET in (order := UsdGeom.Xformable(prototypes[instance.prototype]).GetXformOpOrderAttr().Get() or ()):
                ops = Sdf.AttributeSpec(shape, "xformOpOrder", Sdf.ValueTypeNames.TokenArray, Sdf.VariabilityUniform)
                ops.default = [op for op in order if op != _RESET]  # it leaves out prims above a prototype alone
    with Usd.EditContext(stage, layer):
        for number, instance in enumerate(instances, first):
            for attribute in carried[instance.prototype]:
                placed_prim = stage.GetPrimAtPath(path.AppendChild(f"Instance_{number}"))
                if not placed_prim.HasProperty(attribute.GetName()):
                    attribute.FlattenTo(placed_prim)
    return problems


def _hide(child: Usd.Prim) -> None:
    """Hide a prim below a point instancer, which may be a prototype or hold some."""
    if child.GetTypeName() and not child.IsA(UsdGeom.Imageable):
        return
    spec = Sdf.CreatePrimInLayer(child.GetStage().GetSessionLayer(), child.GetPath())
    if not child.GetTypeName():  # a prim without a type hides nothing
        spec.typeName = "Scope"
    _write_visibility(spec, _HIDDEN)


def _own_visibility(prototype: Usd.Prim, frames: Sequence[int]) -> dict[float, str]:
    """Visibility of a prototype itself by frame, as files have it: in the session layer instancers hide prototypes."""
    attribute, session = prototype.GetAttribute("visibility"), prototype.GetStage().GetSessionLayer()
    tokens = dict[float, Any]()
    for spec, offset in attribute.GetPropertyStackWithLayerOffsets(Usd.TimeCode.EarliestTime()) if attribute else ():
        layer, path = spec.layer, spec.path
        if layer == session:
            continue
        if layer.GetNumTimeSamplesForPath(path):
            before = {
                frame: layer.GetBracketingTimeSamplesForPath(path, offset.GetInverse() * float(frame))[1]
                for frame in frames
            }
            tokens = {frame: layer.QueryTimeSample(path, time) for frame, time in before.items()}
            break
        if spec.HasInfo("default"):
            tokens = dict.fromkeys(frames, spec.default)
            break
    inherited, invisible = UsdGeom.Tokens.inherited, UsdGeom.Tokens.invisible
    return {frame: invisible if tokens.get(frame) == invisible else inherited for frame in frames}


def _write_visibility(spec: Sdf.PrimSpec, by_frame: Mapping[float, str]) -> None:
    """Write the visibility of a prim, as samples if it changes."""
    written = spec.attributes.get("visibility")
    attribute = written or Sdf.AttributeSpec(spec, "visibility", Sdf.ValueTypeNames.Token)
    attribute.default, *later = dict.fromkeys(by_frame.values())
    for frame, token in by_frame.items() if later else ():
        spec.layer.SetTimeSample(attribute.path, frame, token)


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


def _write_poses(placed: Sdf.PrimSpec, instance: _Instance, times: list[float]) -> None:
    """Write the transforms of an instance, and its visibility if it is not there at all times."""
    order = Sdf.AttributeSpec(placed, "xformOpOrder", Sdf.ValueTypeNames.TokenArray, Sdf.VariabilityUniform)
    order.default = ["xformOp:transform"]
    transform = Sdf.AttributeSpec(placed, "xformOp:transform", Sdf.ValueTypeNames.Matrix4d)
    first = next(iter(instance.poses.values()))
    if len(times) < 2:
        transform.default = first
        return
    for time in times:
        placed.layer.SetTimeSample(transform.path, time, instance.poses.get(time, first))
    if len(instance.poses) < len(times):
        inherited, invisible = UsdGeom.Tokens.inherited, UsdGeom.Tokens.invisible
        _write_visibility(placed, {time: inherited if time in instance.poses else invisible for time in times})
