"""All checks of a stage, in one pass. No task runs on a stage with an error.

USD silently composes a stage with a typing error in every attribute. So the checks are strict about names, types,
tokens and ranges, and then ask whether the parts can be built.
"""

from collections.abc import Callable, Hashable, Iterable, Iterator, Set
from pathlib import Path

from pxr import Pcp, Sdf, Usd, UsdGeom, Vt

from pipeline.limits import limits
from pipeline.scene.camera import check_camera, check_planes
from pipeline.scene.channels import check_channel, check_illuminant
from pipeline.scene.check.budgets import check_budgets
from pipeline.scene.check.layers import check_layers, check_used
from pipeline.scene.check.poses import check_poses
from pipeline.scene.check.properties import FOR_NO_IMAGE, check_apis, check_properties, known_types
from pipeline.scene.lens import check_glass, check_group_parent, check_groups, check_lens, check_nominal
from pipeline.scene.microlenses import check_microlenses
from pipeline.scene.plen_dataset import check_dataset, check_exports, check_only_dataset, find_dataset
from pipeline.scene.sensor import check_sensor
from pipeline.scene.states import check_steady_while_open, is_camera
from pipeline.scene.targets import check_target, is_in_preview
from pipeline.scene.temperature import check_unused_thermal
from pipeline.scene.tolerances import check_tolerance
from pipeline.scene.usd.meshes import alike, likeness
from pipeline.scene.usd.overrides import at_code, changing, check_changing
from pipeline.scene.usd.plug_in import ThirdPartyLayers, scene_reader
from pipeline.scene.usd.poses import frame_numbers, is_op
from pipeline.scene.usd.problems import (
    Problem,
    at_opinion,
    problem,
    saying,
    shown_path,
    specs,
)
from pipeline.scene.usd.roots import OUTSIDE_HINT, file_of, is_inside
from pipeline.scene.windows import check_medium, check_unnamed_windows, check_window
from pipeline.spelling import did_you_mean

_OF_TYPE: tuple[tuple[str, Callable[[Usd.Prim], Iterable[Problem]]], ...] = (
    ("PlenLens", check_lens),
    ("PlenLens", check_glass),
    ("PlenLens", check_groups),
    ("PlenLens", check_unused_thermal),
    ("PlenLensGroup", check_group_parent),
    ("PlenWindow", check_window),
    ("PlenChannel", check_channel),
    ("PlenTolerance", check_tolerance),
    ("PlenDataset", check_illuminant),
    ("PlenDataset", check_exports),
    ("PlenDataset", check_medium),
)
_MOST_OPS = 100
"""Most transform operations of one prim: real stages have fewer than ten."""
_LINKS = {
    "PlenLens": "plen:camera:lens",
    "PlenMicrolensArray": "plen:camera:microlenses",
    "PlenSensor": "plen:camera:sensor",
    "PlenTarget": "plen:targets",
    "PlenWindow": "plen:camera:windows",
}
"""Types of parts, and the relationships that name them."""
_MOST_NAMES = 4
"""Most names in a message: a lens keeps dozens, and a few suffice to recognise their file."""


