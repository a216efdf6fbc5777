"""Stages that a command reads, with one of their cameras or targets chosen by name, and stages that it writes.

An imported file of another program becomes a stage, and each loss a warning.
"""

import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pipeline.camera.parts.errors import CameraError
from pipeline.engine.files import chosen_place
from pipeline.entry_points import plugged_in
from pipeline.errors import UsageError
from pipeline.files.drawings import write_drawing
from pipeline.folders import put, shipped_folder
from pipeline.optics.prescription import PrescriptionError
from pipeline.optics.printed import Lost
from pipeline.scene.load import Loaded, load
from pipeline.scene.usd.problems import Problem, StageError, shown_path
from pipeline.scene.write.text import camera_text, lens_text
from pipeline.spelling import did_you_mean


def sound(path: str | Path, allow_roots: Iterable[str | Path] = ()) -> Loaded:
    """A stage that passes `check`; StageError if it does not."""
    loaded = load(path, allow_roots)
    if loaded.errors:
        raise StageError(loaded.problems)
    return loaded


def lacking(path: str | Path, kind: str, hint: str) -> StageError:
    """The error about a stage that holds no camera, or no target (`kind`)."""
    file = shown_path(Path(path).resolve())
    message = f"the stage holds no {kind}"
    return StageError([Problem(code=f"no-{kind}", message=message, file=file, line=1, hint=hint)])


def chosen(path: str | Path, kind: str, names: list[str], wanted: str | None) -> int:
    """Index of the camera or target (`kind`) named `wanted`. None suffices if the stage has only one.

    UsageError if no entry has that name, or the stage has several and none is named.
    """
    if wanted is None and len(names) > 1:
        raise UsageError(f"{path} has {len(names)} {kind}s: {', '.join(names)}", hint="name one of them")
    if wanted is not None and wanted not in names:
        hint = did_you_mean(wanted, names) or f"its {kind}s: {', '.join(names)}"
        raise UsageError(f'{path} has no {kind} "{wanted}"', hint=hint)
    return 0 if wanted is None else names.index(wanted)


def stage_or_library_path(path: Path) -> Path:
    """The path of a stage if it exists, or else that of the stage of this name in the shipped library.

    Raises UsageError: it is in neither.
    """
    if path.exists():
        return path
    library = shipped_folder("stages")
    if (library / path).is_file():
        return library / path
    names = [file.relative_to(library).as_posix() for file in library.glob("*/*.usda")]
    same_stem = [name for name in names if Path(name).stem == path.stem]
    hint = f'did you mean "{same_stem[0]}"?' if same_stem else did_you_mean(str(path), names)
    hint = hint or "`pipeline library` lists what it has"
    raise UsageError(f"there is no {path}, and the library has none", hint=hint)


def asset_path(path: Path, out: Path) -> str:
    """Asset path of a stage for a layer that will lie at `out`; names of the library stay names."""
    if not path.exists():
        return path.as_posix()
    relative = Path(os.path.relpath(path.resolve(), out.resolve().parent)).as_posix()
    return relative if relative.startswith("..") else f"./{relative}"


def existing(path: Path) -> UsageError:
    """The error about a new file whose name is taken."""
    return UsageError(f"{path} exists", hint="choose another name, or remove it")


def write_new(text: str, path: Path) -> None:
    """Write a new text file; UsageError if the name is taken, EnvironmentFault if it cannot be written."""
    if os.path.lexists(path):
        raise existing(path)
    with chosen_place("write", path):
        put(path, text.encode())


def draw(drawing: str | bytes, path: Path) -> None:
    """Write a drawing that a user asked for; as `write_drawing`, and EnvironmentFault if it cannot be written."""
    with chosen_place("write", path):
        write_drawing(path, drawing)


@dataclass(frozen=True, slots=True, kw_only=True)
class Imported:
    """An imported lens or camera as the text of a stage, and the statements of the file that no stage can hold."""

    text: str
    warnings: tuple[str, ...]


def import_lens(
    path: Path,
    spacing: str | None = None,
    catalogues: Sequence[Path] = (),
    replaced: Sequence[str] = (),
    **options: Any,
) -> Imported:
    """Import the lens of a file as a stage; arguments and errors are those of the plug-in's reader for its suffix."""
    read = plugged_in("reader", f"lens{path.suffix.lower()}")
    lens = read(path, spacing, catalogues=catalogues, replaced=replaced, **options)
    return _imported(path, lens, lens.lost, lens_text)


def import_camera(path: Path, lens: Path | None = None) -> Imported:
    """Import the camera of a file as a rig, as `import_lens` does; one of the Blender add-on needs a lens table."""
    camera = plugged_in("reader", f"camera{path.suffix.lower()}")(path, lens)
    return _imported(path, camera, (*camera.lens.lost, *camera.lost), camera_text)


def _imported(path: Path, read: Any, lost: Sequence[Lost], text_of: Callable[[Any], str]) -> Imported:
    """A lens or camera that was read, as the text of a stage whose provenance lists the losses."""
    losses = "; ".join(loss.statement for loss in lost)
    notes = (f"Not part of this stage, or decided on import: {losses}.",) if losses else ()
    try:
        text = text_of(replace(read, provenance=(*read.provenance, *notes)))
    except (PrescriptionError, CameraError) as error:
        raise UsageError(f"{path}: {error.message}", hint=error.hint) from None
    locations = ((f"{path}:{loss.line}" if loss.line else str(path), loss) for loss in lost)
    return Imported(text=text, warnings=tuple(f"{location}: warning: {loss.statement}" for location, loss in locations))


def require_free(out: Path) -> None:
    """Raise UsageError if no new stage can be written there: another suffix, a name that is taken, no such folder."""
    if out.suffix != ".usda":
        raise UsageError(f"{out} must end in .usda", hint=f"write {out.with_suffix('.usda')}" if out.name else None)
    if os.path.lexists(out):
        raise existing(out)
    if not out.parent.is_dir():
        raise UsageError(f"{out} cannot be written: there is no folder {out.parent}", hint=f"mkdir -p {out.parent}")


def write_stage(text: str, out: Path) -> list[Problem]:
    """Write a new stage, check it, and return its problems."""
    require_free(out)
    write_new(text, out)
    return load(out, look=True).problems


def write_sound(text: str, out: Path) -> Loaded:
    """Write a new stage and read it; a stage with errors raises StageError and is not kept."""
    require_free(out)
    write_new(text, out)
    try:
        loaded = load(out, look=True)
        if loaded.errors:
            raise StageError(unwritten(loaded.errors, out, out))
    except BaseException:
        out.unlink(missing_ok=True)
        raise
    return loaded


def unwritten(problems: Iterable[Problem], read: Path, out: Path) -> list[Problem]:
    """Problems of a stage that was `read` before it lies at `out`: lines of its own text mean nothing to a user."""
    file = shown_path(read.resolve())
    return [
        replace(problem, file=str(out), line=None, column=None, at=None) if problem.file == file else problem
        for problem in problems
    ]
