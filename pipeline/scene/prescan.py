"""Before a stage is composed: which files would that open, and may it?

USD opens what a layer names while it composes, so a check afterwards comes too late for files that nobody may read.
Layers are therefore opened one by one here, and only those that lie inside the allowed roots.
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from pxr import Ar, Sdf, Tf, UsdUtils

from pipeline.limits import how_to_raise, limits
from pipeline.scene.asset_roots import file_of, outside
from pipeline.scene.layer_files import check_layer_file, is_plain_file, real_path
from pipeline.scene.lines import line_of, text_map
from pipeline.scene.problems import Problem, shown_path


@dataclass(frozen=True, slots=True)
class _Mention:
    """An asset path, made absolute, and where it is written."""

    identifier: str
    user: str
    asset: str | None = None
    is_layer: bool = True

    @property
    def is_expression(self) -> bool:
        """Whether USD computes the path, of variables that other layers may set."""
        return bool(Sdf.VariableExpression.IsExpression(self.asset or ""))

    def problem(self, code: str, message: str, hint: str | None = None) -> Problem:
        """A problem at the line that mentions it."""
        line = text_map(self.user).assets.get(self.asset or "", 1)
        return Problem(code=code, message=message, file=shown_path(self.user), line=line, hint=hint)


def refusals(path: Path, roots: list[Path]) -> list[Problem]:
    """Why a stage must not even be composed; empty if it may."""
    root = real_path(path).as_posix()
    # As USD does when it opens the stage: names without ./ are also looked for beside the root layer.
    context = Ar.GetResolver().CreateDefaultContextForAsset(root)
    # What opening a layer has to say, it says again when the stage is opened.
    delegate = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        with Ar.ResolverContextBinder(context):
            return _refusals(_Mention(root, root), roots)
    finally:
        delegate.TakeUncoalescedDiagnostics()
        del delegate


def _refusals(root: _Mention, roots: list[Path]) -> list[Problem]:
    found: list[Problem] = []
    seen: set[tuple[str, bool]] = set()
    todo, most = [root], limits().layers
    while todo:
        mention = todo.pop()
        if (mention.identifier, mention.is_layer) in seen:
            continue
        seen.add((mention.identifier, mention.is_layer))
        if len(seen) > most:
            hint = how_to_raise("layers", 10 * most)
            return [root.problem("too-many-layers", f"the stage names more than {most:,} layers", hint)]
        if mention.is_expression:
            message = f"@{mention.asset}@: expressions in asset paths are not supported yet"
            found.append(mention.problem("not-yet-supported", message))
            continue
        # Only the file around a member of a package: to look for the member, USD opens the package.
        file = Ar.GetResolver().Resolve(file_of(mention.identifier)).GetPathString()
        if not file:
            continue  # USD finds nothing either, and says so with its place
        problems = list(_check_file(file, mention, roots))
        if not problems and mention.is_layer and (layer := _opened(mention.identifier)):
            problems = list(_check_clips(layer))
            todo += _mentions(layer)
        found += problems
    return list(dict.fromkeys(found))


def _check_file(file: str, mention: _Mention, roots: list[Path]) -> Iterator[Problem]:
    if problem := outside(file, roots, mention.user, mention.asset):
        yield problem
    elif not is_plain_file(file):
        yield mention.problem("file-kind", f"{shown_path(file)} is not a plain file")
    else:
        yield from check_layer_file(Path(file))


def _opened(identifier: str) -> Sdf.Layer | None:
    """A layer; None if it does not parse, which is reported when the stage is opened."""
    with suppress(Tf.ErrorException):
        return Sdf.Layer.FindOrOpen(identifier)
    return None


def _check_clips(layer: Sdf.Layer) -> Iterator[Problem]:
    for spec in _specs(layer):
        if spec.HasInfo("clips") or spec.HasInfo("clipSets"):
            message = "value clips are not supported yet"
            line = line_of(layer.realPath, str(spec.path)) or 1
            yield Problem(code="not-yet-supported", message=message, file=shown_path(layer.realPath), line=line)


def _mentions(layer: Sdf.Layer) -> Iterator[_Mention]:
    """What USD would open: layers, and packages that hold an asset value, which it looks into to find that."""
    for asset in layer.GetCompositionAssetDependencies():
        yield _Mention(layer.ComputeAbsolutePath(asset), layer.realPath, asset)
    for asset in _asset_values(layer):
        if Ar.IsPackageRelativePath(asset) or Sdf.VariableExpression.IsExpression(asset):
            yield _Mention(layer.ComputeAbsolutePath(asset), layer.realPath, asset, is_layer=False)


def _asset_values(layer: Sdf.Layer) -> Iterator[str]:
    """Asset paths in values and metadata, as written."""
    for spec in _specs(layer):
        for key in spec.ListInfoKeys():
            with suppress(TypeError, Tf.ErrorException):  # a value that Python cannot hold, or that is damaged
                yield from _assets_in(spec.GetInfo(key))


def _assets_in(value: object) -> Iterator[str]:
    if isinstance(value, Sdf.AssetPath):
        yield value.authoredPath
    elif isinstance(value, Sdf.AssetPathArray):
        yield from (asset.authoredPath for asset in value)
    elif isinstance(value, dict):
        for inner in value.values():
            yield from _assets_in(inner)


def _specs(layer: Sdf.Layer) -> list[Sdf.Spec]:
    paths: list[Sdf.Path] = []
    layer.Traverse(Sdf.Path.absoluteRootPath, paths.append)
    return [spec for path in paths if (spec := layer.GetObjectAtPath(path))]
