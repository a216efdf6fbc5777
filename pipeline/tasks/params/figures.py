"""Parameters of the task `first_order`, and the labels and conventions of camera.json."""

from dataclasses import dataclass

from pipeline.camera.parts.spectrum import Channel
from pipeline.tasks.params.rays import Light

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


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraLabels:
    """Labels of a camera in camera.json, besides its figures."""

    lens_name: str
    index_source: str
    light: Light
    focus_request: FocusLabels | None
    channels: tuple[Channel, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class FirstOrder:
    """Labels of camera.json besides its figures."""

    labels: CameraLabels
    circle_of_confusion_px: float
