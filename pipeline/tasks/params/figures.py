"""Parameters of the task `first_order`, and the labels of camera.json."""

from dataclasses import dataclass

from pipeline.camera.parts.spectrum import Channel
from pipeline.tasks.params.rays import Light


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
