"""Folders that a stage may read: its project, the shipped library, and those that the caller adds."""

import os
from collections.abc import Iterable
from pathlib import Path

from pipeline.folders import share
from pipeline.jit.decorators import cache_folder

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


def readable_for(roots: Iterable[Path]) -> list[Path]:
    """Folders that a process needs to load a stage: its roots, and those of this package and of USD's plug-ins."""
    plugins = filter(None, os.environ.get("PXR_PLUGINPATH_NAME", "").split(os.pathsep))
    return [*roots, share("stages"), share("schemas"), real_path(cache_folder()), *map(Path, plugins)]
