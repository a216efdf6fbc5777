"""What `pipeline show` says of a camera: the same records and figures as a build, without a build."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from pipeline.camera.camera import Camera
from pipeline.camera.curves import field_curves
from pipeline.camera.focus import focused, middle_focus
from pipeline.errors import UsageError
from pipeline.files.jsonfile import json_bytes
from pipeline.report import drawing, text
from pipeline.scene.dataset import CameraEntry
from pipeline.scene.load import load
from pipeline.scene.problems import Problem, StageError, did_you_mean, shown_path
from pipeline.tasks.first_order import document
from pipeline.tasks.graph import labels_of


@dataclass(frozen=True)
class Shown:
    """One camera of a stage.

    Attributes
    ----------
    entry : CameraEntry
    warnings : list of Problem
        Of its stage.
    """

    entry: CameraEntry
    warnings: list[Problem]

    @cached_property
    def camera(self) -> Camera:
        """The focused camera."""
        return focused(self.entry.camera)

    @cached_property
    def document(self) -> dict[str, Any]:
        """Contents of camera.json."""
        return document(labels_of(self.entry), self.camera)

    def json(self) -> str:
        """The text of camera.json."""
        return json_bytes(self.document).decode()

    def page(self) -> list[str]:
        """Lines for a terminal."""
        return text.page(self.entry.name, self.document, field_curves(self.camera, middle_focus(self.camera)))

    def plot(self, path: Path) -> None:
        """Write the drawing of the lens."""
        path.write_text(drawing.svg(self.camera, f"{self.entry.name}: {self.entry.lens_name}"), encoding="utf-8")


def show(path: str | Path, camera: str | None = None, allow_roots: Iterable[str | Path] = ()) -> Shown:
    """The camera of a stage, of a dataset or of a rig alone.

    Raises
    ------
    StageError
        The stage does not pass `check`, or holds no camera.
    UsageError
        There is no camera of that name, or several and none is named.
    """
    loaded = load(path, allow_roots)
    if loaded.errors:
        raise StageError(loaded.problems)
    names = [entry.name for entry in loaded.cameras]
    if not names:
        hint = "name a dataset or a rig; a camera is a Camera with PlenCameraAPI"
        file = shown_path(Path(path).resolve())
        raise StageError([Problem(code="no-camera", message="the stage holds no camera", file=file, line=1, hint=hint)])
    if camera is None and len(names) > 1:
        raise UsageError(f"{path} has {len(names)} cameras: {', '.join(names)}", hint="name one of them")
    if camera is not None and camera not in names:
        hint = did_you_mean(camera, names) or f"its cameras: {', '.join(names)}"
        raise UsageError(f'{path} has no camera "{camera}"', hint=hint)
    return Shown(loaded.cameras[0 if camera is None else names.index(camera)], loaded.problems)
