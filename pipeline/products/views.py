"""Parameters for the targets and occluders before a camera in a frame, which several products share.

An annotation names the part of a dataset of which a field is made, as its readers note it, for `app.why`; `*` stands
for the index or the key that follows.
"""

from dataclasses import dataclass
from typing import Annotated

from pipeline.files.jsonfile import Json
from pipeline.motion import Motion
from pipeline.render.spectral.prints import Colours

Matrix = Annotated[list[list[float]], "poses"]
"""A transform a_from_b, row by row, (4, 4) [mm]."""
Moving = Annotated[Motion | None, "motions"]
"""What changes while a shutter is open; None: nothing does."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedTarget:
    """A target in a frame, as `target_from_plain` reads it; its name is empty if the task must not depend on it, and it
    has a motion where a shutter is open while it moves.
    """

    name: str
    target: Json
    vision_from_target: Matrix
    motion: Moving = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedOccluder:
    """An occluder in a frame; `occluder` is a plain `targets.mesh.Occluder`."""

    occluder: Json
    vision_from_occluder: Matrix
    motion: Moving = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedView:
    """Everything in a frame, in the vision frame of a camera."""

    targets: Annotated[tuple[PlacedTarget, ...], "targets/*"]
    occluders: Annotated[tuple[PlacedOccluder, ...], "occluders"]


@dataclass(frozen=True, slots=True, kw_only=True)
class PaintedView(PlacedView):
    """A view with the radiance of everything and of the background; `colours` are those of each target, empty for a
    neutral one.
    """

    background: float
    colours: Annotated[tuple[Colours, ...], "targets/*"] = ()
