"""Content of `pipeline show`: the records and figures of a build, computed without one."""

import json
import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

from pipeline.app.chosen import chosen
from pipeline.camera.figures.equivalent_pinhole import pinhole
from pipeline.camera.figures.field_curves import FieldCurves, field_curves
from pipeline.camera.figures.first_order_figures import lens_report
from pipeline.camera.figures.point_images import PointImage, point_images
from pipeline.camera.focusing.depth_of_field import middle_focus
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.parts.errors import CameraError
from pipeline.engine.files import chosen_place
from pipeline.errors import UsageError
from pipeline.files.drawings import write_drawing
from pipeline.files.jsonfile import Json, json_bytes
from pipeline.graph.dataset_graph import labels_of
from pipeline.optics.first_order import first_order
from pipeline.report import point_images as point_report
from pipeline.report import text
from pipeline.results import drawing
from pipeline.scene.dataset import CameraEntry, LensEntry
from pipeline.scene.load import load
from pipeline.scene.usd.problems import Problem, StageError, blamed_on, shown_path
from pipeline.tasks.camera import document
from pipeline.tasks.params.cameras import CONVENTIONS

_CORNERS, _PIXELS = (0.2, 0.1, 0.05), 64
"""The square sensor with which a bare lens is shown. Its half diagonal over the focal length: the first of these whose
corners a chief ray reaches. Then its pixels along an edge.
"""


@dataclass(frozen=True)
class Shown:
    """One camera of a stage.

    Attributes
    ----------
    entry : CameraEntry
    warnings : list of Problem
        Warnings about its stage.
    """

    entry: CameraEntry
    warnings: list[Problem]

    @property
    def name(self) -> str:
        """Name of the camera."""
        return self.entry.name

    @cached_property
    def camera(self) -> Camera:
        """The focused camera."""
        return self.entry.camera

    @cached_property
    def document(self) -> Json:
        """Contents of camera.json."""
        return document(labels_of(self.entry), self.camera, pinhole(self.camera))

    @cached_property
    def curves(self) -> FieldCurves:
        """Illumination and distortion over the field."""
        return field_curves(self.camera, middle_focus(self.camera))

    def json(self) -> str:
        """The values of camera.json and the field curves, as JSON."""
        return json_bytes({**self.document, "field_curves": self.curves.to_plain()}).decode()

    def page(self) -> list[str]:
        """Lines for a terminal."""
        return text.page(self.entry.name, self.document, self.curves)

    def points(self, asked: "AskedPoints") -> list[tuple[CameraEntry, list[PointImage]]]:
        """Images of points by diffraction, in each channel at its mean wavelength."""
        with blamed_on(self.entry.file, self.entry.line, self.entry.prim_path):
            return [(one, _points_of(one, asked)) for one in self.entry.in_channels]

    def plot(self, path: Path) -> None:
        """Write the drawing of the lens."""
        with blamed_on(self.entry.file, self.entry.line, self.entry.prim_path):
            picture = drawing.svg(self.camera, f"{self.entry.name}: {self.entry.lens_name}")
        with chosen_place("write", path):
            write_drawing(path, picture)


@dataclass(frozen=True)
class ShownLens:
    """The lens of a stage that holds nothing else; its attributes are those of `Shown`."""

    entry: LensEntry
    warnings: list[Problem]

    @property
    def name(self) -> str:
        """Name of the prim of the lens."""
        return self.entry.name

    @property
    def camera(self) -> Camera | None:
        """The lens with a square sensor in its rear focus; None if it has no real image or no chief ray."""
        return self._seen[0]

    @property
    def curves(self) -> FieldCurves | None:
        """Illumination and distortion over the field, for objects at infinity."""
        return self._seen[1]

    @cached_property
    def _seen(self) -> tuple[Camera, FieldCurves] | tuple[None, None]:
        lens = first_order(self.entry.prescription)
        if not (0 < lens.efl_mm < math.inf and lens.bfd_mm > 0):
            return None, None
        parts: Json = {
            "prescription": self.entry.prescription,
            "sensor_distance_mm": -lens.rear_focus_mm,
        }
        for corner in _CORNERS:
            pitch_mm = corner * lens.efl_mm * math.sqrt(2) / _PIXELS
            camera = Camera(sensor=Sensor(width_px=_PIXELS, height_px=_PIXELS, pitch_mm=pitch_mm), **parts)
            try:
                return camera, field_curves(camera, math.inf)
            except CameraError:
                continue  # no chief ray reaches the corners
        return None, None

    @cached_property
    def document(self) -> Json:
        """First-order figures of the lens."""
        head = {"name": self.entry.lens_name, "index_source": self.entry.index_source}
        lens = {**head, **lens_report(self.entry.prescription)}
        return {"conventions": CONVENTIONS, "wavelengths_nm": [self.entry.wavelength_nm], "lens": lens}

    def json(self) -> str:
        """The document and the field curves, as JSON."""
        curves = self.curves.to_plain() if self.curves else None
        return json_bytes({**self.document, "field_curves": curves}).decode()

    def page(self) -> list[str]:
        """Lines for a terminal."""
        return text.lens_page(self.document, self.curves)

    def plot(self, path: Path) -> None:
        """Write the drawing of the lens."""
        if self.camera is None:
            raise UsageError(
                "a lens without a real image cannot be drawn", hint="without --plot its figures are printed"
            )
        picture = drawing.svg(drawing.with_full_field(self.camera), self.entry.lens_name, film="rear focus")
        with chosen_place("write", path):
            write_drawing(path, picture)


