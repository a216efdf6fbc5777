"""A camera as a file of another program describes it: its parts, and what of the file is not among them."""

from dataclasses import dataclass

from pipeline.camera.parts.camera import Sensor
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.optics.printed import Lost, PrintedLens


@dataclass(frozen=True, slots=True, kw_only=True)
class PrintedCamera:
    """A camera with what is known about where it comes from; fields that it shares with `Camera` mean the same.

    Attributes
    ----------
    name : str
        For people.
    provenance : tuple of str
        Paragraphs: where the numbers were read, notes.
    lost : tuple of Lost
        Statements of the source that this record cannot hold; the lens lists its own.
    """

    name: str
    provenance: tuple[str, ...] = ()
    lens: PrintedLens
    sensor: Sensor
    sensor_distance_mm: float
    microlenses: MicrolensArray | None = None
    near_mm: float | None = None
    far_mm: float | None = None
    lost: tuple[Lost, ...] = ()
