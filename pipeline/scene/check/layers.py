"""Checks of layers and of the files that they name: asset roots, statements on which all layers of a stage must agree,
statements that USD drops silently, and parts merged from two references, of which USD lays the second over the first
and removes nothing.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from pxr import Ar, Pcp, Sdf, Usd, UsdGeom

from pipeline.scene.pictures import NAMES, is_picture, picture_of
from pipeline.scene.targets import is_in_preview
from pipeline.scene.usd.poses import LAST_FRAME
from pipeline.scene.usd.problems import Problem, metadata_problem, problem, shown_path
from pipeline.scene.usd.roots import OUTSIDE_HINT, file_of, is_inside, real_path, used_layers
from pipeline.scene.usd.usda_lines import text_map
from pipeline.scene.usd.values import LENS_DISTORTION_NAMES, Range, UnreadableValue

# Layer metadata, its fallback, and the behaviour of USD if layers disagree.
_ALIKE = (
    ("metersPerUnit", 0.01, "USD does not convert lengths between layers"),
    ("timeCodesPerSecond", 24.0, "USD would rescale the time codes of the samples"),
    ("upAxis", "Y", "USD does not turn referenced scenes"),
)

# Layer metadata that must be numbers of a sane size: nanometres to kilometres, frames, frames per second.
_NUMBERS = {
    "metersPerUnit": Range(low=1e-9, high=1e3),
    "startTimeCode": Range(low=-LAST_FRAME, high=LAST_FRAME),
    "endTimeCode": Range(low=-LAST_FRAME, high=LAST_FRAME),
    "timeCodesPerSecond": Range(low=1e-6, high=1e9),
}

_LINKS = {
    "PlenLens": "plen:camera:lens",
    "PlenMicrolensArray": "plen:camera:microlenses",
    "PlenSensor": "plen:camera:sensor",
    "PlenTarget": "plen:targets",
}
"""Types of parts, and the relationships that name them."""
_MOST_NAMES = 4
"""Number of names in one message: a lens keeps dozens, and a few suffice to recognise their file."""


def check_layers(stage: Usd.Stage) -> Iterator[Problem]:
    """Problems of the layers themselves."""
    yield from _check_root(stage)
    yield from list(_check_numbers(stage)) or _check_alike(stage)
    for layer in used_layers(stage):
        file = shown_path(layer.realPath)
        for code, path, message, hint, line in text_map(layer.realPath).flaws:
            yield Problem(code=code, message=message, file=file, line=line, at=path or None, hint=hint)


def _check_root(stage: Usd.Stage) -> Iterator[Problem]:
    root = stage.GetRootLayer()
    if not UsdGeom.StageHasAuthoredMetersPerUnit(stage):
        hint = "USD falls back to centimetres (0.01); write metersPerUnit = 0.001"
        yield metadata_problem(root, "metersPerUnit", "units", "the stage does not set metersPerUnit", hint=hint)
    hint = 'write upAxis = "Y"'
    if not stage.HasAuthoredMetadata(UsdGeom.Tokens.upAxis):
        missing = metadata_problem(root, "upAxis", "up-axis", "the stage does not set upAxis", hint=hint)
        yield replace(missing, severity="warning")
    elif (axis := UsdGeom.GetStageUpAxis(stage)) not in (UsdGeom.Tokens.y, UsdGeom.Tokens.z):
        yield metadata_problem(root, "upAxis", "up-axis", f'upAxis = "{axis:.40}" is neither Y nor Z', hint=hint)


def _check_numbers(stage: Usd.Stage) -> Iterator[Problem]:
    for layer in used_layers(stage):
        for key, span in _NUMBERS.items():
            value = _info(layer, key, None)
            if value is not None and not span.holds(value):
                yield metadata_problem(layer, key, "out-of-range", f"{key} = {value} is outside {span}")


def _check_alike(stage: Usd.Stage) -> Iterator[Problem]:
    root, *others = used_layers(stage)
    for key, fallback, why in _ALIKE:
        wanted, values = _info(root, key, fallback), [_info(layer, key, fallback) for layer in others]
        if len(others) > 1 and len(set(values)) == 1 and values[0] != wanted:  # reported once, at the root
            message = f"{key} is {wanted} here and {values[0]} in all {len(others)} layers that it uses"
            hint = f"{why}: say what they say, and write what follows in it"
            yield metadata_problem(root, key, f"layer-{key}", message, hint=hint)
            continue
        for layer, value in zip(others, values, strict=True):
            if value != wanted:
                message = f"{key} is {value} here and {wanted} in {shown_path(root.realPath)}"
                yield replace(metadata_problem(layer, key, f"layer-{key}", message, hint=why), line=1)


def _info(layer: Sdf.Layer, key: str, fallback: object) -> object:
    root = layer.pseudoRoot
    return root.GetInfo(key) if root.HasInfo(key) else fallback


def check_merged(prim: Usd.Prim) -> Iterator[Problem]:
    """A problem if two independent files define a part and something of the weaker remains; files that build on each
    other, and opinions of the stage itself, are no problem.
    """
    link = next((link for name, link in _LINKS.items() if prim.IsA(name)), None)
    index = prim.GetPrimIndex() if link else None
    if not index or not index.rootNode:
        return
    first, *others = _origins(index.rootNode) or [None]
    for other in others:
        kept = _names(other) - _names(first)
        if rest := sorted(name for name in kept if name.split(".")[0] not in kept or "." not in name):
            more = f" and {len(rest) - _MOST_NAMES} more" if len(rest) > _MOST_NAMES else ""
            names = f"{', '.join(rest[:_MOST_NAMES])}{more}"
            message = f'"{prim.GetName()}" is {_file(first)} laid over {_file(other)}, of which it keeps {names}'
            hint = f"a reference replaces nothing: define another prim beside it, and name that one in {link}"
            yield problem(prim, "merged", message, hint=hint)


def _origins(node: Pcp.NodeRef) -> list[Pcp.NodeRef]:
    """Nodes that define a part without building on another definition, strongest first."""
    origins = [origin for child in node.children for origin in _origins(child)]
    return origins or [node] * any(spec.typeName for spec in _specs(node) if spec.specifier == Sdf.SpecifierDef)


def _specs(node: Pcp.NodeRef) -> list[Sdf.PrimSpec]:
    specs = [layer.GetPrimAtPath(node.path) for layer in node.layerStack.layers]
    return [spec for spec in specs if spec]


def _names(node: Pcp.NodeRef) -> set[str]:
    """Properties of a part, and its children with theirs, relative to it."""
    names: set[str] = set()
    for spec in _specs(node):
        names |= {prop.name for prop in spec.properties if prop.name.startswith("plen:")}
        for child in spec.nameChildren:
            names.add(child.name)
            names |= {f"{child.name}.{prop.name}" for prop in child.properties if prop.name.startswith("plen:")}
    return names


def _file(node: Pcp.NodeRef) -> str:
    return shown_path(node.layerStack.layers[0].realPath)


def check_used(stage: Usd.Stage, roots: list[Path]) -> list[Problem]:
    """Problems of layers that lie outside all roots, each at the line that names it, or else line 1 of the root."""
    layers = used_layers(stage)
    outside = {file: layers[0].realPath for layer in layers if not is_inside(file := file_of(layer.realPath), roots)}
    named: dict[str, tuple[str, int]] = {}
    with Ar.ResolverContextBinder(stage.GetPathResolverContext()):
        for layer in layers if outside else ():
            for asset in layer.GetCompositionAssetDependencies():
                file = Ar.GetResolver().Resolve(file_of(layer.ComputeAbsolutePath(asset))).GetPathString()
                if file in outside and file_of(layer.realPath) not in outside:
                    named.setdefault(file, (layer.realPath, text_map(layer.realPath).assets.get(asset, 1)))
    return [
        Problem(
            code="asset-outside",
            message=f"{shown_path(real_path(file))} lies outside the folders that a stage may read",
            file=shown_path(user),
            line=line,
            hint=OUTSIDE_HINT,
        )
        for file, (user, line) in (named or {file: (root, 1) for file, root in outside.items()}).items()
    ]


def check_assets(stage: Usd.Stage, roots: list[Path]) -> Iterator[Problem]:
    """Problems of asset values: pictures that cannot be read, and files outside all roots, missing, or never read."""
    prims = Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate))
    for attribute in (attribute for prim in prims for attribute in prim.GetAuthoredAttributes()):
        prim = attribute.GetPrim()
        if attribute.GetName() in NAMES and is_picture(attribute) and not attribute.GetNumTimeSamples():
            if not is_in_preview(prim):  # previews are of viewers: a copied dataset.usda builds without its pictures
                try:
                    picture_of(attribute)
                except UnreadableValue as error:
                    yield problem(error.thing, error.code, error.what, hint=error.hint)
            continue
        # Other renderers project by tables of files, which nothing of ours reads.
        is_table = prim.GetTypeName() == "Camera" and attribute.GetName().startswith(LENS_DISTORTION_NAMES)
        values = [attribute.Get(), *(attribute.Get(time) for time in attribute.GetTimeSamples())]
        arrays = [[value] if isinstance(value, Sdf.AssetPath) else value for value in values]
        for asset in [asset for array in arrays if isinstance(array, list | Sdf.AssetPathArray) for asset in array]:
            if asset.resolvedPath and not is_inside(file_of(asset.resolvedPath), roots):
                message = f"@{asset.path}@ lies outside the folders that a stage may read"
                yield problem(attribute, "asset-outside", message, hint=OUTSIDE_HINT)
            elif asset.path and not asset.resolvedPath:
                slashes = "asset paths use forward slashes" if "\\" in asset.path else None
                yield problem(attribute, "asset-missing", f"cannot find file @{asset.path}@", hint=slashes)
            elif asset.path and not is_table:
                message = f"@{asset.path}@: files other than layers are not supported yet"
                yield problem(attribute, "not-yet-supported", message)