@dataclass(frozen=True)
class AskedPoints:
    """Points whose images are asked for.

    Attributes
    ----------
    picture : Path
        Name of the drawing.
    at_px : (float, float) or None
        Image position; None: a few places.
    distance_mm : float or None
        Distance of the points from the stop; None: they are in focus.
    """

    picture: Path
    at_px: tuple[float, float] | None = None
    distance_mm: float | None = None


def _points_of(entry: CameraEntry, asked: AskedPoints) -> list[PointImage]:
    camera = entry.camera if entry.channel is None else entry.camera.at(entry.channel.middle)
    return point_images(camera, entry.wavelength_nm, asked.at_px, asked.distance_mm, entry.camera)


class DrawnPoints(NamedTuple):
    """Images of points, as lines for a terminal and as plain values."""

    lines: list[str]
    plain: list[Json]


def draw_points(shown: list[Shown | ShownLens], asked: AskedPoints) -> DrawnPoints:
    """Write the drawing of images of points by one camera.

    Raises
    ------
    UsageError
        There are several cameras, or none.
    """
    one = _only(shown)
    if not isinstance(one, Shown):
        raise UsageError("a lens alone has no sensor on which points have images", hint="name a rig or a dataset")
    found, pitch_mm = one.points(asked), one.camera.sensor.pitch_mm
    rows, told, plain = [], list[str](), list[Json]()
    for entry, images in found:
        light = f"{entry.wavelength_nm:.1f} nm" + ("" if entry.channel is None else f" ({entry.channel.name})")
        rows += [(light, image) for image in images]
        head = [] if entry.channel is None else [f"channel {entry.channel.name}"]
        told += ["", *head, *point_report.lines(images, pitch_mm)]
        channel = {} if entry.channel is None else {"channel": entry.channel.name}
        plain += [{**channel, **image.to_plain()} for image in images]
    picture = point_report.drawing(rows, f"{one.name}: images of points by diffraction", pitch_mm)
    with chosen_place("write", asked.picture):
        write_drawing(asked.picture, picture)
    return DrawnPoints(told, plain)


def _only(shown: list[Shown | ShownLens]) -> Shown | ShownLens:
    if len(shown) > 1:
        names = ", ".join(one.name for one in shown)
        raise UsageError(f"one drawing shows one of these cameras: {names}", hint="name it behind the stage")
    return shown[0]


def show(
    path: str | Path, camera: str | None = None, allow_roots: Iterable[str | Path] = ()
) -> list[Shown | ShownLens]:
    """The cameras of a dataset or a rig, or only the one named; of a stage without a camera, its lens.

    Raises
    ------
    StageError
        The stage does not pass `check`, or holds neither camera nor lens.
    UsageError
        No camera has that name.
    """
    loaded = load(path, allow_roots)
    if loaded.errors:
        raise StageError(loaded.problems)
    names = [entry.name for entry in loaded.cameras]
    if not names and loaded.lens and camera is None:
        return [ShownLens(loaded.lens, loaded.problems)]
    if not names:
        hint = "name a dataset, a rig or a lens; a camera is a Camera with PlenCameraAPI"
        if loaded.targets:
            hint = f"`pipeline target {path}` describes a target"
        file = shown_path(Path(path).resolve())
        raise StageError([Problem(code="no-camera", message="the stage holds no camera", file=file, line=1, hint=hint)])
    wanted = loaded.cameras if camera is None else [loaded.cameras[chosen(path, "camera", names, camera)]]
    return [_shown(entry, loaded.problems) for entry in wanted]


def _shown(entry: CameraEntry, problems: list[Problem]) -> Shown:
    """One camera with its figures, computed here so that an error names the place in the stage."""
    with blamed_on(entry.file, entry.line, entry.prim_path):
        shown = Shown(entry, problems)
        _ = shown.document, shown.curves
    return shown


def plain_json(shown: list[Shown | ShownLens], points: DrawnPoints | None = None) -> str:
    """JSON of one camera or lens, with the images of points that were drawn, or of several cameras by name."""
    if points is not None:
        return json_bytes({**json.loads(shown[0].json()), "point_images": points.plain}).decode()
    if len(shown) == 1:
        return shown[0].json()
    return json_bytes({one.name: json.loads(one.json()) for one in shown}).decode()


def plot(shown: list[Shown | ShownLens], path: Path) -> None:
    """Write the drawing of one camera or lens.

    Raises
    ------
    UsageError
        There are several cameras.
    """
    _only(shown).plot(path)
