"""Parameters of the tasks that determine a camera: `focus`, `planes`, `stop`, `pinhole`."""

from dataclasses import dataclass

from pipeline.camera.focusing.focus_request import FocusRequest
from pipeline.camera.parts.camera import Camera
from pipeline.camera.parts.spectrum import Channel


@dataclass(frozen=True, slots=True, kw_only=True)
class Nothing:
    """No parameters: the kind reads only the outputs of other tasks."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Focus:
    """A camera, or a request for a focus; without near and far planes and without names."""

    camera: Camera | None
    request: FocusRequest | None

    @property
    def asked(self) -> Camera | FocusRequest:
        """The camera or the request, whichever is present."""
        asked = self.camera or self.request
        assert asked is not None
        return asked


@dataclass(frozen=True, slots=True, kw_only=True)
class Planes:
    """Planes of J_near and J_far as authored; None: derived from the depth of field."""

    near_mm: float | None
    far_mm: float | None
    circle_of_confusion_px: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Stop:
    """Another F-number of the same camera."""

    f_number: float


@dataclass(frozen=True, slots=True, kw_only=True)
class InChannel:
    """The light of a channel; its name is left out."""

    channel: Channel


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