def check(stage: Usd.Stage, roots: list[Path], third_party: ThirdPartyLayers) -> list[Problem]:
    """All problems of a composed stage, which may read files below the roots: of layers, of prims, of the dataset.

    Each step computes with values that have passed the steps before; where these found too much or nothing to compute
    with, the rest is left out.
    """
    if outside := check_used(stage, roots):
        return outside
    problems = [*check_layers(stage, third_party), *_check_assets(stage, roots, third_party)]
    prims = list[Usd.Prim]()
    everything = iter(Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate)))
    next(everything)  # the pseudo-root
    for prim in everything:
        if prim.IsDefined() or prim.IsAbstract() or not prim.IsActive():
            prims.append(prim)
        else:
            everything.PruneChildren()
            problems += third_party.settled([] if _holds_prototypes(prim) else [_of_dangling(prim)])
    # Prims one by one; instances of a prim without problems have none either.
    wrong = set[Sdf.Path]()
    faultless = set[Hashable]()
    for prim in filter(Usd.Prim.IsActive, prims):
        identity = prim.IsAbstract(), likeness(prim), *((spec.layer.identifier, spec.path) for spec in specs(prim))
        if identity in faultless:
            continue
        of_prim = list(third_party.settled([*_check_prim(prim, third_party), *check_properties(prim)]))
        problems += of_prim
        faultless |= set() if of_prim else {identity}
        if any(problem.is_error for problem in of_prim):
            wrong.add(prim.GetPath())
    # Parts of cameras and targets, at the time codes at which any of them may differ.
    parts = _parts(prims)
    if over_limit := [problem for prim in parts for problem in check_budgets(prim)]:
        return list(dict.fromkeys([*problems, *over_limit]))  # the further checks make points, poses and lattices
    codes = _codes_to_check(stage)
    if without_value := list(check_changing(stage, codes)):
        return list(dict.fromkeys([*problems, *without_value]))  # the further checks look at these time codes
    for prim in parts:
        for code in codes if is_camera(prim) or prim.IsA("PlenLens") else codes[:1]:
            problems += _check_part(at_code(prim, code), wrong)
        problems += check_steady_while_open(prim, codes) if is_camera(prim) and prim.GetPath() not in wrong else []
    problems += check_unnamed_windows(parts, list(filter(is_camera, parts)))
    # The dataset, and what needs cameras, poses and shapes without errors.
    problems += check_only_dataset(stage)
    if root := find_dataset(stage):
        problems += third_party.settled(check_dataset(root, wrong))
    if not any(problem.is_error for problem in problems):
        for prim in parts:
            problems += check_nominal(prim) if prim.IsA("PlenLens") else []
            for code in codes if is_camera(prim) else ():
                problems += check_planes(at_code(prim, code))
        problems += third_party.settled(check_poses(root)) if root else []
        problems += scene_reader().check_units(stage, third_party)
    return list(dict.fromkeys(problems))


def _parts(prims: list[Usd.Prim]) -> list[Usd.Prim]:
    """Cameras, and prims of our types, that a build may read."""
    ours = [prim for prim in prims if prim.GetTypeName() == "Camera" or prim.GetTypeName().startswith("Plen")]
    return [prim for prim in ours if prim.IsActive() and not prim.IsAbstract()]


def _codes_to_check(stage: Usd.Stage) -> list[float]:
    """Time codes at which lenses and cameras are checked: all frames if any of them is animated, else one."""
    root = find_dataset(stage)
    frames = frame_numbers(root) if root and changing(stage) else ()
    return [float(number) for number in frames[: limits().frames]] or [0.0]


def _check_part(prim: Usd.Prim, wrong: Set[Sdf.Path]) -> list[Problem]:
    """Problems of one prim as a whole; `wrong` holds the prims with wrong values."""
    if merged := list(_check_merged(prim)):
        return merged  # all other problems would follow from it
    problems = [problem for type_name, of_type in _OF_TYPE if prim.IsA(type_name) for problem in of_type(prim)]
    problems += check_microlenses(prim, wrong) if prim.IsA("PlenMicrolensArray") else []
    problems += check_target(prim, wrong) if prim.IsA("PlenTarget") else []
    problems += check_sensor(prim) if prim.IsA("PlenSensor") and prim.GetPath() not in wrong else []
    return problems + ([*check_camera(prim), *check_unused_thermal(prim)] if is_camera(prim) else [])


def _holds_prototypes(prim: Usd.Prim) -> bool:
    """Whether a prim below a point instancer is, or holds, a prototype: nothing has to define it, for it is drawn as
    instances alone.
    """
    instancer = UsdGeom.PointInstancer(prim.GetParent())
    prototypes = instancer.GetPrototypesRel().GetForwardedTargets() if instancer else []
    return any(prototype.HasPrefix(prim.GetPath()) for prototype in prototypes)


def _of_dangling(prim: Usd.Prim) -> Problem:
    """The problem of an over on a prim that nothing defines."""
    parent = prim.GetParent()
    siblings = [sibling.GetName() for sibling in parent.GetAllChildren() if sibling.IsDefined()]
    message = f'"over" on a prim that nothing defines: "{prim.GetName()}"'
    hint = did_you_mean(prim.GetName(), siblings)
    if siblings and not hint:
        location = "on the stage" if parent.IsPseudoRoot() else f"below <{parent.GetPath()}>"
        hint = f"{location} there are {', '.join(siblings[:20])}{' …' if len(siblings) > 20 else ''}"
    return problem(prim, "over-without-def", message, hint=hint)


