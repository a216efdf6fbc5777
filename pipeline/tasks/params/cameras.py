"""Parameters of the tasks of a camera whatever it sees: its bundles, micro-images and white images."""

from dataclasses import dataclass

from pipeline.camera.parts.camera import Sampling
from pipeline.camera.parts.spectrum import Channel
from pipeline.motion import Shutter
from pipeline.optics.windows import Windows


@dataclass(frozen=True, slots=True, kw_only=True)
class Nothing:
    """No parameters: the kind reads only the outputs of other tasks."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelLabel:
    """A channel as images and tables name it: its wavelengths, and their shares."""

    name: str
    wavelengths_nm: tuple[float, ...]
    shares: tuple[float, ...]

    @property
    def text(self) -> str:
        """For the header of a table."""
        nodes = zip(self.wavelengths_nm, self.shares, strict=True)
        return f"channel: {self.name}; " + ", ".join(f"{nm:.6g} nm ({share:.4f})" for nm, share in nodes)


CONVENTIONS = {
    "pixel": "(0, 0) is the centre of the top-left pixel, x right, y down",
    "vision_frame": "origin at the centre of the aperture stop, x right, y down, z forward, mm",
    "target_frame": "origin at the pattern centre, x right, y up, z towards the viewer, mm",
    "distances": "vision z from the aperture stop, mm",
    "pinhole": "centre of projection in the vision frame, axes as there; k1, k2, p1, p2, k3 as in OpenCV",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class BundleLight:
    """Light of a camera's bundles: the weight of their rays, their footprint, and the wavelength."""

    weight: str
    footprint: str
    wavelength_nm: float


@dataclass(frozen=True, slots=True, kw_only=True)
class FocusLabels:
    """A focus request, as camera.json states it."""

    focus_distance_mm: float | None
    focus_type: int | None
    focus_groups: tuple[str, ...]
    group_shift_mm: float | None
    stop_match: str


TIMES = "times.exr"
"""Output of the task `first_order` of a camera with a shutter."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraLabels:
    """Labels of a camera in camera.json, besides its figures, and what its depth of field is of."""

    circle_of_confusion_px: float
    lens_name: str
    index_source: str
    light: BundleLight
    focus_request: FocusLabels | None
    channels: tuple[Channel, ...] = ()
    shutter: Shutter | None = None
    windows: Windows | None = None  # those in the world: the channels are of the camera without them


@dataclass(frozen=True, slots=True, kw_only=True)
class RaysTile:
    """A band of rows of the image; `square_px` is the edge of the square on which the rays of J start.

    `device` is where they are traced, see `graph.variants`; None: by the processor.
    """

    first_row: int
    end_row: int
    sampling: Sampling
    square_px: float
    device: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class JoinedRays:
    """The bundles of a camera, from a number of tiles."""

    tiles: int
    sampling: Sampling
    light: BundleLight


@dataclass(frozen=True, slots=True, kw_only=True)
class MicroImagesTile:
    """One of a number of equal shares of the microlenses."""

    tile: int
    tiles: int


@dataclass(frozen=True, slots=True, kw_only=True)
class MicroImageTables:
    """The micro-images from a number of tiles; 0: the task does the work itself."""

    tiles: int


PARTS = "parts.usda"


@dataclass(frozen=True, slots=True, kw_only=True)
class Parts:
    """The metadata of the stage that names the parts of a camera, for viewers."""

    meters_per_unit: float
    up_axis: str


FIRST, OWN, STRIP = "first", "own", "tile"
"""Roles, with a number, of the first pass over a strip; of that of its own; and, with a number, of a strip."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Exposure:
    """The rays of an image: samples of a pixel, their random numbers, measure and wavelength, or channel; whether they
    are diffracted; the device that traces them, see `graph.variants`, or None for the processor."""

    samples: int
    seed: int
    weight: str
    wavelength_nm: float
    channel: ChannelLabel | None = None
    diffraction: bool = False
    device: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Rendering:
    """An image: whole, from a number of tiles, or the first to an end row of it.

    `noise`: the standard error that was asked for, relative to the mean of the image; `passes`: most of them over a
    strip.
    """

    exposure: Exposure
    rows: tuple[int, int] | None = None
    passes: int = 0
    tiles: int = 0
    noise: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class White(Rendering):
    """The image of a white scene; `is_smooth`: neither microlenses nor diffraction, so that quadrature may know it."""

    is_smooth: bool
