"""Stages that are named on a command line, as files and as asset paths of a new layer."""

import os
from pathlib import Path

from pipeline.errors import UsageError
from pipeline.folders import share
from pipeline.spelling import did_you_mean


def found(path: Path) -> Path:
    """A stage in the working directory, or of the library.

    Raises
    ------
    UsageError
        It is in neither.
    """
    if path.exists():
        return path
    library = share("stages")
    if (library / path).is_file():
        return library / path
    known = [one.relative_to(library).as_posix() for one in library.glob("*/*.usda")]
    same = [one for one in known if Path(one).stem == path.stem]
    meant = f'did you mean "{same[0]}"?' if same else did_you_mean(str(path), known)
    raise UsageError(
        f"there is no {path}, and the library has none", hint=meant or "`pipeline library` lists what it has"
    )


def asset(path: Path, out: Path) -> str:
    """Asset path of a stage for a layer that lies at `out`; names of the library stay names."""
    if not path.exists():
        return path.as_posix()
    relative = Path(os.path.relpath(path.resolve(), out.resolve().parent)).as_posix()
    return relative if relative.startswith("..") else f"./{relative}"
