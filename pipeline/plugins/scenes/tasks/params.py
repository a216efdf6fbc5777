"""Parameters of the tasks of this plug-in: pictures, lit images, and labels of pixels.

`MODULE` is the home of the tasks whose parameters a record holds; the name of the task begins with the function.
"""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from pipeline.camera.parts.spectrum import Slices
from pipeline.motion import Shutter
from pipeline.plugins.scenes.lighting.records import Lighting
from pipeline.products.images.params import SECONDS_PER_MET, Image
from pipeline.products.light import Exposure
from pipeline.products.views import Matrix, Moving, PaintedView, PlacedOccluder, PlacedTarget

_SECONDS_PER_SURFACE = 6e-7
"""Processor time of a ray of a lit image for each surface that it meets [s]: with two reflections rays took 2.5 µs in
example 05 on a busy machine, else 0.5 µs before an open wall and 1.1 in a closed room, on 28 November 2026.
"""
_GOING_ON = 0.8
"""Share of the rays that go on from a surface to the next [1]: in that room five reflections took 1.55 times as long.
"""
PICTURE = "picture.npy"
LABELS, BOXES, PREVIEW = "labels.exr", "boxes.json", "labels.png"


def source_name(suffix: str) -> str:
    """Name of the unchanged picture among the products of its task."""
    return f"source{suffix}"


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureFile:
    """A picture file: its kind by the end of its name, its bytes in base 64, and its colour space."""

    MODULE: ClassVar[str] = "pipeline.plugins.scenes.tasks.pictures"

    suffix: str
    encoded: str
    space: str


@dataclass(frozen=True, slots=True, kw_only=True)
class LitPaintedView(PaintedView):
    """A view with its lighting; `lights` is the light of each wavelength of the image."""

    lighting: Lighting | None
    lights: tuple[Slices, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class LitImage(Image):
    """An image of a lit scene."""

    MODULE: ClassVar[str] = "pipeline.plugins.scenes.tasks.images"

    view: LitPaintedView | None

    @property
    def seconds_per_ray(self) -> float | None:
        """Processor time of a ray, with what it meets [s]."""
        if self.view is None or self.view.lighting is None:
            return None
        return _SECONDS_PER_SURFACE * sum(_GOING_ON**met for met in range(self.view.lighting.bounces + 1))

    @property
    def steps(self) -> tuple[str, ...]:
        """Steps of kernel compilation, see `app.build`."""
        return ("company", "lighting") if self.view and self.view.lighting else ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Channels:
    """Channels of labels: the tokens, names of targets with shares, and names of all things by matte, targets first."""

    tokens: tuple[str, ...]
    targets: tuple[str, ...]
    mattes: dict[str, tuple[str, ...]]


@dataclass(frozen=True, slots=True, kw_only=True)
class NextFrame:
    """All targets and occluders in the next frame, None for one that is invisible there; and the shutter."""

    targets: Annotated[tuple[PlacedTarget, ...], "targets/*"]
    occluders: Annotated[tuple[PlacedOccluder | None, ...], "occluders"]
    shutter: Shutter | None


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelsTile:
    """Some rows of labels; the world, and the next frame, only if a label asks for them.

    The view has materials, and no lamps, if light passes some things. Before a shutter the view moves, and the camera
    if it has a motion, world_from_vision. Of a camera that is another one in the next frame a role `next` is read.
    """

    MODULE: ClassVar[str] = "pipeline.plugins.scenes.tasks.labels"

    exposure: Exposure
    channels: Channels
    view: LitPaintedView
    world_from_vision: Matrix | None
    later: NextFrame | None = None
    rows: tuple[int, int] = (0, 0)
    shutter: Shutter | None = None
    camera_motion: Moving = None

    @property
    def seconds_per_ray(self) -> float:
        """Processor time of a ray, for forecasts [s]."""
        return SECONDS_PER_MET

    @property
    def steps(self) -> tuple[str, ...]:
        """Steps of kernel compilation, see `app.build`."""
        return ("lighting",) if self.view.lighting else ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Labels:
    """Labels of a frame from a number of tiles."""

    MODULE: ClassVar[str] = "pipeline.plugins.scenes.tasks.labels"

    exposure: Exposure
    channels: Channels
    tiles: int
