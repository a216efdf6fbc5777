"""Stages that a command is given: found, read without errors, and one of their cameras or targets chosen by name."""

import os
from collections.abc import Iterable
from pathlib import Path

from pipeline.engine.files import chosen_place
from pipeline.errors import UsageError
from pipeline.folders import share
from pipeline.scene.load import Loaded, load
from pipeline.scene.usd.problems import Problem, StageError, shown_path
from pipeline.spelling import did_you_mean


def sound(path: str | Path, allow_roots: Iterable[str | Path] = ()) -> Loaded:
    """A stage that passes `check`; StageError, if it does not."""
    loaded = load(path, allow_roots)
    if loaded.errors:
        raise StageError(loaded.problems)
    return loaded


def lacking(path: str | Path, kind: str, hint: str) -> StageError:
    """The error about a stage that holds no camera, or no target (`kind`)."""
    file, message = shown_path(Path(path).resolve()), f"the stage holds no {kind}"
    return StageError([Problem(code=f"no-{kind}", message=message, file=file, line=1, hint=hint)])


def chosen(path: str | Path, kind: str, names: list[str], wanted: str | None) -> int:
    """Index of the camera or target (`kind`) with the name `wanted`. None is enough if the stage has only one.

    UsageError, if no entry has that name, or the stage has several and none is named.
    """
    if wanted is None and len(names) > 1:
        raise UsageError(f"{path} has {len(names)} {kind}s: {', '.join(names)}", hint="name one of them")
    if wanted is not None and wanted not in names:
        hint = did_you_mean(wanted, names) or f"its {kind}s: {', '.join(names)}"
        raise UsageError(f'{path} has no {kind} "{wanted}"', hint=hint)
    return 0 if wanted is None else names.index(wanted)


def located(path: Path) -> Path:
    """A stage in the working directory, or of the library; UsageError, if it is in neither."""
    if path.exists():
        return path
    library = share("stages")
    if (library / path).is_file():
        return library / path
    known = [file.relative_to(library).as_posix() for file in library.glob("*/*.usda")]
    same = [name for name in known if Path(name).stem == path.stem]
    hint = f'did you mean "{same[0]}"?' if same else did_you_mean(str(path), known)
    hint = hint or "`pipeline library` lists what it has"
    raise UsageError(f"there is no {path}, and the library has none", hint=hint)


def asset_path(path: Path, out: Path) -> str:
    """Asset path of a stage for a layer that lies at `out`; names of the library stay names."""
    if not path.exists():
        return path.as_posix()
    relative = Path(os.path.relpath(path.resolve(), out.resolve().parent)).as_posix()
    return relative if relative.startswith("..") else f"./{relative}"


def existing(path: Path) -> UsageError:
    """The error about a new file whose name is taken."""
    return UsageError(f"{path} exists", hint="choose another name, or remove it")


def write_new(text: str, path: Path) -> None:
    """Write a new text file: UsageError, if there is one of that name, EnvironmentFault, if it cannot be written."""
    if path.exists():
        raise existing(path)
    with chosen_place("write", path), path.open("x", encoding="utf-8", newline="\n") as stream:
        stream.write(text)