def _check_prim(prim: Usd.Prim, third_party: ThirdPartyLayers) -> Iterator[Problem]:
    """Problems of one prim, except its properties."""
    name = prim.GetTypeName()
    is_defined = bool(prim.GetPrimTypeInfo().GetSchemaTypeName())
    if not is_defined and not FOR_NO_IMAGE.match(name) and (opinions := saying(prim, "typeName")):
        hint = did_you_mean(name, known_types("UsdTyped", Usd.SchemaRegistry().GetConcreteSchemaTypeName))
        is_strange = not hint and not name.startswith("Plen")
        severity = "warning" if is_strange or opinions[0].layer in third_party.layers else "error"
        hint = "it is not drawn, and its transform does not count" if is_strange else hint
        of_opinion = problem(prim, "unknown-type", f'unknown prim type "{name}"', hint=hint, severity=severity)
        yield at_opinion(opinions[0], of_opinion)
    yield from check_apis(prim)
    yield from _check_xform_order(prim)
    yield from _check_variants(prim, third_party)
    clips = Usd.ClipsAPI(prim)
    for name in clips.GetClips() if prim.HasAuthoredMetadata("clips") else ():
        for asset in clips.GetClipAssetPaths(name) or ():
            if not asset.resolvedPath:
                of_opinion = problem(prim, "asset-missing", f"cannot find file @{asset.path}@ of its value clips")
                yield at_opinion(saying(prim, "clips")[0], of_opinion)


def _check_xform_order(prim: Usd.Prim) -> Iterator[Problem]:
    """Problems of names in an xformOpOrder that are no operations, and of operations that it leaves out."""
    order = prim.GetAttribute("xformOpOrder")
    value = order.Get() if order else None
    # Anything but an array of tokens is reported as a wrong type.
    named = [token.removeprefix("!invert!") for token in value] if isinstance(value, Vt.TokenArray) else []
    if len(named) > _MOST_OPS:
        yield problem(order, "entries", f'"xformOpOrder" has {len(named)} entries, not 0 to {_MOST_OPS}')
        return
    for name in named:
        if not is_op(prim, name):
            # USD raises an error only later, when the transform is read.
            hint = did_you_mean(name, [other for other in prim.GetPropertyNames() if is_op(prim, other)])
            yield problem(order, "missing-xform-op", f'xformOpOrder names "{name}", which is no operation', hint=hint)
    ops = [attribute for attribute in prim.GetAuthoredAttributes() if attribute.GetName().startswith("xformOp:")]
    if all(op.GetName() in named for op in ops):
        return
    # A stronger order leaves out what a weaker file moves, as USD intends.
    rank_of = {name: i for i, spec in reversed([*enumerate(specs(prim))]) for name in spec.properties.keys()}  # noqa: SIM118
    rank_of_order = rank_of.get("xformOpOrder", len(rank_of))
    unused = [op for op in ops if op.GetName() not in named and rank_of.get(op.GetName(), 0) <= rank_of_order]
    if unused:
        names = ", ".join(f'"{attribute.GetName()}"' for attribute in unused)
        in_usual_order = sorted((attribute.GetName() for attribute in unused), key=_rank)
        listed = ", ".join(f'"{name}"' for name in [*named, *in_usual_order])
        verb, moves = ("stands", "it moves") if len(unused) == 1 else ("stand", "they move")
        acts_first = "; the last one acts first" if len(ops) > 1 else ""
        hint = f"write uniform token[] xformOpOrder = [{listed}]{acts_first}"
        yield problem(unused[0], "unused-xform-op", f"{names} {verb} in no xformOpOrder, so {moves} nothing", hint=hint)


def _rank(op: str) -> int:
    """Rank of an operation: translations, rotations, scales, as most programs write them."""
    usual = ("xformOp:translate", "xformOp:orient", "xformOp:rotate", "xformOp:scale")
    return next((i for i, start in enumerate(usual) if op.startswith(start)), len(usual))


def _check_variants(prim: Usd.Prim, third_party: ThirdPartyLayers) -> Iterator[Problem]:
    """Problems of selected variants that do not exist."""
    if not prim.HasAuthoredMetadata("variantSelection"):
        return
    sets, stack = prim.GetVariantSets(), specs(prim)
    for name, choice in sorted((prim.GetMetadata("variantSelection") or {}).items()):
        spec = next((spec for spec in stack if name in spec.variantSelections), stack[0])
        is_ours = spec.layer not in third_party.layers
        if name not in sets.GetNames():
            if not is_ours:
                continue
            hint = did_you_mean(name, sets.GetNames())
            yield at_opinion(spec, problem(prim, "unknown-variant-set", f'no variant set "{name}"', hint=hint))
        elif choice and choice not in sets.GetVariantSet(name).GetVariantNames():
            hint = did_you_mean(choice, sets.GetVariantSet(name).GetVariantNames())
            message, severity = f'variant set "{name}" has no variant "{choice}"', "error" if is_ours else "warning"
            yield at_opinion(spec, problem(prim, "unknown-variant", message, hint=hint, severity=severity))


