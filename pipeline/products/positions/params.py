"""Parameters of position images."""

from dataclasses import dataclass
from typing import Annotated

from pipeline.camera.parts.camera import Sampling
from pipeline.products.light import BundleLight
from pipeline.products.views import Matrix


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaneAsked:
    """A tangent plane of a target and the points on it (vision frame) [mm]."""

    name: str
    vision_from_target: Matrix
    points_mm: Annotated[list[list[float]], "poses targets"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Positions:
    """J on each plane, in the part of the image that `extent` names: "tiles" about the points, or all of it.

    `square_px`: edge of the square around a position from which rays start [px]; 0: the position itself.
    """

    planes: tuple[PlaneAsked, ...]
    extent: str
    sampling: Sampling
    light: BundleLight
    square_px: float
