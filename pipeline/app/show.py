"""Content of `pipeline show` and `pipeline target`: the records and figures of a build, computed without one."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from pipeline.app.pages import point_images as point_report
from pipeline.app.pages import text
from pipeline.app.pages.artwork import pages_of, paper_of, pdf_content, svg
from pipeline.app.stages import chosen, draw, lacking, sound
from pipeline.camera.figures.equivalent_pinhole import pinhole
from pipeline.camera.figures.field_curves import FieldCurves, field_curves
from pipeline.camera.figures.first_order_figures import lens_report
from pipeline.camera.figures.point_images import PointImage, point_images
from pipeline.camera.focusing.depth_of_field import focused, middle_focus
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.pupil.from_stop import pupil_fan
from pipeline.errors import UsageError
from pipeline.files.drawings import pdf_bytes
from pipeline.files.jsonfile import Json, json_bytes
from pipeline.optics.first_order import first_order
from pipeline.products.camera.make import document
from pipeline.products.camera.params import CONVENTIONS
from pipeline.products.camera.plan import camera_labels
from pipeline.results import drawing
from pipeline.scene.dataset import CameraEntry, LensEntry, TargetEntry
from pipeline.scene.usd.problems import Problem, blamed_on
from pipeline.targets.mesh import MeshTarget
from pipeline.targets.target import Target

_FISHEYE = 2.5
"""Like `_CORNERS`, and tried first for very wide lenses: those of 220 degrees image up to 1.9 focal lengths."""
_CORNERS = 0.2, 0.1, 0.05
"""Half diagonal of the square sensor with which a bare lens is shown, over the focal length: the first of these whose
corners a chief ray reaches.
"""
_PIXELS = 64
"""Pixels along an edge of that sensor."""


@dataclass(frozen=True)
class ShownCamera:
    """A camera of a stage, or the lens of a stage that holds nothing else, and warnings about the stage.

    `document` is the content of camera.json; for a bare lens, its first-order figures. `curves` are over the field, for
    a bare lens with objects at infinity. A lens is shown with a square sensor in its rear focus, and without camera and
    curves if it has no real image or no chief ray.
    """

    entry: CameraEntry | LensEntry
    warnings: list[Problem]
    document: Json
    camera: Camera | None
    curves: FieldCurves | None

    def plain(self) -> Json:
        return {**self.document, "field_curves": self.curves.to_plain() if self.curves else None}

    def page(self) -> list[str]:
        """Lines for a terminal."""
        if isinstance(self.entry, CameraEntry) and self.curves:
            return text.page(self.entry.name, self.document, self.curves)
        return text.lens_page(self.document, self.curves)

    def _drawing(self) -> str:
        if self.camera is None:
            hint = "without --plot its figures are printed"
            raise UsageError("a lens without a real image cannot be drawn", hint=hint)
        if isinstance(self.entry, LensEntry):
            return drawing.svg(drawing.with_full_field(self.camera), self.entry.lens_name, film="rear focus")
        with blamed_on(self.entry.file, self.entry.line, self.entry.prim_path):
            return drawing.svg(self.camera, f"{self.entry.name}: {self.entry.lens_name}")


def show(path: str | Path, camera: str | None = None, allow_roots: Iterable[str | Path] = ()) -> list[ShownCamera]:
    """The cameras of a stage, or the one named, or its lens; StageError without these, UsageError as `chosen`."""
    loaded = sound(path, allow_roots)
    names = [entry.name for entry in loaded.cameras]
    if not names and loaded.lens and camera is None:
        return [_shown_lens(loaded.lens, loaded.problems)]
    if not names:
        hint = "name a dataset, a rig or a lens; a camera is a Camera with PlenCameraAPI"
        raise lacking(path, "camera", f"`pipeline target {path}` describes a target" if loaded.targets else hint)
    entries = loaded.cameras if camera is None else [loaded.cameras[chosen(path, "camera", names, camera)]]
    return [_shown_camera(entry, loaded.problems) for entry in entries]


def _shown_camera(entry: CameraEntry, warnings: list[Problem]) -> ShownCamera:
    """A camera of a stage with its camera.json and its field curves for objects in focus."""
    with blamed_on(entry.file, entry.line, entry.prim_path):
        camera = entry.camera
        content = document(camera_labels(entry), camera, pinhole(camera), focused(entry.asked))
        return ShownCamera(entry, warnings, content, camera, field_curves(camera, middle_focus(camera)))


def _shown_lens(entry: LensEntry, warnings: list[Problem]) -> ShownCamera:
    """A lens with its first-order figures, before a sensor if it has a real image."""
    head = {"name": entry.lens_name, "index_source": entry.index_source}
    lens = {**head, **lens_report(entry.prescription)}
    content = {"conventions": CONVENTIONS, "wavelengths_nm": [entry.wavelength_nm], "lens": lens}
    return ShownCamera(entry, warnings, content, *_with_sensor(entry))


def _with_sensor(entry: LensEntry) -> tuple[Camera, FieldCurves] | tuple[None, None]:
    """The lens before a square sensor, and its curves; None if it has no real image or no chief ray."""
    lens = first_order(entry.prescription)
    if not (0 < lens.efl_mm < math.inf and lens.bfd_mm > 0):
        return None, None
    corners = (_FISHEYE, *_CORNERS) if pupil_fan(entry.prescription).is_wide else _CORNERS
    for corner in corners:
        pitch_mm = corner * lens.efl_mm * math.sqrt(2) / _PIXELS
        sensor = Sensor(width_px=_PIXELS, height_px=_PIXELS, pitch_mm=pitch_mm)
        camera = Camera(prescription=entry.prescription, sensor_distance_mm=-lens.rear_focus_mm, sensor=sensor)
        try:
            return camera, field_curves(camera, math.inf)
        except CameraError:
            continue  # no chief ray reaches the corners
    return None, None


@dataclass(frozen=True)
class PointImages:
    """Point images of one camera with diffraction, in each channel at its mean wavelength."""

    channels: list[tuple[CameraEntry, list[PointImage]]]
    pitch_mm: float

    def lines(self) -> list[str]:
        lines = list[str]()
        for entry, images in self.channels:
            head = [] if entry.channel is None else [f"channel {entry.channel.name}"]
            lines += ["", *head, *point_report.lines(images, self.pitch_mm)]
        return lines

    def plain(self) -> list[Json]:
        """Plain values, as in `show --json`."""
        heads = [({"channel": entry.channel.name} if entry.channel else {}, images) for entry, images in self.channels]
        return [{**head, **image.to_plain()} for head, images in heads for image in images]


def draw_points(
    cameras: list[ShownCamera], path: Path, at_px: tuple[float, float] | None, distance_mm: float | None
) -> PointImages:
    """Write the drawing of point images of one camera, by default in focus; UsageError if the stage has several."""
    entry = _single(cameras).entry
    if isinstance(entry, LensEntry):
        raise UsageError("a lens alone has no sensor on which points have images", hint="name a rig or a dataset")
    channels = []
    rows = []
    pitch_mm = entry.camera.sensor.pitch_mm
    with blamed_on(entry.file, entry.line, entry.prim_path):
        for part in entry.in_channels:
            camera = part.camera if part.channel is None else part.camera.at(part.channel.middle)
            images = point_images(camera, part.wavelength_nm, at_px, distance_mm, part.camera)
            light = f"{part.wavelength_nm:.1f} nm" + ("" if part.channel is None else f" ({part.channel.name})")
            channels.append((part, images))
            rows += [(light, image) for image in images]
    draw(point_report.drawing(rows, f"{entry.name}: images of points by diffraction", pitch_mm), path)
    return PointImages(channels, pitch_mm)


def _single(cameras: list[ShownCamera]) -> ShownCamera:
    if len(cameras) > 1:
        names = ", ".join(camera.entry.name for camera in cameras)
        raise UsageError(f"one drawing shows one of these cameras: {names}", hint="name it behind the stage")
    return cameras[0]


def plain_json(cameras: list[ShownCamera], points: PointImages | None = None) -> str:
    """JSON of one camera or lens, with its point images if they were drawn, or of several cameras by name."""
    plain = {camera.entry.name: camera.plain() for camera in cameras} if len(cameras) > 1 else cameras[0].plain()
    return json_bytes({**plain, "point_images": points.plain()} if points else plain).decode()


def plot(cameras: list[ShownCamera], path: Path) -> None:
    """Write the drawing of one camera or lens; UsageError if there are several."""
    draw(_single(cameras)._drawing(), path)


@dataclass(frozen=True)
class TargetPrint:
    """One target of a stage, and warnings about the stage."""

    entry: TargetEntry
    warnings: list[Problem]

    def page(self) -> list[str]:
        """Description of the target, as lines for a terminal."""
        target = self.entry.target
        points = target.points()
        if isinstance(target, Target):
            title = target.pattern.title()
            shape = target.surface.KIND
            ids = [f"ids     {target.pattern.ORDER}"]
        else:
            title = target.title()
            shape = "mesh"
            ids = []
        lines = [f"{self.entry.name}: {title}", f"shape   {shape}", *ids]
        kinds = {kind: points.kinds.count(kind) for kind in dict.fromkeys(points.kinds)}
        lines.append("points  " + ", ".join(f"{count} x {kind}" for kind, count in kinds.items()))
        low = points.position_mm.min(axis=0) + 0.0
        high = points.position_mm.max(axis=0) + 0.0
        sides = (f"{axis} {a:g} to {b:g} mm" for axis, a, b in zip("xyz", low, high, strict=True))
        lines.append(f"extent  {', '.join(sides)}")
        return lines

    def write(self, path: Path) -> str:
        """Write an SVG file of all pages, one below the other, or a PDF file; returns the paper size in words."""
        if isinstance(self.entry.target, MeshTarget):
            raise UsageError(f'"{self.entry.name}" is a mesh, which cannot be printed on paper')
        pages = pages_of(self.entry.target, self.entry.name)
        if path.suffix == ".svg":
            draw(svg(pages), path)
        else:
            draw(pdf_bytes([(page.width_mm, page.height_mm, pdf_content(page)) for page in pages]), path)
        return paper_of(pages)


def artwork(path: str | Path, target: str | None = None, allow_roots: Iterable[str | Path] = ()) -> TargetPrint:
    """The artwork of a target of a stage; StageError if the stage is wrong or has no target, UsageError as `chosen`."""
    loaded = sound(path, allow_roots)
    names = [entry.name for entry in loaded.targets]
    if not names:
        raise lacking(path, "target", "name a dataset or a file of stages/targets")
    return TargetPrint(loaded.targets[chosen(path, "target", names, target)], loaded.problems)
