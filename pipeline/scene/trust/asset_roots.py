"""Asset roots: a stage may read only files below allowed folders.

A stage of ten lines can name any file of the machine, and USD would open it. Real paths are compared, so that
neither `..` nor a link leads out.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path

from pxr import Ar, Sdf, Tf, Usd

from pipeline.roots import real_path
from pipeline.scene.pictures import NAMES, OUTSIDE_HINT, is_picture, picture_of
from pipeline.scene.targets import is_in_preview
from pipeline.scene.usd.problems import Problem, shown_path
from pipeline.scene.usd.source_locations import problem
from pipeline.scene.usd.usda_lines import text_map
from pipeline.scene.usd.used_layers import used_layers
from pipeline.scene.usd.values import UnreadableValue
from pipeline.scene.write.lens_distortion import LENS_DISTORTION_NAMES


def is_inside(path: str | Path, roots: Iterable[Path]) -> bool:
    """Whether a file, with links followed, lies below one of the roots."""
    real = real_path(path)
    return any(real.is_relative_to(root) for root in roots)


def file_of(identifier: str) -> str:
    """The file of a layer identifier: without format arguments, and for a member its package. Empty if malformed."""
    try:
        path, _ = Sdf.Layer.SplitIdentifier(identifier)
    except Tf.ErrorException:
        return ""
    return str(Ar.SplitPackageRelativePathOuter(path)[0])


def outside(file: str, roots: list[Path], user: str, asset: str | None = None) -> Problem | None:
    """The problem that a file lies outside all roots, at the line that mentions the asset; None if it lies inside."""
    if is_inside(file, roots):
        return None
    return Problem(
        code="asset-outside",
        message=f"{shown_path(real_path(file))} lies outside the folders that a stage may read",
        file=shown_path(user),
        line=text_map(user).assets.get(asset or "", 1),
        hint=OUTSIDE_HINT,
    )


def check_used(stage: Usd.Stage, roots: list[Path]) -> list[Problem]:
    """Problems of layers of the composed stage that lie outside all roots, by whatever way they were found."""
    root = stage.GetRootLayer().realPath
    found = (outside(file_of(layer.realPath), roots, root) for layer in used_layers(stage))
    return [problem for problem in found if problem]


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
