"""Checks of asset roots: which layers and other files a stage may name; see `scene.usd.roots`."""

from collections.abc import Iterator
from pathlib import Path

from pxr import Ar, Sdf, Usd

from pipeline.scene.pictures import NAMES, is_picture, picture_of
from pipeline.scene.targets import is_in_preview
from pipeline.scene.usd.problems import Problem, shown_path
from pipeline.scene.usd.roots import OUTSIDE_HINT, is_inside, real_path
from pipeline.scene.usd.source_locations import problem
from pipeline.scene.usd.usda_lines import text_map
from pipeline.scene.usd.used_layers import file_of, used_layers
from pipeline.scene.usd.values import UnreadableValue
from pipeline.scene.write.lens_distortion import LENS_DISTORTION_NAMES


def check_used(stage: Usd.Stage, roots: list[Path]) -> list[Problem]:
    """Problems of layers that lie outside all roots, each at the line that names it, or else line 1 of the root."""
    layers = used_layers(stage)
    outside = {file: layers[0].realPath for one in layers if not is_inside(file := file_of(one.realPath), roots)}
    named: dict[str, tuple[str, int]] = {}
    with Ar.ResolverContextBinder(stage.GetPathResolverContext()):
        for layer in layers if outside else ():
            for asset in layer.GetCompositionAssetDependencies():
                file = Ar.GetResolver().Resolve(file_of(layer.ComputeAbsolutePath(asset))).GetPathString()
                if file in outside and file_of(layer.realPath) not in outside:
                    named.setdefault(file, (layer.realPath, text_map(layer.realPath).assets.get(asset, 1)))
    return [_outside(file, *place) for file, place in named.items()] or [
        _outside(file, root, 1) for file, root in outside.items()
    ]


def _outside(layer: str, user: str, line: int) -> Problem:
    return Problem(
        code="asset-outside",
        message=f"{shown_path(real_path(layer))} lies outside the folders that a stage may read",
        file=shown_path(user),
        line=line,
        hint=OUTSIDE_HINT,
    )


def check_assets(stage: Usd.Stage, roots: list[Path]) -> list[Problem]:
    """Problems of asset values: pictures that cannot be read, other files outside all roots, those that are missing,
    and those that nothing reads, but tables of other renderers.
    """
    prims = Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate))
    return [problem for prim in prims for problem in _check_asset_values(prim, roots)]


def _check_asset_values(prim: Usd.Prim, roots: list[Path]) -> Iterator[Problem]:
    for attribute in prim.GetAuthoredAttributes():
        if attribute.GetName() in NAMES and is_picture(attribute) and not attribute.GetNumTimeSamples():
            # Previews are of viewers: a copied dataset.usda builds without its pictures.
            yield from () if is_in_preview(prim) else _check_picture(attribute)
            continue
        values = [attribute.Get(), *(attribute.Get(time) for time in attribute.GetTimeSamples())]
        for asset in [asset for value in values for asset in _assets(value)]:
            if asset.resolvedPath and not is_inside(file_of(asset.resolvedPath), roots):
                message = f"@{asset.path}@ lies outside the folders that a stage may read"
                yield problem(attribute, "asset-outside", message, hint=OUTSIDE_HINT)
            elif asset.path and not asset.resolvedPath:
                slashes = "asset paths use forward slashes" if "\\" in asset.path else None
                yield problem(attribute, "asset-missing", f"cannot find file @{asset.path}@", hint=slashes)
            elif asset.path and not _is_of_others(attribute):
                message = f"@{asset.path}@: files other than layers are not supported yet"
                yield problem(attribute, "not-yet-supported", message)


def _check_picture(attribute: Usd.Attribute) -> Iterator[Problem]:
    try:
        picture_of(attribute)
    except UnreadableValue as error:
        yield problem(error.thing, error.code, error.what, hint=error.hint)


def _is_of_others(attribute: Usd.Attribute) -> bool:
    """Whether an attribute names a table by which other renderers project: nothing of ours reads it."""
    is_camera = attribute.GetPrim().GetTypeName() == "Camera"
    return is_camera and str(attribute.GetName()).startswith(LENS_DISTORTION_NAMES)


def _assets(value: object) -> list[Sdf.AssetPath]:
    if isinstance(value, Sdf.AssetPath):
        return [value]
    return list(value) if isinstance(value, Sdf.AssetPathArray) else []
