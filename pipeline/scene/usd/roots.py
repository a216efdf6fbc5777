"""Schemas and library, layers of a stage, and asset roots: the folders that a stage may read.

Asset roots are the project of the stage, the shipped library, and what the caller adds: they keep a dataset in one
place. Real paths are compared, so that neither `..` nor a link leads out. USD itself opens whatever a layer names: a
stranger's stage needs the walls of docs/strangers.md.
"""

import os
from collections.abc import Iterable
from pathlib import Path

from pxr import Ar, Plug, Sdf, Tf, Usd

from pipeline.errors import EnvironmentFault
from pipeline.folders import shipped_folder

PLUGIN_NAME = "plenScene"
OUTSIDE_HINT = "mark the folder of the project by an empty file pipeline.toml, or allow a folder with --allow-root"
_PROJECT_MARKS = ("pyproject.toml", "pipeline.toml", ".git")


def plugin_path() -> str:
    """Folder to put on PXR_PLUGINPATH_NAME, so that any USD program knows the plenScene schemas."""
    return shipped_folder("schemas").as_posix()


def library_path() -> str:
    """Folder of the shipped stages, to put on PXR_AR_DEFAULT_SEARCH_PATH for other USD programs."""
    return shipped_folder("stages").as_posix()


def register() -> None:
    """Register schemas and library; EnvironmentFault if a stage was opened before, so that USD would ignore them."""
    registry = Plug.Registry()
    # USD may have found it already through PXR_PLUGINPATH_NAME.
    if registry.GetPluginWithName(PLUGIN_NAME) is None:
        registry.RegisterPlugins(plugin_path())
    # This call builds USD's schema registry now, in the importing thread: built first in another thread it may hang,
    # and without the call a late import would only be noticed as prims without a type.
    if Usd.SchemaRegistry().FindConcretePrimDefinition("PlenDataset") is None:
        raise EnvironmentFault(
            "USD ignores the plenScene schemas, because it had opened a stage before they were registered",
            hint=f"import pipeline.scene before opening a stage, or set PXR_PLUGINPATH_NAME={plugin_path()}",
        )
    # Setting the path replaces that of the environment variable, so it is repeated here.
    theirs = [folder for folder in os.environ.get("PXR_AR_DEFAULT_SEARCH_PATH", "").split(os.pathsep) if folder]
    Ar.DefaultResolver.SetDefaultSearchPath([library_path(), *theirs])


def real_path(path: str | Path) -> Path:
    """The absolute path with links followed; a link that leads to itself is followed as far as possible."""
    return Path(os.path.realpath(path))


def allowed_roots(stage_file: Path, more: Iterable[str | Path] = ()) -> list[Path]:
    """Real paths of the folders whose files a stage may read: the project that holds the stage (nearest ancestor with
    pyproject.toml, pipeline.toml or .git, else the stage's own folder), the shipped library, and what the caller adds.
    """
    folder = real_path(stage_file).parent
    project = next(
        (up for up in (folder, *folder.parents) if any((up / mark).exists() for mark in _PROJECT_MARKS)), folder
    )
    return [project, real_path(library_path()), *map(real_path, more)]


def is_inside(path: str | Path, roots: Iterable[Path]) -> bool:
    """Whether a file, with links followed, lies below one of the roots."""
    real = real_path(path)
    return any(real.is_relative_to(root) for root in roots)


def used_layers(stage: Usd.Stage) -> list[Sdf.Layer]:
    """Layers with a file, the root first, the others in the order of their paths."""
    root = stage.GetRootLayer()
    layers = [layer for layer in stage.GetUsedLayers() if not layer.anonymous and layer != root]
    return [root, *sorted(layers, key=lambda layer: layer.realPath)]


def file_of(identifier: str) -> str:
    """The file of a layer identifier: without format arguments, and for a member its package. Empty if malformed."""
    try:
        path, _ = Sdf.Layer.SplitIdentifier(identifier)
    except Tf.ErrorException:
        return ""
    return str(Ar.SplitPackageRelativePathOuter(path)[0])
