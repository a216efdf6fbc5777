"""Import of files of other programs: read, write as a USD stage, check. Whatever is lost becomes a warning."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pipeline.app.stages import existing, write_new
from pipeline.camera.parts.errors import CameraError
from pipeline.errors import UsageError
from pipeline.files.lenses.read import read_camera_file, read_lens
from pipeline.files.lenses.text import UnreadableLens
from pipeline.optics.prescription import PrescriptionError
from pipeline.optics.printed import Lost
from pipeline.scene.load import Loaded, load
from pipeline.scene.usd.problems import Problem, StageError, shown_path
from pipeline.scene.write.text import camera_text, lens_text
from pipeline.scene.write.viewers import fix


@dataclass(frozen=True, slots=True, kw_only=True)
class Imported:
    """An imported lens or camera as the text of a stage, and statements of the file that no stage can hold."""

    text: str
    warnings: tuple[str, ...]


def import_lens(path: Path, spacing: str | None = None, **options: Any) -> Imported:
    """Import the lens of a file as a stage; arguments and errors are those of `read_lens`."""
    lens = read_lens(path, spacing, **options)
    return _imported(path, lens, lens.lost, lens_text)


def import_camera(path: Path, lens: Path | None = None) -> Imported:
    """Import the camera of a file as a rig, as `import_lens` does; one of the Blender add-on needs a lens table."""
    camera = read_camera_file(path, lens)
    return _imported(path, camera, (*camera.lens.lost, *camera.lost), camera_text)


def _imported(path: Path, read: Any, lost: Sequence[Lost], text_of: Callable[[Any], str]) -> Imported:
    losses = "; ".join(loss.what for loss in lost)
    notes = (f"Not part of this stage, or decided on import: {losses}.",) if losses else ()
    try:
        text = text_of(replace(read, provenance=(*read.provenance, *notes)))
    except (PrescriptionError, CameraError) as error:
        raise UnreadableLens(path, error.what, hint=error.hint) from None
    places = ((f"{path}:{loss.line}" if loss.line else str(path), loss) for loss in lost)
    return Imported(text=text, warnings=tuple(f"{place}: warning: {loss.what}" for place, loss in places))


def require_free(out: Path) -> None:
    """UsageError where no new stage can be written: another suffix, something is there, or there is no such folder."""
    if out.suffix != ".usda":
        raise UsageError(f"{out} must end in .usda", hint=f"write {out.with_suffix('.usda')}" if out.name else None)
    if out.exists():
        raise existing(out)
    if not out.parent.is_dir():
        raise UsageError(f"{out} cannot be written: there is no folder {out.parent}", hint=f"mkdir -p {out.parent}")


def write_stage(text: str, out: Path) -> list[Problem]:
    """Write a new stage, check it, and return its problems."""
    require_free(out)
    write_new(text, out)
    return load(out, look=True).problems


def write_whole(text: str, out: Path) -> Loaded:
    """Write a new stage with the lines that viewers need, and read it; one with errors, StageError, is not kept."""
    if errors := [problem for problem in write_stage(text, out) if problem.is_error]:
        out.unlink()
        raise StageError(unwritten(errors, out, out))
    fix(out)
    return load(out)


def unwritten(problems: Iterable[Problem], read: Path, out: Path) -> list[Problem]:
    """Problems of a stage that was `read` and will not lie at `out`: those of its own text have no line for a user."""
    file = shown_path(read.resolve())
    return [
        replace(problem, file=str(out), line=None, column=None, at=None) if problem.file == file else problem
        for problem in problems
    ]
