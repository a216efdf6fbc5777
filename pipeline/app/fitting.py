"""`pipeline fit`: models of other programs fitted to a camera of a stage or of a build, and written for renderers."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from pathlib import Path

from pipeline.app.stages import write_new
from pipeline.engine.files import chosen_place
from pipeline.errors import UsageError
from pipeline.files.drawings import write_drawing
from pipeline.files.jsonfile import json_bytes
from pipeline.fits.drawing import picture
from pipeline.fits.field import FitError
from pipeline.fits.omniverse import seen_by_omniverse
from pipeline.fits.result import THIN_LENS, FittedCamera, document, fit_camera, page
from pipeline.results.opening import Opened, opened
from pipeline.results.ready_camera import ReadyCamera
from pipeline.scene.write.text import distortion_layer

_DEFAULT = "brown"
"""Model that is fitted where none is named: what OpenCV fits by default."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraFit:
    """A fitted camera, where it comes from, and why a model that is fitted by default is missing, if one is."""

    opened: Opened
    camera: FittedCamera
    ready: ReadyCamera
    left_out: str | None = None

    def page(self) -> list[str]:
        """Lines for a terminal."""
        return list(page(self.camera))

    def json(self) -> str:
        """All of it as JSON, the residual fields included."""
        return json_bytes(document(self.camera)).decode()

    def plot(self, path: Path) -> None:
        """Draw the best fit."""
        if not self.camera.fits:
            raise UsageError(f"{THIN_LENS} alone has no residual field over the image", hint="add another --model")
        with chosen_place("write", path):
            write_drawing(path, picture(self.camera, self.camera.best))

    def layer(self, path: Path) -> None:
        """Write the layer for other renderers.

        Raises
        ------
        UsageError
            The file exists, or is no .usda.
        """
        if path.suffix != ".usda":
            raise UsageError(f"{path} must end in .usda")
        pitch_mm = self.ready.camera.sensor.pitch_mm
        seen = seen_by_omniverse(self.camera, self.opened.entry.prim_path, pitch_mm)
        text = distortion_layer(self.opened.stage, path, seen)
        write_new(text, path)


def fit(
    place: Path, name: str | None, models: Collection[str] = (), allow_roots: Iterable[str | Path] = ()
) -> CameraFit:
    """Fit models to a camera; by default OpenCV's five coefficients, and to a plenoptic camera a thin lens, too."""
    stage = opened(place, name, allow_roots)
    camera = stage.ready()
    wanted = list(models) or ([_DEFAULT, THIN_LENS] if camera.is_plenoptic else [_DEFAULT])
    try:
        return CameraFit(opened=stage, camera=fit_camera(camera, wanted), ready=camera)
    except FitError as error:
        if models or not camera.is_plenoptic:
            raise
        return CameraFit(opened=stage, camera=fit_camera(camera, [_DEFAULT]), ready=camera, left_out=error.what)