def _check_merged(prim: Usd.Prim) -> Iterator[Problem]:
    """A problem if two files define a part independently, and something of the weaker one remains."""
    relationship = next((relationship for name, relationship in _LINKS.items() if prim.IsA(name)), None)
    index = prim.GetPrimIndex() if relationship else None
    if not index or not index.rootNode:
        return
    first, *weaker = _origins(index.rootNode) or [None]
    stronger = set[str]()
    node = first
    while node:
        stronger |= _names_in(node)
        node = node.parent
    for other in weaker:
        remaining = _names_in(other) - stronger
        if of_weaker := sorted(name for name in remaining if name.split(".")[0] not in remaining or "." not in name):
            more = f" and {len(of_weaker) - _MOST_NAMES} more" if len(of_weaker) > _MOST_NAMES else ""
            names = f"{', '.join(of_weaker[:_MOST_NAMES])}{more}"
            message = (
                f'"{prim.GetName()}" is {_shown_file(first)} laid over {_shown_file(other)}, of which it keeps {names}'
            )
            hint = f"a reference replaces nothing: define another prim beside it, and name that one in {relationship}"
            yield problem(prim, "merged", message, hint=hint)


def _origins(node: Pcp.NodeRef) -> list[Pcp.NodeRef]:
    """Nodes that define a part without building on another definition, strongest first."""
    origins = [origin for child in node.children for origin in _origins(child)]
    return origins or [node] * any(spec.typeName for spec in _opinions(node) if spec.specifier == Sdf.SpecifierDef)


def _opinions(node: Pcp.NodeRef) -> list[Sdf.PrimSpec]:
    """Opinions of files on a prim at a node of its composition, strongest first."""
    specs = [layer.GetPrimAtPath(node.path) for layer in node.layerStack.layers]
    return [spec for spec in specs if spec and not spec.layer.anonymous]


def _names_in(node: Pcp.NodeRef) -> set[str]:
    """Properties of a part, and its children with theirs, relative to it."""
    names: set[str] = set()
    for spec in _opinions(node):
        names |= {prop.name for prop in spec.properties if prop.name.startswith("plen:")}
        for child in spec.nameChildren:
            names.add(child.name)
            names |= {f"{child.name}.{prop.name}" for prop in child.properties if prop.name.startswith("plen:")}
    return names


def _shown_file(node: Pcp.NodeRef) -> str:
    """The strongest file of a node, as messages show it."""
    return shown_path(node.layerStack.layers[0].realPath)


def _check_assets(stage: Usd.Stage, roots: list[Path], third_party: ThirdPartyLayers) -> Iterator[Problem]:
    """Problems of asset values: pictures that cannot be read, and files outside all roots, or missing."""
    prims = list(Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate)))
    scenes = scene_reader()
    yield from scenes.check_pictures(prims, third_party)
    read = {attribute for prim in prims for attribute, _ in scenes.named_by(prim)}
    for attribute in (attribute for first, *_ in alike(prims) for attribute in first.GetAuthoredAttributes()):
        prim = attribute.GetPrim()
        if not issubclass(type(attribute.GetTypeName().defaultValue), Sdf.AssetPath | Sdf.AssetPathArray):
            continue
        if attribute in read or is_in_preview(prim) or third_party.wrote(attribute):
            continue  # previews are of viewers: a copied dataset.usda builds without its pictures
        values = [attribute.Get(), *(attribute.Get(time) for time in attribute.GetTimeSamples())]
        arrays = [[value] if isinstance(value, Sdf.AssetPath) else value for value in values]
        for asset in [asset for array in arrays if isinstance(array, list | Sdf.AssetPathArray) for asset in array]:
            if asset.resolvedPath and not is_inside(file_of(asset.resolvedPath), roots):
                message = f"@{asset.path}@ lies outside the folders that a stage may read"
                yield problem(attribute, "asset-outside", message, hint=OUTSIDE_HINT)
            elif asset.path and not asset.resolvedPath:
                slashes = "asset paths use forward slashes" if "\\" in asset.path else None
                yield problem(attribute, "asset-missing", f"cannot find file @{asset.path}@", hint=slashes)
