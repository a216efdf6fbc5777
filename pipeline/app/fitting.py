"""`pipeline fit`: models of other programs fitted to a camera of a stage or of a build, and written for renderers."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from pathlib import Path

from pipeline.app.stages import existing, write_new
from pipeline.built.folder import BuiltFolder
from pipeline.built.records import BuiltCamera, pinholes
from pipeline.camera.figures.equivalent_pinhole import pinhole
from pipeline.camera.parts.camera import Camera
from pipeline.engine.files import chosen_place
from pipeline.errors import UsageError
from pipeline.exports.conventions import CONVENTIONS
from pipeline.exports.seen.stated_sight import StatedSight
from pipeline.exports.writers.maps.omni_lut import write_tables
from pipeline.files.drawings import write_drawing
from pipeline.files.jsonfile import json_bytes
from pipeline.fits.drawing import picture
from pipeline.fits.errors import FitError
from pipeline.fits.field import main_lens
from pipeline.fits.omniverse import Lut, seen_by_omniverse
from pipeline.fits.page import page
from pipeline.fits.result import THIN_LENS, FittedCamera, document, fit_camera
from pipeline.graph.dataset_graph import labels_of
from pipeline.scene.write.lens_distortion import distortion_layer
from pipeline.sight.opening import Opened, opened
from pipeline.sight.ready_camera import ReadyCamera
from pipeline.tasks.first_order import document as first_order_document

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

    def layer(self, path: Path, with_tables: bool = False) -> None:
        """Write the layer for other renderers, and lookup tables beside it if they are wanted.

        Raises
        ------
        UsageError
            A file exists, or the layer is no .usda.
        ExportError
            No pinhole fits, or light does not reach all of the image: there are no tables.
        """
        if path.suffix != ".usda":
            raise UsageError(f"{path} must end in .usda")
        pitch_mm = self.ready.camera.sensor.pitch_mm
        lut = self._tables(path.with_suffix("")) if with_tables else None
        seen = seen_by_omniverse(self.camera, self.opened.entry.prim_path, pitch_mm, lut)
        text = distortion_layer(self.opened.stage, path, seen)
        write_new(text, path)

    def _tables(self, stem: Path) -> Lut:
        """Write the lookup tables of the main lens."""
        for name in ("ray_enter", "ray_exit"):
            table = stem.with_name(f"{stem.name}.{name}.exr")
            if table.exists():
                raise existing(table)
        lens = main_lens(self.ready)
        rays = StatedSight(
            built=_as_built(self.opened, lens.camera), sight=lambda: lens, convention=CONVENTIONS["omni-lut"], scale=1.0
        )
        with chosen_place("write", stem):
            enter, leave = write_tables(rays, stem, {"remark0": f"{self.camera.name} by pipeline fit"})
        ideal = rays.ideal
        return Lut(ray_enter=enter.name, ray_exit=leave.name, centre_mm=ideal.pinhole.centre_mm, z_mm=ideal.z_mm)


def _as_built(opened: Opened, camera: Camera) -> BuiltCamera:
    """The record of a camera that a build would write, as far as maps need it."""
    record = first_order_document(labels_of(opened.entry), camera, pinhole(camera))
    plain, with_distortion = pinholes(record)
    return BuiltCamera(
        name=opened.entry.full_name,
        is_plenoptic=False,
        size_px=(camera.sensor.width_px, camera.sensor.height_px),
        pitch_mm=camera.sensor.pitch_mm,
        record=record,
        pinhole=plain,
        pinhole_with_distortion=with_distortion,
        views=(),
        white_path=None,
        rays_path=None,
        _folder=BuiltFolder(path=opened.stage.parent, stage=str(opened.stage), digests={}),
    )


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
