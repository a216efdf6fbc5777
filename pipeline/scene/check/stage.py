"""All checks of a stage, in one pass. No task runs on a stage with an error.

USD silently composes a stage with a typing error in every attribute. So the checks are strict about names, types,
tokens and ranges, and then ask whether the parts can be built.
"""

from collections.abc import Callable, Iterable, Iterator, Set
from pathlib import Path

from pxr import Plug, Sdf, Tf, Usd, Vt

from pipeline.scene.camera import check_camera, check_planes
from pipeline.scene.channels import check_channel, check_illuminant
from pipeline.scene.check.budgets import check_budgets
from pipeline.scene.check.layers import check_assets, check_layers, check_merged, check_used
from pipeline.scene.check.poses import check_poses
from pipeline.scene.check.properties import check_properties
from pipeline.scene.lens import check_glass, check_group_place, check_groups, check_lens, check_nominal
from pipeline.scene.microlenses import check_microlenses
from pipeline.scene.plen_dataset import check_dataset, check_exports, check_only_dataset, find_dataset
from pipeline.scene.sensor import check_sensor
from pipeline.scene.targets import check_target
from pipeline.scene.usd.problems import Problem, authored_apis, did_you_mean, problem
from pipeline.scene.usd.values import LENS_DISTORTION

_WHOLES: tuple[tuple[str, Callable[[Usd.Prim], Iterable[Problem]]], ...] = (
    ("PlenLens", check_lens),
    ("PlenLens", check_glass),
    ("PlenLens", check_groups),
    ("PlenLensGroup", check_group_place),
    ("PlenChannel", check_channel),
    ("PlenDataset", check_illuminant),
    ("PlenDataset", check_exports),
)
_MOST_OPS = 100
"""Most transform operations of one prim: real stages have fewer than ten."""


def check(stage: Usd.Stage, roots: list[Path]) -> list[Problem]:
    """All problems of a composed stage, which may read files below the roots: of layers, of prims, of the dataset."""
    if outside := check_used(stage, roots):
        return outside
    problems = [*check_layers(stage), *check_assets(stage, roots)]
    prims = list[Usd.Prim]()
    everything = iter(Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate)))
    next(everything)  # the pseudo-root
    for prim in everything:
        if prim.IsDefined() or prim.IsAbstract() or not prim.IsActive():
            prims.append(prim)
        else:
            everything.PruneChildren()
            problems.append(_of_dangling(prim))
    wrong: set[Sdf.Path] = set()
    for prim in prims:
        of_prim = [*_check_prim(prim), *check_properties(prim)]
        problems += of_prim
        if any(problem.is_error for problem in of_prim):
            wrong.add(prim.GetPath())
    if over := [problem for prim in _parts(prims) for problem in check_budgets(prim)]:
        return list(dict.fromkeys([*problems, *over]))  # the further checks make points, poses and lattices
    for prim in _parts(prims):
        problems += _check_whole(prim, wrong)
    problems += check_only_dataset(stage)
    if root := find_dataset(stage):
        problems += check_dataset(root, wrong)
    if not any(problem.is_error for problem in problems):
        # The further checks compute with values that have passed the checks so far.
        for prim in _parts(prims):
            problems += check_nominal(prim) if prim.IsA("PlenLens") else []
            problems += check_planes(prim) if _is_camera(prim) else []
        problems += check_poses(root) if root else []
    return list(dict.fromkeys(problems))


def _parts(prims: list[Usd.Prim]) -> list[Usd.Prim]:
    return [prim for prim in prims if prim.IsActive() and not prim.IsAbstract()]


def _is_camera(prim: Usd.Prim) -> bool:
    return bool(prim.IsA("Camera") and prim.HasAPI("PlenCameraAPI"))


def _check_whole(prim: Usd.Prim, wrong: Set[Sdf.Path]) -> list[Problem]:
    """Problems between the parts of one prim; `wrong` holds the prims with wrong values."""
    if merged := list(check_merged(prim)):
        return merged  # all other problems would follow from it
    problems = [problem for type_name, whole in _WHOLES if prim.IsA(type_name) for problem in whole(prim)]
    problems += check_microlenses(prim, wrong) if prim.IsA("PlenMicrolensArray") else []
    problems += check_target(prim, wrong) if prim.IsA("PlenTarget") else []
    problems += check_sensor(prim) if prim.IsA("PlenSensor") and prim.GetPath() not in wrong else []
    return problems + (list(check_camera(prim)) if _is_camera(prim) else [])


def _of_dangling(prim: Usd.Prim) -> Problem:
    """The problem of an over on a prim that nothing defines."""
    parent = prim.GetParent()
    siblings = [sibling.GetName() for sibling in parent.GetAllChildren() if sibling.IsDefined()]
    message = f'"over" on a prim that nothing defines: "{prim.GetName()}"'
    hint = did_you_mean(prim.GetName(), siblings)
    if siblings and not hint:
        where = "on the stage" if parent.IsPseudoRoot() else f"below <{parent.GetPath()}>"
        hint = f"{where} there are {', '.join(siblings[:20])}{' …' if len(siblings) > 20 else ''}"
    return problem(prim, "over-without-def", message, hint=hint)


