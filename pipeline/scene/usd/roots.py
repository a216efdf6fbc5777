"""Files of a stage: its layers, and asset roots, the folders that it may read, which keep a dataset in one place.

Asset roots are the project of the stage, the shipped library, and what the caller adds. Real paths are compared, so
that neither `..` nor a link leads out. USD itself opens whatever a layer names: a stranger's stage needs the walls of
docs/strangers.md.
"""

import os
from collections.abc import Iterable
from pathlib import Path

from pxr import Ar, Sdf, Tf, Usd

from pipeline.folders import share

OUTSIDE_HINT = "mark the folder of the project by an empty file pipeline.toml, or allow a folder with --allow-root"
_PROJECT_MARKS = ("pyproject.toml", "pipeline.toml", ".git")


def real_path(path: str | Path) -> Path:
    """The absolute path with links followed; a link that leads to itself is followed as far as possible."""
    return Path(os.path.realpath(path))


def allowed_roots(stage_file: Path, more: Iterable[str | Path] = ()) -> list[Path]:
    """Real paths of the folders whose files a stage may read.

    The project that holds the stage (nearest ancestor with pyproject.toml, pipeline.toml or .git, else the stage's own
    folder), the shipped library, and what the caller adds.
    """
    folder = real_path(stage_file).parent
    project = next(
        (up for up in (folder, *folder.parents) if any((up / mark).exists() for mark in _PROJECT_MARKS)), folder
    )
    return [project, real_path(share("stages")), *map(real_path, more)]


def is_inside(path: str | Path, roots: Iterable[Path]) -> bool:
    """Whether a file, with links followed, lies below one of the roots."""
    real = real_path(path)
    return any(real.is_relative_to(root) for root in roots)


def used_layers(stage: Usd.Stage) -> list[Sdf.Layer]:
    """Layers with a file, the root first, the others in the order of their paths."""
    root = stage.GetRootLayer()
    others = [layer for layer in stage.GetUsedLayers() if not layer.anonymous and layer != root]
    return [root, *sorted(others, key=lambda layer: layer.realPath)]


def file_of(identifier: str) -> str:
    """The file of a layer identifier: without format arguments, and for a member its package. Empty if malformed."""
    try:
        path, _ = Sdf.Layer.SplitIdentifier(identifier)
    except Tf.ErrorException:
        return ""
    return str(Ar.SplitPackageRelativePathOuter(path)[0])
