"""Before an untrusted stage is composed: which files would it open, may it, and are they of a sane size?

USD opens what a layer names while it composes, so a check afterwards comes too late for files that nobody may read.
Layers are therefore opened one by one here, and only those that lie inside the allowed roots.
"""

import zipfile
from collections.abc import Iterator
from pathlib import Path

from pxr import Ar, Sdf, Tf

from pipeline.scene.asset_roots import HINT, is_inside
from pipeline.scene.problems import Problem, shown_path

MAX_LAYER_BYTES = 256 * 2**20
MAX_LAYERS = 1000


def refusals(path: Path, roots: list[Path]) -> list[Problem]:
    """Why a stage must not even be composed; empty if it may."""
    found: list[Problem] = []
    seen: set[str] = set()
    todo = [(path.resolve().as_posix(), path)]
    while todo and not found:
        identifier, user = todo.pop()
        if identifier in seen:
            continue
        seen.add(identifier)
        file = Path(identifier.partition("[")[0])
        found += [*_place(file, user, roots), *(_size(file) if is_inside(file, roots) else ())]
        if len(seen) > MAX_LAYERS:
            found.append(_problem(path, "too-many-layers", f"more than {MAX_LAYERS} layers"))
        if not found:
            todo += [(name, file) for name in _dependencies(identifier, found)]
    return found


def _place(file: Path, user: Path, roots: list[Path]) -> Iterator[Problem]:
    if not is_inside(file, roots):
        message = f"{shown_path(file.resolve())} lies outside the folders that a stage may read"
        yield _problem(user, "asset-outside", message, HINT)
    elif file.exists() and not file.is_file():
        yield _problem(user, "file-kind", f"{shown_path(file)} is not a plain file")


def _size(file: Path) -> Iterator[Problem]:
    if not file.is_file():
        return
    size = file.stat().st_size
    if size > MAX_LAYER_BYTES:
        yield _problem(file, "file-size", f"{size:,} bytes; a layer may have {MAX_LAYER_BYTES:,}")
    elif file.suffix == ".usdz":
        yield from _package(file)


def _package(file: Path) -> Iterator[Problem]:
    """A usdz is a zip archive whose members are stored, not compressed; it cannot hold more bytes than it has."""
    try:
        with zipfile.ZipFile(file) as archive:
            members = archive.infolist()
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError) as error:
        yield _problem(file, "package", f"not a readable usdz package ({error})")
        return
    for member in members:
        parts = member.filename.replace("\\", "/").split("/")
        if ".." in parts or not parts[0] or ":" in parts[0]:
            yield _problem(file, "package", f"member {member.filename!r} leads outside of the package")
        if member.compress_type != zipfile.ZIP_STORED or member.flag_bits & 1:
            yield _problem(file, "package", f"member {member.filename!r} is compressed or encrypted")
    if sum(member.file_size for member in members) > file.stat().st_size:
        yield _problem(file, "package", "its members claim more bytes than the file has")


def _dependencies(identifier: str, found: list[Problem]) -> list[str]:
    """What a layer names, resolved; a layer that does not parse is reported when the stage is opened."""
    try:
        layer = Sdf.Layer.FindOrOpen(identifier)
    except Tf.ErrorException:
        return []
    if layer is None:
        return []
    if any(_has_clips(layer, path) for path in _prims(layer)):
        found.append(_problem(Path(layer.realPath), "not-yet-supported", "value clips are not supported yet"))
    resolver = Ar.GetResolver()
    names = layer.GetCompositionAssetDependencies()
    resolved = (resolver.Resolve(layer.ComputeAbsolutePath(name)).GetPathString() for name in names)
    return [name for name in resolved if name]


def _prims(layer: Sdf.Layer) -> list[Sdf.Path]:
    paths: list[Sdf.Path] = []
    layer.Traverse(Sdf.Path.absoluteRootPath, paths.append)
    return [path for path in paths if path.IsPrimPath() or path.IsPrimVariantSelectionPath()]


def _has_clips(layer: Sdf.Layer, path: Sdf.Path) -> bool:
    prim = layer.GetPrimAtPath(path)
    return bool(prim) and (prim.HasInfo("clips") or prim.HasInfo("clipSets"))


def _problem(file: Path, code: str, message: str, hint: str | None = None) -> Problem:
    return Problem(code=code, message=message, file=shown_path(file), line=1, hint=hint)
