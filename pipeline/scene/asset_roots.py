"""Which files may a stage read? Only those below the roots that we allow.

A ten-line stage can name any file of the machine, and USD resolves it. Real paths are compared, so that neither `..`
nor a link leads out.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path

from pxr import Ar, Sdf, Usd

from pipeline.scene.check_layers import used_layers
from pipeline.scene.lines import text_map
from pipeline.scene.places import problem
from pipeline.scene.problems import Problem, shown_path
from pipeline.scene.register import library_path

_PROJECT_MARKS = ("pyproject.toml", "pipeline.toml", ".git")

HINT = "mark the folder of the project by an empty file pipeline.toml, or allow a folder with --allow-root"


def allowed_roots(stage_file: Path, more: Iterable[str | Path] = ()) -> list[Path]:
    """Real paths of the folders whose files a stage may read.

    The project that holds the stage (nearest ancestor with pyproject.toml, pipeline.toml or .git, else the stage's own
    folder), the shipped library, and what the caller adds.
    """
    folder = stage_file.resolve().parent
    project = next(
        (up for up in (folder, *folder.parents) if any((up / mark).exists() for mark in _PROJECT_MARKS)), folder
    )
    return [project, Path(library_path()).resolve(), *(Path(root).resolve() for root in more)]


def is_inside(path: str | Path, roots: Iterable[Path]) -> bool:
    """Whether the file itself, links followed, lies below one of the roots."""
    real = Path(path).resolve()
    return any(real.is_relative_to(root) for root in roots)


def check_assets(stage: Usd.Stage, roots: list[Path]) -> list[Problem]:
    """Layers and asset values that lie outside of all roots, and asset values altogether: nothing reads them yet."""
    found = []
    if not is_inside(stage.GetRootLayer().realPath, roots):
        found.append(_outside(stage.GetRootLayer().realPath, stage.GetRootLayer().realPath, None))
    for layer in used_layers(stage):
        if is_inside(layer.realPath, roots):
            found += _check_arcs(layer, roots)
    for prim in Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate)):
        found += _check_asset_values(prim, roots)
    return found


def _check_arcs(layer: Sdf.Layer, roots: list[Path]) -> Iterator[Problem]:
    """References, payloads and sublayers of a layer."""
    for asset in layer.GetCompositionAssetDependencies():
        resolved = Ar.GetResolver().Resolve(layer.ComputeAbsolutePath(asset)).GetPathString()
        if resolved and not is_inside(resolved, roots):
            yield _outside(layer.realPath, resolved, asset)


def _outside(layer_file: str, resolved: str, asset: str | None) -> Problem:
    return Problem(
        code="asset-outside",
        message=f"{shown_path(Path(resolved).resolve())} lies outside the folders that a stage may read",
        file=shown_path(layer_file),
        line=text_map(layer_file).assets.get(asset) if asset else None,
        hint=HINT,
    )


def _check_asset_values(prim: Usd.Prim, roots: list[Path]) -> Iterator[Problem]:
    for attribute in prim.GetAuthoredAttributes():
        values = [attribute.Get(), *(attribute.Get(time) for time in attribute.GetTimeSamples())]
        for asset in [asset for value in values for asset in _assets(value)]:
            if asset.resolvedPath and not is_inside(asset.resolvedPath, roots):
                message = f"@{asset.path}@ lies outside the folders that a stage may read"
                hint = HINT
                yield problem(attribute, "asset-outside", message, hint=hint)
            elif asset.path and not asset.resolvedPath:
                slashes = "asset paths use forward slashes" if "\\" in asset.path else None
                yield problem(attribute, "asset-missing", f"cannot find file @{asset.path}@", hint=slashes)
            elif asset.path:
                message = f"@{asset.path}@: files other than layers are not supported yet"
                yield problem(attribute, "not-yet-supported", message)


def _assets(value: object) -> list[Sdf.AssetPath]:
    if isinstance(value, Sdf.AssetPath):
        return [value]
    return list(value) if isinstance(value, Sdf.AssetPathArray) else []
