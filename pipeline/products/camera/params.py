"""Parameters of the tasks of a camera as such: its pinhole, and what camera.json says."""

from dataclasses import dataclass

from pipeline.camera.parts.spectrum import Channel
from pipeline.motion import Shutter
from pipeline.optics.windows import Windows
from pipeline.products.light import BundleLight


@dataclass(frozen=True, slots=True, kw_only=True)
class Nothing:
    """No parameters: the kind reads only the outputs of other tasks."""


CONVENTIONS = {
    "pixel": "(0, 0) is the centre of the top-left pixel, x right, y down",
    "vision_frame": "origin at the centre of the aperture stop, x right, y down, z forward, mm",
    "target_frame": "origin at the pattern centre, x right, y up, z towards the viewer, mm",
    "distances": "vision z from the aperture stop, mm",
    "pinhole": "centre of projection in the vision frame, axes as there; k1, k2, p1, p2, k3 as in OpenCV",
}


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
