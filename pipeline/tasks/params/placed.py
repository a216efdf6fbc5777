"""Targets, occluders and pictures, as parameters of the tasks that see them."""

from dataclasses import dataclass

from pipeline.camera.parts.spectrum import Slices
from pipeline.files.jsonfile import Json
from pipeline.render.lighting.records import Lighting
from pipeline.render.spectral.prints import Colours

Matrix = list[list[float]]
"""A transform a_from_b, row by row, (4, 4) [mm]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedTarget:
    """A target in a frame, as `target_from_plain` reads it; its name is empty if the task must not depend on it."""

    name: str
    target: Json
    vision_from_target: Matrix


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedOccluder:
    """An occluder in a frame; `occluder` is a plain `targets.occluder.Occluder`."""

    occluder: Json
    vision_from_occluder: Matrix


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedView:
    """Everything in a frame, in the vision frame of a camera."""

    targets: tuple[PlacedTarget, ...]
    occluders: tuple[PlacedOccluder, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class PaintedView(PlacedView):
    """A view with the radiance of everything and of the background, or with the lamps that light it.

    `colours` are those of each target, empty for a neutral one; `lights` is the light of each wavelength of the image
    where lamps shine.
    """

    background: float
    lighting: Lighting | None = None
    colours: tuple[Colours, ...] = ()
    lights: tuple[Slices, ...] = ()


PICTURE = "picture.npy"


def source_name(suffix: str) -> str:
    """Name of the unchanged picture among the products of its task."""
    return f"source{suffix}"


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureFile:
    """A picture file: its kind by the end of its name, its bytes in base 64, and its colour space."""

    suffix: str
    encoded: str
    space: str


SHEET = "sheet.png"


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """A target whose pattern viewers show."""

    target: Json
