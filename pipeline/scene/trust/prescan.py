"""Inspection of all files that composing a stage would open, before it is composed.

USD opens the files that a layer names while it composes, so a check afterwards would be too late for forbidden
files. Layers are therefore opened here one by one, from exactly the inspected bytes, and only inside the allowed
roots. While they are held, USD composes the stage from them and does not open the files again.
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from pxr import Ar, Sdf, Tf

from pipeline.confine.process import Guards
from pipeline.limits import how_to_raise, limits
from pipeline.scene.trust.asset_roots import file_of, outside
from pipeline.scene.trust.census import most_prims
from pipeline.scene.trust.judged_layers import layer_of
from pipeline.scene.trust.trial import announce, trial
from pipeline.scene.usd.hints import of_folder
from pipeline.scene.usd.layer_files import LayerFile, is_plain_file, read_layer_file
from pipeline.scene.usd.opening import problems_of
from pipeline.scene.usd.problems import Problem, shown_path
from pipeline.scene.usd.usda_lines import TextMap, line_of, text_map


@dataclass(frozen=True, slots=True)
class _Mention:
    """An absolute asset path, and the layer that mentions it."""

    identifier: str
    user: str
    asset: str | None = None
    is_layer: bool = True

    @property
    def is_expression(self) -> bool:
        """Whether the path is an expression of variables that other layers may set."""
        return bool(Sdf.VariableExpression.IsExpression(self.asset or ""))

    @property
    def line(self) -> int:
        """The line that mentions it."""
        return text_map(self.user).assets.get(self.asset or "", 1)

    def problem(self, code: str, message: str, hint: str | None = None) -> Problem:
        """A problem at the line that mentions it."""
        return Problem(code=code, message=message, file=shown_path(self.user), line=self.line, hint=hint)


@dataclass(slots=True)
class Look:
    """The inspection of the layers of a stage.

    Attributes
    ----------
    root : Path
        File of the stage.
    roots : list of Path
        Folders from which it may read.
    texts : dict
        Maps of all texts that were read, for `lines.text_map`.
    guards : Guards or None
        Guards of this process, if it is a confined one.
    layers : dict
        Real path -> layer: held, so that USD uses it.
    problems : list of Problem
        Problems that forbid even composing the stage; empty if there are none.
    """

    root: Path
    roots: list[Path]
    texts: dict[str, TextMap]
    guards: Guards | None = None
    layers: dict[str, Sdf.Layer] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)
    _files: dict[str, LayerFile] = field(default_factory=dict)
    _was_tried: bool = False

    def run(self) -> None:
        """Open all layers that composing the stage would open."""
        # As in USD, names without ./ are also searched beside the root layer.
        context = Ar.GetResolver().CreateDefaultContextForAsset(self.root.as_posix())
        try:
            with Ar.ResolverContextBinder(context):
                self._run(_Mention(self.root.as_posix(), self.root.as_posix()))
                self._count_prims()
        finally:
            self._files.clear()
        self.problems = list(dict.fromkeys(self.problems))

    def _run(self, root: _Mention) -> None:
        seen: set[tuple[str, bool]] = set()
        todo, most = [root], limits().layers
        while todo:
            mention = todo.pop()
            if (mention.identifier, mention.is_layer) in seen:
                continue
            seen.add((mention.identifier, mention.is_layer))
            if len(seen) > most:
                hint = how_to_raise("layers", 10 * most)
                self.problems = [root.problem("too-many-layers", f"the stage names more than {most:,} layers", hint)]
                return
            if mention.is_expression:
                message = f"@{mention.asset}@: expressions in asset paths are not supported yet"
                self.problems.append(mention.problem("not-yet-supported", message))
            elif (file := self._file(mention)) and mention.is_layer and (layer := self._layer(mention, file)):
                self.problems += _clips(layer)
                todo += _mentions(layer)

    def _count_prims(self) -> None:
        """Refuse a stage that multiplies prims: USD would make all of them, even without enough memory."""
        layer = self.layers.get(self.root.as_posix())
        count, most = most_prims(layer) if layer and not self.problems else 0, limits().prims
        if count > most:
            message = f"up to {count:,} prims are more than the limit of {most:,} prims"
            root, hint = self.root.as_posix(), how_to_raise("prims", count)
            self.problems.append(_Mention(root, root).problem("over-limit", message, hint))

    def _file(self, mention: _Mention) -> LayerFile | None:
        """The file of a mention, if it exists and has no problem."""
        # For a member only its package: USD opens the package to look for the member.
        path = Ar.GetResolver().Resolve(file_of(mention.identifier)).GetPathString()
        if not path:
            return None  # USD finds nothing either, and reports the place
        if path not in self._files:
            try:
                self._files[path] = read_layer_file(path, self.roots)
            except OSError as error:
                code, why = ("unreadable", error.strerror) if is_plain_file(path) else ("file-kind", "not a plain file")
                self.problems.append(mention.problem(code, f"{shown_path(path)}: {why}"))
                return None
            self.texts.update(self._files[path].texts)
        file = self._files[path]
        problems = list(self._refusals(path, file, mention))
        self.problems += problems
        return None if problems else file

    def _refusals(self, path: str, file: LayerFile, mention: _Mention) -> Iterator[Problem]:
        if problem := outside(str(file.real), self.roots, mention.user, mention.asset):
            yield problem
        elif not file.is_plain:
            hint = of_folder(self.root) if file.real == self.root else None
            yield mention.problem("file-kind", f"{shown_path(path)} is not a plain file", hint)
        elif Sdf.Layer.SplitIdentifier(mention.identifier)[1]:
            message = f"@{mention.asset}@: arguments for the format of a file are not supported yet"
            yield mention.problem("not-yet-supported", message)
        elif file.is_package and self.guards and not self.guards.landlock:
            hint = "use the layers in it, or a kernel with Landlock"
            yield mention.problem("package", "packages of untrusted stages need a kernel with Landlock", hint)
        else:
            yield from file.problems
            if not file.problems and file.is_binary and not self.guards and not self._was_tried:
                self._was_tried = True
                yield from trial(self.root, self.roots)

    def _layer(self, mention: _Mention, file: LayerFile) -> Sdf.Layer | None:
        """A layer of the inspected bytes; None, and a problem is added, if USD cannot read them."""
        resolved = Ar.GetResolver().Resolve(mention.identifier).GetPathString()
        if not resolved:
            return None  # no such member
        if self.guards:
            announce(resolved)
        try:
            layer = layer_of(mention.identifier, resolved, file, confined=self.guards is not None)
        except Tf.ErrorException as error:
            used = None if mention.asset is None else f"the file is used by {shown_path(mention.user)}:{mention.line}"
            self.problems += problems_of(error, Path(resolved), used)
            return None
        if layer:
            self.layers[layer.identifier] = layer
        return layer


def _clips(layer: Sdf.Layer) -> Iterator[Problem]:
    for spec in _specs(layer):
        if spec.HasInfo("clips") or spec.HasInfo("clipSets"):
            message = "value clips are not supported yet"
            line = line_of(layer.realPath, str(spec.path)) or 1
            yield Problem(code="not-yet-supported", message=message, file=shown_path(layer.realPath), line=line)


def _mentions(layer: Sdf.Layer) -> Iterator[_Mention]:
    """Mentions of files that USD would open: layers, and packages in which it would look for an asset value."""
    for asset in layer.GetCompositionAssetDependencies():
        yield _Mention(layer.ComputeAbsolutePath(asset), layer.realPath, asset)
    for asset in _asset_values(layer):
        if Ar.IsPackageRelativePath(asset) or Sdf.VariableExpression.IsExpression(asset):
            yield _Mention(layer.ComputeAbsolutePath(asset), layer.realPath, asset, is_layer=False)


def _asset_values(layer: Sdf.Layer) -> Iterator[str]:
    """Asset paths in values and metadata, as written."""
    for spec in _specs(layer):
        for key in spec.ListInfoKeys():
            with suppress(TypeError, Tf.ErrorException):  # a damaged value, or one without a Python type
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
