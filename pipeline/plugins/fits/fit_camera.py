"""`pipeline fit`: models of other programs fitted to a camera of a stage or of a build, and written for renderers."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from pathlib import Path

from pipeline.app.stages import draw, write_new
from pipeline.errors import UsageError
from pipeline.fits.field import FitError
from pipeline.plugins.fits.drawing import picture
from pipeline.plugins.fits.omniverse import seen_by_omniverse
from pipeline.plugins.fits.result import THIN_LENS, FittedCamera, fit_camera
from pipeline.results.opening import Opened, opened
from pipeline.scene.write.text import distortion_layer

_DEFAULT = "brown"
"""Model that is fitted where none is named: what OpenCV fits by default."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraFit:
    """A fitted camera, where it comes from, and why a model that is fitted by default is missing, if one is."""

    opened: Opened
    camera: FittedCamera
    left_out: str | None = None

    def plot(self, path: Path) -> None:
        """Draw the best fit."""
        if not self.camera.fits:
            raise UsageError(f"{THIN_LENS} alone has no residual field over the image", hint="add another --model")
        draw(picture(self.camera, self.camera.best), path)

    def layer(self, path: Path) -> None:
        """Write the new layer for other renderers."""
        entry = self.opened.entry
        seen_camera = seen_by_omniverse(self.camera, entry.prim_path, entry.asked.sensor.pitch_mm)
        write_new(distortion_layer(self.opened.stage, path, seen_camera), path)


def fit(
    stage_or_build: Path, name: str | None, models: Collection[str] = (), allow_roots: Iterable[str | Path] = ()
) -> CameraFit:
    """Fit models to a camera; by default OpenCV's five coefficients, and to a plenoptic camera a thin lens, too."""
    stage = opened(stage_or_build, name, allow_roots)
    camera = stage.ready()
    by_default = [_DEFAULT, THIN_LENS] if camera.is_plenoptic else [_DEFAULT]
    try:
        return CameraFit(opened=stage, camera=fit_camera(camera, models or by_default))
    except FitError as error:
        if models or not camera.is_plenoptic:
            raise
        return CameraFit(opened=stage, camera=fit_camera(camera, [_DEFAULT]), left_out=error.message)
