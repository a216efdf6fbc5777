"""Skinned meshes baked at each frame, in the session layer of a stage: no file changes."""

from collections.abc import Sequence, Set

from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel, Vt

from pipeline.scene.usd.problems import Problem, not_drawn, over_limit

_BAKED = ("points", "xformOp:transform")
_WEIGHTS = ("translations", "rotations", "scales", "blendShapeWeights")


def bake(stage: Usd.Stage, frames: Sequence[int]) -> list[Problem]:
    """Write the points of all skinned meshes at the frames, and only there: between them joints do not move evenly."""
    skinned = [prim for prim in stage.Traverse() if prim.HasAPI(UsdSkel.BindingAPI)]
    bound = [prim for prim in skinned if UsdSkel.Root.Find(prim)]
    roots = dict.fromkeys(UsdSkel.Root.Find(prim).GetPath() for prim in bound)
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
        # UsdSkel bakes at samples and at integers: samples at the frames are what USD interpolates there.
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
        # Roots that refer to others come first: they would have what is written to these, and be skinned twice.
        referring = {path: _referred(stage.GetPrimAtPath(path), roots.keys()) for path in roots}
        for path in sorted(roots, key=lambda path: referring[path], reverse=True):
            UsdSkel.BakeSkinning(UsdSkel.Root.Get(stage, path), Gf.Interval(min(frames), max(frames)))
        for mesh in filter(None, map(UsdGeom.PointBased, bound)):
            if mesh.GetPointsAttr().GetNumTimeSamples() > mesh.GetNormalsAttr().GetNumTimeSamples():
                mesh.GetNormalsAttr().Block()  # of faces, which it does not turn
    with Sdf.ChangeBlock():  # the samples of animations have done their service
        for path in sampled:
            spec = session.GetAttributeAtPath(path)
            spec.owner.RemoveProperty(spec)
    _keep_frames(session, frames)
    unbaked = (prim for prim in bound if not _is_baked(session, prim.GetPath()))
    return loose + [_unbaked(prim) for prim in unbaked if prim.IsA(UsdGeom.Boundable) and _is_skinned(prim)]


def _referred(root: Usd.Prim, roots: Set[Sdf.Path]) -> int:
    """Number of other roots of the same stage to which a root refers, directly or not."""
    own, layers = root.GetPath(), set(root.GetStage().GetLayerStack())
    return sum(spec.layer in layers and spec.path in roots and spec.path != own for spec in root.GetPrimStack())


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
