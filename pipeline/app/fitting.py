"""`pipeline fit`: models of other programs fitted to a camera of a stage or of a build, and written for renderers."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

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
from pipeline.results.folder import BuiltFolder
from pipeline.results.opening import Opened, opened
from pipeline.results.ready_camera import ReadyCamera
from pipeline.results.records import BuiltCamera
from pipeline.scene.write.lens_distortion import distortion_layer
from pipeline.tasks.camera import document as first_order_document

_DEFAULT = "brown"
"""Model that is fitted where none is named: what OpenCV fits by default."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
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
        try:
            with chosen_place("write", path), path.open("x", encoding="utf-8", newline="\n") as stream:
                stream.write(text)
        except FileExistsError:
            raise UsageError(f"{path} exists", hint="choose another name, or remove it") from None

    def _tables(self, stem: Path) -> Lut:
        """Write the lookup tables of the main lens."""
        for name in ("ray_enter", "ray_exit"):
            table = stem.with_name(f"{stem.name}.{name}.exr")
            if table.exists():
                raise UsageError(f"{table} exists", hint="choose another name, or remove it")
        lens = main_lens(self.ready)
        rays = StatedSight(
            built=_as_built(self.opened, lens.camera), sight=lambda: lens, convention=CONVENTIONS["omni-lut"], scale=1.0
        )
        with chosen_place("write", stem):
            enter, leave = write_tables(rays, stem, {"remark0": f"{self.camera.name} by pipeline fit"})
        ideal = rays.ideal
        return Lut(ray_enter=enter.name, ray_exit=leave.name, centre_mm=ideal.pinhole.centre_mm, z_mm=ideal.z_mm)


def _as_built(there: Opened, camera: Camera) -> BuiltCamera:
    """The record of a camera that a build would write, as far as maps need it."""
    record = first_order_document(labels_of(there.entry), camera, pinhole(camera))
    return BuiltCamera(
        name=there.entry.full_name,
        record=record,
        views=(),
        _folder=BuiltFolder(path=there.stage.parent, stage=str(there.stage), digests={}),
    )


def fit(place: Path, name: str | None, models: Iterable[str] = (), allow_roots: Iterable[str | Path] = ()) -> Found:
    """Fit models to a camera; by default OpenCV's five coefficients, and to a plenoptic camera a thin lens, too."""
    there = opened(place, name, allow_roots)
    camera = there.ready()
    wanted = list(models)
    if wanted or not camera.is_plenoptic:
        return Found(opened=there, camera=fit_camera(camera, wanted or [_DEFAULT]), ready=camera)
    try:
        return Found(opened=there, camera=fit_camera(camera, [_DEFAULT, THIN_LENS]), ready=camera)
    except FitError as error:
        return Found(opened=there, camera=fit_camera(camera, [_DEFAULT]), ready=camera, left_out=error.what)