def _check_prim(prim: Usd.Prim) -> Iterator[Problem]:
    """Problems of one prim, except its properties."""
    name = prim.GetTypeName()
    if name and not prim.GetPrimTypeInfo().GetSchemaTypeName():
        hint = did_you_mean(name, _known("UsdTyped", Usd.SchemaRegistry().GetConcreteSchemaTypeName))
        yield problem(prim, "unknown-type", f'unknown prim type "{name}"', hint=hint)
    yield from _check_apis(prim)
    yield from _check_xform_order(prim)
    yield from _check_variants(prim)
    if prim.HasAuthoredMetadata("clips") or prim.HasAuthoredMetadata("clipSets"):
        yield problem(prim, "not-yet-supported", "value clips are not supported yet")


def _check_apis(prim: Usd.Prim) -> Iterator[Problem]:
    registry = Usd.SchemaRegistry()
    for full in authored_apis(prim):
        name, instance = registry.GetTypeNameAndInstance(full)
        if name in LENS_DISTORTION and prim.GetTypeName() == "Camera":
            continue
        if not registry.FindAppliedAPIPrimDefinition(name):
            known = _known("UsdAPISchemaBase", Usd.SchemaRegistry().GetAPISchemaTypeName)
            hint = did_you_mean(name, known | LENS_DISTORTION)
            yield problem(prim, "unknown-api", f'unknown API schema "{name}"', hint=hint)
            continue
        # Files and ApplyAPI() ignore apiSchemaCanOnlyApplyTo; only this call respects it.
        can = prim.CanApplyAPI(*([name, instance] if instance else [name]))
        if not can:
            yield problem(prim, "api-not-applicable", can.whyNot)


def _check_xform_order(prim: Usd.Prim) -> Iterator[Problem]:
    order = prim.GetAttribute("xformOpOrder")
    value = order.Get() if order else None
    # Anything but an array of tokens is reported as a wrong type.
    named = [token.removeprefix("!invert!") for token in value] if isinstance(value, Vt.TokenArray) else []
    if len(named) > _MOST_OPS:
        message = f'"xformOpOrder" has {len(named)} entries, not 0 to {_MOST_OPS}'
        yield problem(order, "entries", message)
        return
    for name in named:
        if name != "!resetXformStack!" and not prim.HasProperty(name):
            # USD raises an error only later, when the transform is read.
            hint = did_you_mean(name, filter(lambda other: other.startswith("xformOp:"), prim.GetPropertyNames()))
            message = f'xformOpOrder names "{name}", which does not exist'
            yield problem(order, "missing-xform-op", message, hint=hint)
    ops = [attribute for attribute in prim.GetAuthoredAttributes() if attribute.GetName().startswith("xformOp:")]
    unused = [attribute for attribute in ops if attribute.GetName() not in named]
    if unused:
        names = ", ".join(f'"{attribute.GetName()}"' for attribute in unused)
        usual = sorted((attribute.GetName() for attribute in unused), key=_rank)
        whole = ", ".join(f'"{name}"' for name in [*named, *usual])
        stand, move = ("stands", "it moves") if len(unused) == 1 else ("stand", "they move")
        hint = f"write uniform token[] xformOpOrder = [{whole}]" + ("; the last one acts first" if len(ops) > 1 else "")
        message = f"{names} {stand} in no xformOpOrder, so {move} nothing"
        yield problem(unused[0], "unused-xform-op", message, hint=hint)


def _rank(op: str) -> int:
    """Place of an operation with translations before rotations before scales, as most programs write them."""
    usual = ("xformOp:translate", "xformOp:orient", "xformOp:rotate", "xformOp:scale")
    return next((i for i, start in enumerate(usual) if op.startswith(start)), len(usual))


def _check_variants(prim: Usd.Prim) -> Iterator[Problem]:
    sets = prim.GetVariantSets()
    for name, choice in sorted((prim.GetMetadata("variantSelection") or {}).items()):
        if name not in sets.GetNames():
            hint = did_you_mean(name, sets.GetNames())
            yield problem(prim, "unknown-variant-set", f'no variant set "{name}"', hint=hint)
        elif choice and choice not in sets.GetVariantSet(name).GetVariantNames():
            hint = did_you_mean(choice, sets.GetVariantSet(name).GetVariantNames())
            yield problem(prim, "unknown-variant", f'variant set "{name}" has no variant "{choice}"', hint=hint)


def _known(base: str, name_of: Callable[[Tf.Type], str]) -> set[str]:
    return {name_of(kind) for kind in Plug.Registry().GetAllDerivedTypes(Tf.Type.FindByName(base))} - {""}
